"""`hadr restore`: read one frame's files, restore its depth, write the result's files."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from hadr.camera import BoolArray, Intrinsics
    from hadr.restoration import Restoration

DESCRIPTION = """\
Restore the depth of a transparent object in one RGB-D frame.

A depth camera sees through glass: inside a glass the depth is missing, or it
is the depth of what stands behind. This command replaces the depth inside the
object's mask and leaves every other pixel as it was measured."""

EPILOG = """\
units and frames
  Depth is z-depth (not the distance along the ray) in metres, 0 or NaN where
  missing. Points are in the camera frame: x right, y down, z forward. Colour
  and depth must be aligned and of one size; the intrinsics are of that size.

methods
  auto         the checkpoint's network where it fits the input, else nearest;
               the output says which one it was and why
  hadr         a network of this kind, or an error that says why no checkpoint
  hadr-plus    fits
  unet-hand
  lidf, dfnet, swindrnet, tode
               the same, for the systems that the paper compares with
  nearest      depth of the nearest measured pixel outside the mask
  inpaint      OpenCV's inpainting (Telea)
  hand-median  one depth for the whole object: the median of the hand's pixels

what is written
  depth.png         16-bit, 1 mm per unit, 0 = missing (reads back with the
                    default --depth-scale)
  depth.npy         float32 metres, 0 = missing
  confidence.png    8-bit, 255 = 1
  confidence.npy    float32: 1 where measured, 0 where missing; where restored
                    the probability that the depth is right to 2 cm, if the
                    checkpoint is calibrated, else the network's own score;
                    0, not known, for nearest, inpaint and hand-median
  comparison.png    colour, depth before and after, error or confidence
  cloud.ply         coloured point cloud, metres, camera frame, binary
  mask.png          8-bit, 255 = pixels to restore, given or predicted
  report.json       method, notes, counts, versions, inputs' SHA-256, times
  A pixel that a network can't know (no candidate, or a depth outside of what it
  learned) stays missing, 0 in depth.*; it is never a depth of zero metres.
  The folder appears complete or not at all.

examples
  A RealSense frame, depth PNG in millimetres:
    hadr restore --rgb rgb.png --depth depth.png --intrinsics camera.yaml \\
        --mask glass.png --out restored
  The same with a hand, so that HADR can be used:
    hadr restore --rgb rgb.png --depth depth.npy --intrinsics camera.json \\
        --mask glass.png --hand hand.json --out restored
  Compare with a known depth and print the errors:
    hadr restore --rgb rgb.jpg --depth depth.exr --intrinsics camera.yaml \\
        --mask glass.png --truth opaque.exr --out restored

exit status
  0 done   1 the result could not be written   2 unusable input"""

