"""`hadr restore`: read a frame's files, restore its depth, write the result's files."""

from __future__ import annotations

import sys
import textwrap
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro
from numpy.typing import NDArray

from hadr.camera import Intrinsics, valid_depth
from hadr.camera_file import load_intrinsics
from hadr.corruption import Corruption
from hadr.data.frame_pictures import encode_depth_array
from hadr.frame_checks import checked_metres
from hadr.frame_io import (
    read_color,
    read_depth,
    read_hand,
    read_mask,
    write_depth_png,
    write_image,
    write_point_cloud,
)
from hadr.models.networks import RIVALS
from hadr.records.caches import file_sha256
from hadr.records.option_words import FILE, FOLDER
from hadr.records.output_folder import VIEW, check_apart, check_replaceable
from hadr.records.provenance import write_json
from hadr.records.result_file import seal_row
from hadr.records.writing import whole_folder
from hadr.restoration import METHODS, Restoration, Restorer

if TYPE_CHECKING:
    from hadr.models.hand.mediapipe_hand import MediaPipeHand

    Method = str
else:
    Method = tyro.extras.literal_type_from_choices(METHODS)

OUTPUTS = {
    "depth.png": "z-depth, 16-bit, 0.001 m per unit, 0 = missing (reads back with the default "
    "--depth-scale)",
    "depth.npy": "z-depth, float32 metres, 0 = missing",
    "confidence.png": "8-bit, 255 = 1",
    "confidence.npy": "float32: 1 where measured, 0 where missing; where restored the probability "
    "that the depth is right to 2 cm, if the method is a calibrated hadr-plus and the frame like "
    "those it learned from; the own score of a hadr-plus that was never calibrated, which only "
    "orders pixels; else 0, not known",
    "comparison.png": "colour with mask and hand, depth before and after, error or confidence",
    "mask.png": "pixels to restore, given or predicted, 8-bit, 255 = restore",
    "hand_mask.png": "pixels of hand and arm, given or predicted, if any are known; 8-bit, 255 = "
    "hand",
    "hand.json": "the hand that was given or found, if any: 21 keypoints, metres, camera frame, "
    "where they are from, whether they were accepted, and what does not fit (reads back with "
    "--hand)",
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

a folder of frames
  Where --rgb is a folder, so are --depth and, where given, --mask, --hand,
  --hand-mask and --truth, and files of one frame have one name (rgb/0007.jpg,
  depth/0007.png). Each frame gets a folder with all files below; beside them
  stand a film of the comparisons and sequence.json, which says of every frame
  how it was restored, or why it was refused.

what is written
{_WRITTEN}
  A pixel that a network can't know (no candidate, or a depth outside of what it
  learned) stays missing, 0 in depth.*; it is never a depth of zero metres.
  hadr-plus keeps such a depth, without probability.
  The folder appears complete or not at all. 'hadr view FOLDER' turns its cloud
  in the browser.

the hand
  Networks need it to know where the glass is. A hand that is found (--hand
  mediapipe, --keypoint-network) is accepted only if it is of a human's size, at
  the glass, and where something was measured; else there is "no hand found",
  and the notes say why. A hand that is given is always used; where it does not
  fit, the notes say by how much, and no probability is stated.

examples
  A RealSense frame, depth PNG in millimetres, with a hand, which HADR needs:
    hadr restore --rgb rgb.png --depth depth.png --intrinsics camera.yaml \\
        --mask glass.png --hand hand.json --out restored
  The same, with MediaPipe finding the hand in the colour:
    pip install 'hadr[mediapipe]'
    hadr hand-model --out hand_landmarker.task
    hadr restore --rgb rgb.png --depth depth.png --intrinsics camera.yaml \\
        --mask glass.png --hand mediapipe --hand-model hand_landmarker.task \\
        --out restored
  A recorded sequence, with its film:
    hadr restore --rgb color --depth depth --intrinsics camera.yaml \\
        --mask mask --hand hand --out restored
  Compare with a known depth and print the errors:
    hadr restore --rgb rgb.jpg --depth depth.exr --intrinsics camera.yaml \\
        --mask glass.png --hand hand.json --truth opaque.exr --out restored

