"""Draw the book's first picture: one bundled frame, restored by the shipped method.

Run it with ``make readme-figure``; it writes ``book/images/restored_frame.png``.
"""

import argparse
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")

import matplotlib.pyplot as plt
import numpy as np

from hadr.data.samples import open_samples
from hadr.figures import panels
from hadr.figures.depth.restored_glass import draw_cloud, restored_clouds
from hadr.metrics import frame_metrics
from hadr.restoration import restore

NETWORKS = {"HADR": "hadr", "HADR-plus": "hadr-plus"}


def crop_around(mask: np.ndarray, shape: tuple[int, int], margin: float = 1.1) -> tuple[slice, ...]:
    """Rows and columns of a 4:3 window around a mask, inside the image."""
    rows, columns = np.nonzero(mask)
    height = min(int(margin * max(np.ptp(rows), 0.75 * np.ptp(columns))) + 1, shape[0])
    width = min(int(height * 4 / 3), shape[1])
    middle_row, middle_column = (rows.min() + rows.max()) // 2, (columns.min() + columns.max()) // 2
    top = int(np.clip(middle_row - height // 2, 0, shape[0] - height))
    left = int(np.clip(middle_column - width // 2, 0, shape[1] - width))
    return slice(top, top + height), slice(left, left + width)


def main() -> None:
    """Restore one test frame and draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    here = Path(__file__).resolve().parent
    parser.add_argument("--frame", type=int, default=42, help="number of the test frame (42)")
    parser.add_argument("--out", type=Path, default=here / "images" / "restored_frame.png")
    args = parser.parse_args()

    frame = open_samples("test")[args.frame]
    if frame.raw_depth is None:
        raise SystemExit(f"frame {frame.stem} has no raw depth: generate it with --sensor")
    depth = frame.raw_depth
    done = {
        title: restore(
            frame.color,
            depth,
            frame.camera,
            frame.object_mask,
            frame.keypoints,
            hand_mask=frame.hand_mask,
            method=method,
        )
        for title, method in NETWORKS.items()
    }
    window = crop_around(frame.object_mask, frame.depth.shape, margin=1.8)
    near, far = np.percentile(frame.depth[frame.object_mask | frame.hand_mask], (1, 99))
    limits = {"vmin": float(near) - 0.05, "vmax": float(far) + 0.1}

    panels.use_style()
    fig, axes = plt.subplots(2, 3, figsize=(9.6, 5.0))
    panels.show_color(axes[0, 0], frame.color[window], "what the camera sees")
    panels.show_depth(axes[0, 1], depth[window], "its depth (simulated)", colorbar=False, **limits)
    for ax, (title, result) in zip(axes.flat[2:], done.items(), strict=False):
        scored = frame_metrics(result.depth, frame.depth, frame.object_mask)
        text = f"{title}: RMSE {100 * scored.rmse_m:.1f} cm"
        panels.show_depth(ax, result.depth[window], text, colorbar=ax is axes[0, 2], **limits)
    title, best = list(done)[-1], list(done.values())[-1].depth
    (cloud,) = restored_clouds(frame, {title: best})
    draw_cloud(axes[1, 1], cloud, f"{title}, from the side")
    wide = 100 * cloud.radius
    axes[1, 1].set(xlim=(-4 / 3 * wide, 4 / 3 * wide), ylim=(-wide, wide))
    error = np.where(frame.object_mask & (best > 0), best - frame.depth, np.nan)
    panels.show_error(axes[1, 2], error[window], f"error of {title}")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(args.out, dpi=140)
    print(f"{args.out}: frame {frame.object_id}/{frame.stem}")
    for title, result in done.items():
        for note in result.notes:
            print(f"  {title}: {note}")


if __name__ == "__main__":
    main()
