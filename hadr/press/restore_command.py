"""`hadr restore`: read one frame's files, restore its depth, write the result's files."""

from __future__ import annotations

import json
import sys
import textwrap
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tyro
from numpy.typing import NDArray

from hadr.camera import Intrinsics, load_intrinsics
from hadr.corruption import Corruption
from hadr.frame_io import (
    check_replaceable,
    finished_folder,
    read_color,
    read_depth,
    read_hand,
    read_mask,
    write_depth_png,
    write_image,
    write_point_cloud,
)
from hadr.models.networks import RIVALS
from hadr.restoration import METHODS, Restoration, Restorer

if TYPE_CHECKING:
    Method = str
else:
    Method = tyro.extras.literal_type_from_choices(METHODS)

OUTPUTS = {
    "depth.png": "z-depth, 16-bit, 0.001 m per unit, 0 = missing (reads back with the default "
    "--depth-scale)",
    "depth.npy": "z-depth, float32 metres, 0 = missing",
    "confidence.png": "8-bit, 255 = 1",
    "confidence.npy": "float32: 1 where measured, 0 where missing; where restored the probability "
    "that the depth is right to 2 cm, if the method is a calibrated hadr-plus; 0, not known, for "
    "all others, which cannot say how sure they are",
    "comparison.png": "colour, depth before and after, error or confidence",
    "mask.png": "pixels to restore, given or predicted, 8-bit, 255 = restore",
    "cloud.ply": "coloured points, metres, camera frame (x right, y down, z forward), binary",
    "report.json": "method, notes, counts, errors, versions, inputs' SHA-256, times",
}
"""The files that are written, and what they hold."""
_WRITTEN = "\n".join(
    textwrap.fill(text, 79, initial_indent=f"  {name:<16}  ", subsequent_indent=20 * " ")
    for name, text in OUTPUTS.items()
)
EPILOG = f"""\
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
  {", ".join(RIVALS)}
               the same, for the systems that the paper compares with
  nearest      depth of the nearest measured pixel outside the mask
  inpaint      OpenCV's inpainting (Telea)
  hand-median  one depth for the whole object: the median of the hand's pixels

what is written
{_WRITTEN}
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

INPUTS = (
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
"""The options that name a file to read."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Restore the depth of a transparent object in one RGB-D frame.

    A depth camera sees through glass: inside a glass the depth is missing, or it
    is the depth of what stands behind. This command replaces the depth inside the
    object's mask and leaves every other pixel as it was measured.
    """

    rgb: str
    """colour image, PNG or JPEG"""
    depth: str
    """depth: 16-bit PNG, .npy (H, W) or OpenEXR"""
    depth_scale: float | None = None
    """metres per stored unit; unset: 0.001 for whole numbers, 1 for floats"""
    intrinsics: str
    """YAML or JSON: fx fy cx cy in pixels and width height (or xres yres), or K"""
    mask: str | None = None
    """the transparent object's pixels, 8-bit PNG, not 0 = object; without it they are predicted
    (--segmentation), or the pixels that have no depth are restored"""
    hand: str | None = None
    """21 hand keypoints, metres, camera frame: JSON list of [x, y, z], text with 21 lines 'x y z',
    or .npy (21, 3); wrist, then thumb to little finger, root to tip"""
    hand_mask: str | None = None
    """pixels of hand and arm, sharpens hand-median"""
    method: Method = "auto"
    """how to restore, see below"""
    checkpoint: str | None = None
    """a depth network, .safetensors; unset: the sample's HADR"""
    segmentation: str | None = None
    """a segmentation network: predicts mask, hand mask"""
    keypoint_network: str | None = None
    """a hand-keypoint network: predicts the hand"""
    corruption: Corruption | None = None
    """depth measured inside the mask: oracle and erased discard it, sensor and analytic give it to
    the network; unset: as the checkpoint was trained"""
    out: str
    """folder for the result"""
    overwrite: bool = False
    """replace an earlier result in the folder (one with other files is never replaced)"""
    truth: str | None = None
    """true depth, a file like --depth's; prints the errors inside the mask"""
    quiet: bool = False
    """print nothing but errors"""


def run(options: Options) -> int:
    """Run the command.

    Raises:
        ValueError: Unusable input, in one sentence.
        OSError: A file that does not exist, or a folder that is not to be replaced.
    """
    from hadr.press import restore_report  # loads matplotlib, which --help need not wait for

    started = time.perf_counter()
    replaceable = tuple(OUTPUTS) if options.overwrite else None
    check_replaceable(Path(options.out), replaceable)
    color = read_color(options.rgb)
    depth = read_depth(options.depth, options.depth_scale)
    camera = load_intrinsics(options.intrinsics)
    mask = None if options.mask is None else read_mask(options.mask)
    hand = None if options.hand is None else read_hand(options.hand)
    arm = None if options.hand_mask is None else read_mask(options.hand_mask, "hand mask")
    truth = _read_truth(options, depth.shape)
    read = time.perf_counter()
    restorer = Restorer(
        options.method,
        options.checkpoint,
        corruption=options.corruption,
        segmentation=options.segmentation,
        keypoint_network=options.keypoint_network,
    )
    result = restorer(color, depth, camera, mask, hand, arm)
    restored = time.perf_counter()
    files = {name: getattr(options, name) for name in INPUTS}
    report = restore_report.report(depth, camera, result, truth, files, OUTPUTS)
    try:
        with finished_folder(options.out, replaceable) as folder:
            _write(folder, color, camera, result)
            figure = restore_report.comparison_figure(color, depth, result, truth)
            figure.savefig(folder / "comparison.png", dpi=130)
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
        print(f"hadr restore: error: cannot write {options.out}: {error}", file=sys.stderr)
        return 1
    if not options.quiet:
        print(restore_report.summary(report, options.out))
    return 0


def _write(folder: Path, color: NDArray[np.uint8], camera: Intrinsics, result: Restoration) -> None:
    """Write what the result holds; the picture and the report come from elsewhere."""
    write_depth_png(folder / "depth.png", result.depth)
    np.save(folder / "depth.npy", result.depth)
    write_image(folder / "confidence.png", np.rint(result.confidence * 255).astype(np.uint8))
    np.save(folder / "confidence.npy", result.confidence)
    write_image(folder / "mask.png", result.mask.astype(np.uint8) * 255)
    write_point_cloud(folder / "cloud.ply", result.depth, color, camera)


def _read_truth(options: Options, shape: tuple[int, ...]) -> NDArray[np.float32] | None:
    """Read the truth, with the depth's scale where it is stored in the same format."""
    if options.truth is None:
        return None
    alike = Path(options.truth).suffix.lower() == Path(options.depth).suffix.lower()
    try:
        truth = read_depth(options.truth, options.depth_scale if alike else None)
    except (ValueError, FileNotFoundError) as error:
        raise type(error)(f"truth: {error}") from error
    if truth.shape != shape:
        raise ValueError(f"truth is {truth.shape} but depth is {shape}, expected the same")
    return truth