exit status
  0 done   1 nothing could be restored in a frame, or one of a folder was
  refused (the result says why), or the disk is full   2 unusable input"""

MEDIAPIPE = "mediapipe"
"""What `hand` says to have MediaPipe find it; a file of that name is ./mediapipe."""
INPUTS = (
    "rgb", "depth", "intrinsics", "mask", "hand", "hand_model", "hand_mask", "truth", "checkpoint",
    "segmentation", "keypoint_network",
)  # fmt: skip
"""The options that name a file to read."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Restore the depth of a transparent object in an RGB-D frame, or in a folder of them.

    A depth camera sees through glass: inside a glass the depth is missing, or it
    is the depth of what stands behind. This command replaces the depth inside the
    object's mask and leaves every other pixel as it was measured.
    """

    rgb: Annotated[str, FILE]
    """colour image, PNG or JPEG, stored upright (no EXIF orientation); or a folder of them"""
    depth: Annotated[str, FILE]
    """depth: 16-bit PNG, .npy (H, W) or OpenEXR"""
    depth_scale: float | None = None
    """metres per stored unit; unset: 0.001 for whole numbers, 1 for floats"""
    intrinsics: Annotated[str, FILE]
    """YAML or JSON: fx fy cx cy in pixels and width height (or xres yres), or K; what ROS prints of
    camera_info or its camera_calibration writes; OpenCV's FileStorage. The lens may not distort"""
    mask: Annotated[str | None, FILE] = None
    """the transparent object's pixels, 8-bit PNG, not 0 = object; without it they are predicted
    (--segmentation), or the pixels that have no depth are restored"""
    hand: Annotated[str | None, FILE] = None
    """21 hand keypoints, metres, camera frame: JSON list of [x, y, z], text with 21 lines 'x y z',
    or .npy (21, 3); wrist, then thumb to little finger, root to tip; or the word mediapipe, which
    has MediaPipe find them in the colour (--hand-model)"""
    hand_model: Annotated[str | None, FILE] = None
    """MediaPipe's model, which 'hadr hand-model' makes"""
    hand_mask: Annotated[str | None, FILE] = None
    """pixels of hand and arm, sharpens hand-median"""
    method: Method = "auto"
    """how to restore, see below"""
    checkpoint: Annotated[str | None, FILE] = None
    """a depth network, .safetensors; unset: the bundled one of hadr or hadr-plus"""
    segmentation: Annotated[str | None, FILE] = None
    """a segmentation network: predicts mask, hand mask"""
    keypoint_network: Annotated[str | None, FILE] = None
    """a hand-keypoint network: predicts the hand in computed pictures, for which it is trained; for
    photographs take --hand mediapipe"""
    corruption: Corruption | None = None
    """depth measured inside the mask: oracle and erased discard it, sensor and analytic give it to
    the network; unset: as the checkpoint was trained"""
    out: Annotated[str, FOLDER]
    """folder for the result"""
    overwrite: bool = False
    """replace an earlier result in the folder (one with other files is never replaced)"""
    truth: Annotated[str | None, FILE] = None
    """true depth, a file like --depth's; prints the errors inside the mask"""
    quiet: bool = False
    """print nothing but errors"""


@dataclass(frozen=True)
class Made:
    """A restored frame, with what was read for it, the files by option, and how long that took."""

    color: NDArray[np.uint8]
    depth: NDArray[np.float32]
    camera: Intrinsics
    truth: NDArray[np.float32] | None
    files: dict[str, str | None]
    result: Restoration
    seconds: dict[str, float]


def run(options: Options) -> int:
    """Run the command: 1 where nothing could be restored; an error names unusable input."""
    if Path(options.rgb).is_dir():
        from hadr.press.own_frames.restore_sequence import run_sequence

        return run_sequence(options)
    # It loads matplotlib, for which --help need not wait.
    from hadr.press.own_frames.restore_report import summary

    files = input_files(options)
    check_names(*filter(None, files.values()), options.out)

    def check() -> None:
        read, out = filter(None, files.values()), Path(options.out)
        again = options.overwrite
        check_apart(out)
        check_replaceable(out, again, "report.json", read, [VIEW], command="hadr restore")

    check()
    with restorer_of(options) as restorer:
        made = restored_frame(options, restorer)
    with whole_folder(Path(options.out), "hadr restore", check) as folder:
        report = write_frame(folder, made)
    if not options.quiet:
        print(summary(report, options.out))
    if found_nothing(made.result):
        print(
            "hadr restore: error: nothing could be restored: all "
            f"{int(made.result.mask.sum())} pixels of the mask stay missing; the notes in "
            f"{options.out}/report.json say why",
            file=sys.stderr,
        )
        return 1
    return 0


