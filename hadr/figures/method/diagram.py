"""The whole method in one diagram: from a frame and a hand to restored depth and a grasp.

All of it is computed from one bundled frame by the bundled HADR: the pictures, one of the rays, the
voxels that it crosses, what the network says about them, and a grasp on the restored points.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import torch
from matplotlib.patches import Rectangle

from hadr.camera import Array, back_project, project
from hadr.corruption import erase_mask
from hadr.data.frame import Frame
from hadr.data.samples import open_samples, samples_dir
from hadr.figures.depth.restored_glass import square_window
from hadr.figures.panels import COLORS, DEPTH_MAP, MISSING, bare_axes, show_keypoints
from hadr.figures.sheet import FONT, INK, Box, Sheet
from hadr.handover.grasping.candidates import sample_grasps
from hadr.handover.grasping.collision import free_of_hand, free_of_object
from hadr.handover.grasping.grasps import PAPER_WAY, forward_of
from hadr.handover.grasping.gripper import fork
from hadr.handover.grasping.rescoring import Directions, rescore
from hadr.models.hadr import HADR, HADROutput
from hadr.models.network_input import HADRInput, frame_to_input
from hadr.records.checkout import checkout_root
from hadr.restoration import CHECKPOINT_NAME, restore
from hadr.training.checkpoints import load_checkpoint

PARTS: dict[str, tuple[tuple[str, ...], str, Box]] = {
    "input": (
        ("depth_corruption", "transhand_data"), "a frame and a hand go in", (0.08, 3.5, 5.3, 2.42)),
    "pairs": (("ray_voxels",), "rays, voxels, pairs", (5.78, 3.5, 5.54, 2.42)),
    "ray": (("ray_and_voxel_features",), "ray feature", (0.08, 1.02, 1.68, 2.08)),
    "voxel": (("ray_and_voxel_features",), "voxel feature", (1.89, 1.02, 1.68, 2.08)),
    "hand": (("hand_features",), "hand feature", (3.7, 1.02, 1.68, 2.08)),
    "answer": (("training",), "probability, offset, depth", (5.78, 0.08, 3.68, 3.02)),
    "grasp": (("grasp_rescoring", "handover_experiment"), "grasp", (9.6, 0.08, 1.72, 3.02)),
}  # fmt: skip
"""The parts by name: the first and last notebook on it, its title, and its place on the sheet."""
STRIP: Box = (0.08, 0.08, 5.3, 0.82)
FLOWS = (
    ((0.92, 3.5), (0.92, 3.1)), ((2.73, 3.5), (2.73, 3.1)), ((4.54, 3.5), (4.54, 3.1)),
    ((5.38, 4.6), (5.78, 4.6)), ((7.6, 3.5), (7.6, 3.1)), ((5.38, 0.5), (5.78, 0.5)),
    ((9.34, 1.5), (9.66, 1.5)),
)  # fmt: skip
"""Arrows, from and to."""
RAY, VOXEL, HAND, PLACE = COLORS["hadr"], COLORS["voxel"], COLORS["hand"], "#6f6f6f"
PURPLE = "#8a2f66"
"""The voxels' colour for words, which need more contrast."""
FRAME = 21
"""The frame, of the bundled validation split: a glass that is seen well."""