INPUT_NAMES = (
    "rgb",
    "depth",
    "intrinsics",
    "mask",
    "hand",
    "hand_mask",
    "truth",
    "checkpoint",
    "segmentation",
    "keypoint_network",
)
METHODS = (
    "auto",
    "hadr",
    "hadr-plus",
    "unet-hand",
    "lidf",
    "dfnet",
    "swindrnet",
    "tode",
    "nearest",
    "inpaint",
    "hand-median",
)
OUTPUTS = {
    "depth.png": "z-depth, 16-bit, 0.001 m per unit, 0 = missing",
    "depth.npy": "z-depth, float32 metres, 0 = missing",
    "confidence.png": "8-bit, 255 = 1",
    "confidence.npy": "float32: 1 measured, 0 missing; restored: see confidence_means",
    "comparison.png": "picture of colour, depth before and after, and error or confidence",
    "mask.png": "pixels to restore, 8-bit, 255 = restore",
    "cloud.ply": "coloured points, metres, camera frame (x right, y down, z forward), binary",
    "report.json": "this report",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and its arguments."""
    parser.description, parser.epilog = DESCRIPTION, EPILOG
    needed = parser.add_argument_group("input")
    needed.add_argument("--rgb", required=True, metavar="FILE", help="colour image, PNG or JPEG")
    needed.add_argument(
        "--depth",
        required=True,
        metavar="FILE",
        help="depth: 16-bit PNG, .npy (H, W) or OpenEXR",
    )
    needed.add_argument(
        "--depth-scale",
        type=float,
        metavar="M",
        help="metres per stored unit (default: 0.001 for whole numbers, 1 for floats)",
    )
    needed.add_argument(
        "--intrinsics",
        required=True,
        metavar="FILE",
        help="YAML or JSON: fx fy cx cy in pixels and width height (or xres yres), or K",
    )
    needed.add_argument(
        "--mask",
        metavar="FILE",
        help="the transparent object's pixels, 8-bit PNG, not 0 = object; without it they are "
        "predicted (--segmentation), or the pixels that have no depth are restored",
    )
    needed.add_argument(
        "--hand",
        metavar="FILE",
        help="21 hand keypoints, metres, camera frame: JSON list of [x, y, z], text with 21 lines "
        "'x y z', or .npy (21, 3); wrist, then thumb to little finger, root to tip",
    )
    needed.add_argument(
        "--hand-mask", metavar="FILE", help="pixels of hand and arm, sharpens hand-median"
    )
    chosen = parser.add_argument_group("method")
    chosen.add_argument(
        "--method",
        default="auto",
        choices=METHODS,
        metavar="METHOD",
        help="how to restore, see below (default: auto)",
    )
    chosen.add_argument(
        "--checkpoint",
        metavar="FILE",
        help="a depth network, .safetensors (default: the sample's HADR)",
    )
    chosen.add_argument(
        "--segmentation", metavar="FILE", help="a segmentation network: predicts mask, hand mask"
    )
    chosen.add_argument(
        "--keypoint-network", metavar="FILE", help="a hand-keypoint network: predicts the hand"
    )
    chosen.add_argument(
        "--corruption",
        choices=("oracle", "sensor"),
        help="depth measured inside the mask: oracle discards it, sensor gives it to the network "
        "(default: as the checkpoint was trained)",
    )
    written = parser.add_argument_group("output")
    written.add_argument("--out", required=True, metavar="DIR", help="folder for the result")
    written.add_argument(
        "--overwrite",
        action="store_true",
        help="replace an earlier result in DIR (a folder with other files is never replaced)",
    )
    written.add_argument(
        "--truth",
        metavar="FILE",
        help="true depth, a file like --depth's; prints the errors inside the mask",
    )
    written.add_argument("--quiet", action="store_true", help="print nothing but errors")


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Args:
        arguments: What `add_arguments` describes.

    Returns:
        Exit status: 0 done, 1 not written.

    Raises:
        ValueError: Unusable input, in one sentence.
        OSError: A file that does not exist, or a folder that is not to be replaced.
    """
    from hadr.camera import load_intrinsics
    from hadr.frame_io import (
        check_replaceable,
        finished_folder,
        read_color,
        read_depth,
        read_hand,
        read_mask,
    )
    from hadr.press.restore_report import (
        METHOD_TITLES,
        confidence_means,
        counts,
        errors,
        inputs,
        summary,
        versions,
    )
    from hadr.restoration import restore

    started = time.perf_counter()
    replaceable = tuple(OUTPUTS) if arguments.overwrite else None
    check_replaceable(Path(arguments.out), replaceable)
    color = read_color(arguments.rgb)
    depth = read_depth(arguments.depth, arguments.depth_scale)
    camera = load_intrinsics(arguments.intrinsics)
    mask = None if arguments.mask is None else read_mask(arguments.mask)
    hand = None if arguments.hand is None else read_hand(arguments.hand)
    arm = None if arguments.hand_mask is None else read_mask(arguments.hand_mask, "hand mask")
    truth = None if arguments.truth is None else _read_truth(arguments)
    if truth is not None and truth.shape != depth.shape:
        raise ValueError(f"truth is {truth.shape} but depth is {depth.shape}, expected the same")
    read = time.perf_counter()
    result = restore(
        color,
        depth,
        camera,
        mask,
        hand,
        arguments.method,
        arguments.checkpoint,
        arm,
        corruption=arguments.corruption,
        segmentation=arguments.segmentation,
        keypoint_network=arguments.keypoint_network,
    )
    restored = time.perf_counter()
    target = result.mask
    measured_errors = {} if truth is None else errors(depth, result.depth, truth, target)
    report: dict[str, Any] = {
        "command": "hadr restore",
        "method": result.method,
        "method_title": METHOD_TITLES[result.method],
        "notes": list(result.notes),
        "confidence_means": confidence_means(result),
        "image": {"width": camera.width, "height": camera.height},
        "intrinsics": camera.to_dict(),
        "counts": counts(depth, result, target),
        "errors_in_mask": measured_errors,
        "inputs": inputs({name: getattr(arguments, name) for name in INPUT_NAMES}),
        "outputs": OUTPUTS,
        "versions": versions(),
    }
    try:
        with finished_folder(arguments.out, replaceable) as folder:
            _write(folder, color, depth, camera, result, target, truth)
            finished = time.perf_counter()
            report["seconds"] = {
                "read": round(read - started, 3),
                "restore": round(restored - read, 3),
                "write": round(finished - restored, 3),
            }
            text = json.dumps(report, indent=2, allow_nan=False)
            (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    except FileExistsError:
        raise
    except OSError as error:
        print(f"hadr restore: error: cannot write {arguments.out}: {error}", file=sys.stderr)
        return 1
    if not arguments.quiet:
        print(summary(report, arguments.out))
    return 0


def _write(
    folder: Path,
    color: NDArray[np.uint8],
    depth: NDArray[np.float32],
    camera: Intrinsics,
    result: Restoration,
    target: BoolArray,
    truth: NDArray[np.float32] | None,
) -> None:
    import numpy as np

    from hadr.frame_io import write_depth_png, write_image, write_point_cloud
    from hadr.press.restore_report import comparison_figure

    write_depth_png(folder / "depth.png", result.depth)
    np.save(folder / "depth.npy", result.depth)
    write_image(folder / "confidence.png", np.rint(result.confidence * 255).astype(np.uint8))
    np.save(folder / "confidence.npy", result.confidence)
    write_image(folder / "mask.png", target.astype(np.uint8) * 255)
    write_point_cloud(folder / "cloud.ply", result.depth, color, camera)
    comparison_figure(color, depth, result, target, truth).savefig(
        folder / "comparison.png", dpi=130
    )


def _read_truth(arguments: argparse.Namespace) -> NDArray[np.float32]:
    """Read the truth, with the depth's scale where it is stored in the same format."""
    from hadr.frame_io import read_depth

    alike = Path(arguments.truth).suffix.lower() == Path(arguments.depth).suffix.lower()
    try:
        return read_depth(arguments.truth, arguments.depth_scale if alike else None)
    except (ValueError, FileNotFoundError) as error:
        raise type(error)(f"truth: {error}") from error