def check_names(*names: str) -> None:
    """Refuse names that no record can hold, since they are no UTF-8."""
    for name in names:
        try:
            name.encode()
        except UnicodeEncodeError:
            raise ValueError(f"rename {name!a}: its name can't be written down") from None


def found_nothing(result: Restoration) -> bool:
    """Whether there was something to restore, and none of it was."""
    return bool(result.mask.any()) and not valid_depth(result.depth[result.mask]).any()


def input_files(options: Options) -> dict[str, str | None]:
    """What is read, by option."""
    files = {name: getattr(options, name) for name in INPUTS}
    if options.hand == MEDIAPIPE:
        files["hand"] = None
    return files


def restored_frame(options: Options, restorer: Restorer) -> Made:
    """Read one frame and restore it; errors as `run`."""
    started = time.perf_counter()
    color = read_color(options.rgb)
    depth = read_depth(options.depth, options.depth_scale)
    camera = load_intrinsics(options.intrinsics)
    mask = None if options.mask is None else read_mask(options.mask)
    files = input_files(options)
    hand = None if files["hand"] is None else read_hand(files["hand"])
    arm = None if options.hand_mask is None else read_mask(options.hand_mask, "hand mask")
    truth = _read_truth(options, depth.shape)
    read = time.perf_counter()
    result = restorer(color, depth, camera, mask, hand, arm)
    seconds = {"read": read - started, "restore": time.perf_counter() - read}
    return Made(color, depth, camera, truth, files, result, seconds)


def write_frame(folder: Path, made: Made) -> dict[str, Any]:
    """Write a result's files into an empty folder: the report that stands in one of them."""
    from hadr.press.own_frames import restore_report

    started, result = time.perf_counter(), made.result
    report = restore_report.report(made)
    write_depth_png(folder / "depth.png", result.depth)
    (folder / "depth.npy").write_bytes(encode_depth_array(result.depth))
    write_image(folder / "confidence.png", np.rint(result.confidence * 255).astype(np.uint8))
    (folder / "confidence.npy").write_bytes(encode_depth_array(result.confidence))
    write_image(folder / "mask.png", result.mask.astype(np.uint8) * 255)
    if result.hand_mask is not None:
        write_image(folder / "hand_mask.png", result.hand_mask.astype(np.uint8) * 255)
    if result.hand is not None:
        keypoints = result.hand.keypoints.tolist()
        write_json(folder / "hand.json", {"keypoints": keypoints, **report["hand"]})
    write_point_cloud(folder / "cloud.ply", result.depth, made.color, made.camera)
    restore_report.write_comparison(folder / "comparison.png", made)
    seconds = made.seconds | {"write": time.perf_counter() - started}
    report["seconds"] = {name: round(value, 3) for name, value in seconds.items()}
    report["outputs"] = outputs(folder)
    return seal_row(folder / "report.json", report)


def outputs(folder: Path) -> dict[str, dict[str, str]]:
    """What the files of a result hold, by name, and by what they are known as unchanged."""
    names = sorted(path.name for path in folder.iterdir() if path.is_file())
    return {n: {"holds": OUTPUTS.get(n, ""), "sha256": file_sha256(folder / n)} for n in names}


@contextmanager
def restorer_of(options: Options) -> Iterator[Restorer]:
    """What restores one frame after another, with its networks."""
    with _hand_finder(options) as finder:
        yield Restorer(
            options.method,
            options.checkpoint,
            corruption=options.corruption,
            segmentation=options.segmentation,
            keypoint_network=finder,
        )


def _hand_finder(options: Options) -> AbstractContextManager[MediaPipeHand | str | None]:
    """What finds the hand: MediaPipe, a network's checkpoint, or nothing."""
    if options.hand != MEDIAPIPE:
        if options.hand_model is not None:
            raise ValueError("--hand-model is MediaPipe's: it goes with --hand mediapipe")
        return nullcontext(options.keypoint_network)
    if options.keypoint_network is not None:
        raise ValueError("--hand mediapipe and --keypoint-network both find the hand: name one")
    if options.hand_model is None:
        raise ValueError(
            "--hand mediapipe needs its model: make it with 'hadr hand-model --out "
            "hand_landmarker.task' and add --hand-model hand_landmarker.task"
        )
    from hadr.models.hand.mediapipe_hand import MediaPipeHand

    return MediaPipeHand(options.hand_model)


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
    return checked_metres("truth", truth)