@dataclass(frozen=True)
class _Example:
    """One frame, what HADR says about it, the ray that is followed, its pairs, and a grasp."""

    frame: Frame
    hole: npt.NDArray[np.float32]
    inputs: HADRInput
    model: HADR
    output: HADROutput
    ray: int
    pairs: npt.NDArray[np.int64]
    restored: npt.NDArray[np.float32]
    tool: Array
    opening: float

    @property
    def chosen(self) -> int:
        """The ray's most probable pair."""
        return int(self.output.chosen[self.ray])

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of a square around the glass."""
        return square_window(self.frame.object_mask)


@cache
def _example() -> _Example:
    frame = open_samples("val")[FRAME]
    hole, mask = erase_mask(frame.depth, frame.object_mask), frame.object_mask
    model, record = load_checkpoint(samples_dir() / "checkpoints" / CHECKPOINT_NAME)
    size = (record["width"], record["height"])
    inputs = frame_to_input(frame.color, hole, mask, frame.keypoints, frame.camera, size)
    with torch.no_grad():
        output = model(inputs)
    ray = _told_apart(output)
    pairs = np.flatnonzero(output.pairs.ray.numpy() == ray)
    given = (frame.color, hole, frame.camera, mask, frame.keypoints)
    restored = restore(*given, "hadr", hand_mask=frame.hand_mask).depth
    points = back_project(restored, frame.camera)[mask & (restored > 0)]
    grasps = sample_grasps(points, np.random.default_rng(0))
    grasps = grasps.select(free_of_hand(grasps, frame.keypoints) & free_of_object(grasps, points))
    wish = Directions(np.array([-1.0, 0, 0]), np.array([0, 1.0, 0]), "camera")  # as seen
    best = int(rescore(grasps, wish).argmax())
    tool = forward_of(grasps.poses[best], PAPER_WAY.forward)
    return _Example(frame, hole, inputs, model, output, ray, pairs, restored, tool,
                    float(grasps.widths[best]))  # fmt: skip


def _told_apart(output: HADROutput) -> int:
    """The ray of most voxels that lie apart when seen from the side, and in all of them long."""
    pairs, best = output.pairs, (0, 0.0, 0)
    for ray in range(pairs.n_rays):
        mine = pairs.ray == ray
        cells = {tuple(cell) for cell in output.occupied.cell[pairs.voxel[mine], 1:].tolist()}
        if cells and len(cells) == int(mine.sum()):
            stay = float((pairs.t_out - pairs.t_in)[mine].min())
            best = max(best, (len(cells), stay, ray))
    return best[2]


def method_diagram(*lit: str) -> Sheet:
    """Draw the diagram, whole or with some of `PARTS` lit.

    Raises:
        ValueError: There is no such part.
    """
    if unknown := set(lit) - set(PARTS):
        raise ValueError(f"no part {sorted(unknown)}; the parts are {', '.join(PARTS)}")
    sheet = Sheet(11.4, 6.0)
    notebooks = (checkout_root() / "notebooks").glob("[0-9][0-9]_*.ipynb")
    numbers = {path.stem[3:]: str(int(path.stem[:2])) for path in notebooks}
    for name, (about, title, box) in PARTS.items():
        sheet.card(box, **({"edge": RAY, "lw": 2.5} if name in lit else {}))  # type: ignore[arg-type]
        left, top = box[0] + 0.14, box[1] + box[3] - 0.21
        label = {"boxstyle": "round,pad=0.25", "fc": INK, "ec": "none"}
        chapters = "–".join(numbers[notebook] for notebook in about)
        chip = sheet.write(left, top, chapters, color="white", weight="bold", bbox=label)
        wide = chip.get_window_extent().width / sheet.figure.dpi
        sheet.write(left + wide + 0.14, top, title, fontsize=FONT + 0.5, weight="bold")
    sheet.card(STRIP)
    for start, end in FLOWS:
        sheet.arrow(start, end)
    example = _example()
    for draw in (_draw_input, _draw_pairs, _draw_features, _draw_strip, _draw_answer, _draw_grasp):
        draw(sheet, example)
    if lit:
        sheet.dim_all_but([PARTS[name][2] for name in lit])
    return sheet


def show_method(*lit: str) -> None:
    """Display `method_diagram` in a notebook."""
    method_diagram(*lit).show()


def _picture(
    sheet: Sheet, box: Box, image: npt.NDArray[np.generic], words: str, **options: Any
) -> Any:
    ax = sheet.inset(box)
    ax.imshow(image, **options)
    bare_axes(ax)
    ax.set_title(words, fontsize=FONT, color=INK, pad=4)
    return ax


def _depth(sheet: Sheet, box: Box, depth: npt.NDArray[np.float32], words: str, e: _Example) -> None:
    """The window of a depth picture in the colours of hand and glass."""
    near = e.frame.depth[e.frame.object_mask | e.frame.hand_mask]
    low, high = np.percentile(near, (1, 99))
    cmap = mpl.colormaps[DEPTH_MAP].with_extremes(bad=MISSING)
    shown = np.ma.masked_less_equal(depth[e.window], 0)
    _picture(sheet, box, shown, words, cmap=cmap, vmin=low - 0.02, vmax=high + 0.05)


def _side(points: npt.ArrayLike) -> Array:
    """Points (..., 3) of the camera frame seen from the side: away from the camera, and up."""
    p = np.asarray(points, dtype=float)
    return np.stack([p[..., 2], -p[..., 1]], axis=-1)


def _scatter(ax: Any, points: Array, colors: Any, size: float) -> None:
    ax.scatter(*_side(points).T, s=size, lw=0, c=colors, rasterized=True)


def _draw_input(sheet: Sheet, e: _Example) -> None:
    left, bottom, _, _ = PARTS["input"][2]
    first, second, third = ((left + 0.12 + 1.73 * k, bottom + 0.12, 1.62, 1.62) for k in range(3))
    color = e.frame.color[e.window]
    _picture(sheet, first, color, "colour")
    _depth(sheet, second, e.hole, "depth with a hole", e)
    hand = _picture(sheet, third, (0.5 * color + 127).astype(np.uint8), "21 keypoints")
    rows, columns = e.window
    show_keypoints(hand, e.frame.keypoints_uv - [columns.start, rows.start], size=9)
    hand.set(xlim=(-0.5, len(color) - 0.5), ylim=(len(color) - 0.5, -0.5))


def _draw_pairs(sheet: Sheet, e: _Example) -> None:
    """One ray from the side, among the measured points beside it."""
    left, bottom, width, _ = PARTS["pairs"][2]
    ax = sheet.inset((left + 0.06, bottom + 0.34, width - 0.12, 1.76))
    occupied, size = e.output.occupied, e.model.config.grid.voxel_size
    voxels = e.output.pairs.voxel[e.pairs]
    centers, columns = occupied.center[voxels].numpy(), occupied.cell[voxels, 0].numpy()
    places = _side(centers)
    low, high = places.min(axis=0) - size, places.max(axis=0) + size
    beside = occupied.center[np.isin(occupied.cell[:, 0].numpy(), columns)].numpy()
    for place in np.unique(_side(beside), axis=0):
        if (place > low).all() and (place < high).all():
            _square(ax, place, size, fc="none", ec="#c4c4c4", lw=0.7)
    points = back_project(e.hole, e.frame.camera)
    away = np.abs(points[..., 0, None] - centers[:, 0]).min(axis=-1)
    near = (e.hole > 0) & (away < size / 2)
    glass = back_project(e.frame.depth, e.frame.camera)[e.frame.object_mask]
    _scatter(ax, glass, [(*mpl.colors.to_rgb(COLORS["glass"]), 0.12)], 1.2)
    _scatter(ax, points[near], e.frame.color[near] / 255, 1.2)
    for k, (pair, place) in enumerate(zip(e.pairs, places, strict=True)):
        _square(ax, place, size, fc=VOXEL, ec="none", alpha=0.5 if pair == e.chosen else 0.2)
        _square(ax, place, size, fc="none", ec=VOXEL, lw=1.6)
        left_top = place + np.array([0.02, -0.02]) + np.array([-size, size]) / 2
        ax.text(*left_top, f"{k + 1}", fontsize=FONT, weight="bold", va="top", color=PURPLE)
    point = e.output.points[e.ray].numpy()
    ax.plot(*np.stack([np.zeros(2), _side(point / point[2] * 2.3)]).T, color=RAY, lw=1.8)
    ax.plot(0, 0, marker=">", ms=11, color=INK)
    ax.text(0.05, -0.04, "camera", fontsize=FONT, color=INK, va="top", ha="center")
    edge = size / 2 + 0.01
    lowest, highest = places[:, 1].min() - edge, places[:, 1].max() + edge
    ax.set(xlim=(-0.06, 2.22), ylim=(lowest, highest), aspect="equal")
    ax.axis("off")
    words = "a pixel's ray, and each voxel with measured points on it: pairs"
    sheet.write(left + 0.14, bottom + 0.17, words)


def _square(ax: Any, middle: Array, size: float, **look: Any) -> None:
    ax.add_patch(Rectangle((middle[0] - size / 2, middle[1] - size / 2), size, size, **look))


def _widths(e: _Example) -> dict[str, int]:
    """How many numbers of a pair come from where."""
    hand, colors = e.model.config.hand_width, 4 * e.model.config.feature_channels
    ray, voxel, pair = e.model.config.parts
    return {"ray": colors, "voxel": voxel - hand, "hand": hand, "place": ray - colors + pair}


def _draw_features(sheet: Sheet, e: _Example) -> None:
    words = {"ray": "colours around it", "voxel": "points in it", "hand": "to wrist and voxel"}
    axes = {}
    for name, color in (("ray", RAY), ("voxel", VOXEL), ("hand", HAND)):
        left, bottom, width, _ = PARTS[name][2]
        axes[name] = ax = sheet.inset((left + 0.3, bottom + 0.52, 1.08, 1.08))
        ax.set(xticks=[], yticks=[])
        ax.spines[:].set(visible=True, color=color, lw=1.6)
        middle, dark = left + width / 2, PURPLE if name == "voxel" else color
        sheet.write(middle, bottom + 0.34, words[name], ha="center")
        number = f"{_widths(e)[name]} numbers"
        sheet.write(middle, bottom + 0.14, number, ha="center", color=dark, weight="bold")
    u, v = project(e.output.points[e.ray].numpy(), e.frame.camera)
    axes["ray"].imshow(e.frame.color)
    axes["ray"].set(xlim=(u - 4, u + 4), ylim=(v + 4, v - 4))
    axes["ray"].axhline(v, color="white", lw=1)
    axes["ray"].axvline(u, color="white", lw=1)
    axes["ray"].plot(u, v, "o", color=RAY, mec="white", ms=7)
    size, keypoints = e.model.config.grid.voxel_size, _side(e.frame.keypoints)
    center = e.output.occupied.center[e.output.pairs.voxel[e.chosen]].numpy()
    points = back_project(e.hole, e.frame.camera)
    inside = (np.abs(points - center) < size / 2).all(axis=2)
    _scatter(axes["voxel"], points[inside], e.frame.color[inside] / 255, 2)
    ends = np.stack([keypoints, np.broadcast_to(_side(center), (21, 2))], axis=1)
    axes["hand"].plot(*ends.T, color=VOXEL, lw=0.7)
    show_keypoints(axes["hand"], keypoints, size=7)
    axes["hand"].plot(*_side(center), "s", color=VOXEL, mec=INK, ms=8, zorder=4)
    seen = np.vstack([keypoints, _side(center)])
    middle, half = (seen.min(axis=0) + seen.max(axis=0)) / 2, 0.58 * np.ptp(seen, axis=0).max()
    for name, (z, up), reach in (("voxel", _side(center), 0.54 * size), ("hand", middle, half)):
        axes[name].set(xlim=(z - reach, z + reach), ylim=(up - reach, up + reach))


def _draw_strip(sheet: Sheet, e: _Example) -> None:
    """The numbers of one pair, each part as wide as it is long."""
    left, bottom, width, _ = STRIP
    at, total = left + 0.14, sum(_widths(e).values())
    colors = {"ray": RAY, "voxel": VOXEL, "hand": HAND, "place": PLACE}
    for name, count in _widths(e).items():
        wide = count / total * (width - 0.28)
        bar = Rectangle((at, bottom + 0.3), wide, 0.24, fc=colors[name], ec="white", lw=1)
        sheet.page.add_patch(bar)
        ink = INK if name == "voxel" else "white"
        middle = at + wide / 2
        sheet.write(middle, bottom + 0.415, f"{name} {count}", color=ink, ha="center",
                    weight="bold")  # fmt: skip
        at += wide
    sheet.write(left + 0.14, bottom + 0.68, f"one pair = {total} numbers", weight="bold")
    sheet.write(left + 0.14, bottom + 0.15, "two decoders read them, pair by pair")


def _draw_answer(sheet: Sheet, e: _Example) -> None:
    left, bottom, _, _ = PARTS["answer"][2]
    shares = e.output.probability[e.pairs].numpy()
    sheet.write(left + 0.14, bottom + 2.54, "in which voxel does it end?")
    ax = sheet.inset((left + 0.36, bottom + 1.32, 0.98, 1.08))
    ax.barh(range(len(shares)), 1, color="#e4e4e2", height=0.66)
    ax.barh(range(len(shares)), shares, color=VOXEL, height=0.66)
    for row, share in enumerate(shares):
        ax.text(-0.06, row, f"{row + 1}", ha="right", va="center", fontsize=FONT, color=PURPLE,
                weight="bold")  # fmt: skip
        ax.text(1.04, row, f"{share:.2f}", va="center", fontsize=FONT - 0.5, color=INK)
    ax.set(xlim=(0, 1), ylim=(len(shares) - 0.5, -0.5))
    ax.axis("off")
    pairs = e.output.pairs
    enter, leave = float(pairs.t_in[e.chosen]), float(pairs.t_out[e.chosen])
    reached = float(e.output.points[e.ray].norm())
    sheet.write(left + 0.14, bottom + 1.12, "how far inside?")
    ax = sheet.inset((left + 0.36, bottom + 0.42, 0.98, 0.56))
    ax.add_patch(Rectangle((enter, 0), leave - enter, 1, fc=VOXEL, alpha=0.5, lw=0))
    ax.plot([enter - 0.05, reached], [0.5, 0.5], color=RAY, lw=2.2)
    ax.plot(reached, 0.5, "o", color=RAY, ms=8)
    ax.set(xlim=(enter - 0.05, leave + 0.02), ylim=(0, 1))
    ax.axis("off")
    start, end = round(100 * enter), round(100 * reached)
    words = f"{start} + {end - start} = {end} cm"
    sheet.write(left + 0.14, bottom + 0.2, words, color=RAY, weight="bold")
    box = (left + 1.92, bottom + 0.5, 1.64, 1.64)
    _depth(sheet, box, e.restored, "restored depth", e)


def _draw_grasp(sheet: Sheet, e: _Example) -> None:
    left, bottom, _, _ = PARTS["grasp"][2]
    box = (left + 0.04, bottom + 0.5, 1.64, 1.64)
    ax = _picture(sheet, box, e.frame.color, "where to take it")
    lines = project(fork(e.opening) @ e.tool[:3, :3].T + e.tool[:3, 3], e.frame.camera)
    for wide, color in ((6.5, "white"), (4.0, COLORS["robot"])):
        for line in lines:
            ax.plot(*line.T, color=color, lw=wide, solid_capstyle="round")
    rows, columns = e.window
    shift = max(0.0, float(lines[..., 0].max()) + 6 - columns.stop)
    ax.set(xlim=(columns.start + shift, columns.stop + shift), ylim=(rows.stop, rows.start))
