"""A training as a film: what a network says of some frames before it and after each epoch."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hadr.camera import FloatArray, window_around
from hadr.figures.panels import COLORS, show_depth
from hadr.training.frames.batches import FrameTensors

_NEAR_CM = 15.0  # half the range of depth around a glass


def distances(depth: FloatArray, frames: FrameTensors) -> FloatArray:
    """Median depth (N,) of each frame's glass, metres, of depth (N, H, W)."""
    masks = frames.inputs.mask.numpy()
    return np.array([np.median(d[m]) for d, m in zip(depth, masks, strict=True)])


def epoch_picture(
    stages: Mapping[str, FloatArray], frames: FrameTensors, shown: Sequence[int], stage: int
) -> Figure:
    """Draw one stage: restored depth of three frames, the glasses from above, all distances."""
    name, depth = list(stages.items())[stage]
    figure: Figure = plt.figure(figsize=(9, 4.0))
    names = [[*(f"image {k}" for k in range(3)), "all"], [*(f"above {k}" for k in range(3)), "all"]]
    axes: dict[str, Axes] = figure.subplot_mosaic(names, width_ratios=(1, 1, 1, 2.0))
    for k, frame in enumerate(shown):
        _draw_glass(axes[f"image {k}"], axes[f"above {k}"], depth[frame], frames, frame)
    axes["above 0"].set_ylabel("behind the glass's\nmiddle (cm)")
    _draw_all(axes["all"], stages, frames, name)
    figure.suptitle(name, x=0.02, ha="left", weight="bold")
    return figure


def _draw_glass(
    image: Axes, above: Axes, depth: FloatArray, frames: FrameTensors, frame: int
) -> None:
    mask, truth = frames.inputs.mask[frame].numpy(), frames.true_depth[frame].numpy()
    middle = float(np.median(truth[mask]))
    window = window_around(mask, 3)
    near, far = middle - _NEAR_CM / 100, middle + _NEAR_CM / 100
    painted = np.where(mask, depth, 0)[window]
    show_depth(image, painted, f"glass at {middle:.2f} m", vmin=near, vmax=far, colorbar=False)
    error = 100 * float(np.abs(depth - truth)[mask].mean())
    image.set_xlabel(f"error {error:.1f} cm")
    camera = frames.inputs.intrinsics[frame].numpy()
    columns = np.nonzero(mask)[1]
    side = (columns - columns.mean()) / camera[0] * middle * 100
    for values, color, label in ((truth, "truth", "true"), (depth, "hadr", "restored")):
        behind = (values[mask] - middle) * 100
        above.plot(side, behind, ".", ms=2.5, alpha=0.6, color=COLORS[color], label=label)
    above.set(xlim=(-7, 7), ylim=(-_NEAR_CM, _NEAR_CM), xlabel="sideways (cm)")


def _draw_all(ax: Axes, stages: Mapping[str, FloatArray], frames: FrameTensors, name: str) -> None:
    truth = distances(frames.true_depth.numpy(), frames)
    said = {stage: distances(depth, frames) for stage, depth in stages.items()}
    ends = np.array([truth.min() - 0.05, truth.max() + 0.05])
    last = list(said.values())[1:]
    low = min(ends[0], *(values.min() for values in last)) if last else ends[0]
    high = max(ends[1], *(values.max() for values in last)) if last else ends[1]
    ax.plot(ends, ends, color=COLORS["truth"], lw=1, label="right")
    here = said[name]
    ax.scatter(truth, here.clip(low, high), s=24, color=COLORS["hadr"], clip_on=False, zorder=3)
    off = 100 * float(np.abs(here - truth).mean())
    ax.set_title(f"{len(truth)} glasses: mean error {off:.1f} cm")
    ax.set(xlabel="true distance (m)", ylabel="restored distance (m)", xlim=ends, ylim=(low, high))
    ax.legend(loc="upper left")
