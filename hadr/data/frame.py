"""One frame with all its labels, and how it is written in TransHand-14K's form.

A frame is spread over some ten folders. All its files are first written into a folder of their
own, ``.hadr-part-*``, then moved to their places, the log last: a frame that has a log is
complete, whatever happens to the program that writes it. The reader of the same form is
:mod:`hadr.data.transhand`.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from hadr.camera import TRANSHAND_CAMERA, Array, Intrinsics, transform_points
from hadr.data import frame_pictures as pictures
from hadr.data.camera_log import camera_log, is_rigid, rescaled_pixels
from hadr.hand import KEYPOINT_NAMES, check_keypoints
from hadr.records.writing import PART

#: The log's name for the metres of one step of ``depth_png`` and ``background_depth_png``.
DEPTH_SCALE_KEY = "depth_png scale"
#: The same for ``raw_depth``.
RAW_SCALE_KEY = "raw_depth scale"
#: The log's name for what turns ``raw_disparity`` into raw depth.
DISPARITY_SCALE_KEY = "raw_disparity scale"
#: The log's name for the object's pose.
OBJECT_POSE_KEY = "world_from_object"
#: What TransHand-14K has no folder for.
BACKGROUND_FOLDER, NORMALS_FOLDER = "background_depth_png", "normals"
RAW_FOLDER, DISPARITY_FOLDER = "raw_depth", "raw_disparity"


@dataclass(frozen=True)
class Frame:
    """One frame with all its labels.

    Args:
        stem: The name that its files share.
        object_id: Four digits, e.g. ``0004``.
        split: ``train``, ``val`` or ``test``.
        color: sRGB, shape (H, W, 3) uint8, channels red, green, blue.
        depth: True z-depth, metres, shape (H, W) float32; 0 where there is none.
        hand_mask: Shape (H, W) bool.
        object_mask: Shape (H, W) bool, disjoint from the hand's.
        keypoints: Camera frame, metres, shape (21, 3).
        keypoints_uv: Pixels of this image, shape (21, 2).
        camera: Intrinsics of this image.
        world_from_camera: Pose of the OpenCV camera, shape (4, 4).
        background_depth: Depth with the glass taken away, metres, (H, W) float32, or None.
        hold_id: Name of the holding pose, where the log knows it.
        raw_depth: What a depth camera would measure, z-depth in the colour camera, metres,
            (H, W) float32, 0 where it measures nothing; or None.
        normals: Unit surface normals toward the viewer, camera frame, (H, W, 3) float32, 0 where
            unknown; or None.
        world_from_object: Pose of the object, shape (4, 4), or None.
    """

    stem: str
    object_id: str
    split: str
    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    hand_mask: npt.NDArray[np.bool_]
    object_mask: npt.NDArray[np.bool_]
    keypoints: Array
    keypoints_uv: Array
    camera: Intrinsics
    world_from_camera: Array
    background_depth: npt.NDArray[np.float32] | None = None
    hold_id: str | None = None
    raw_depth: npt.NDArray[np.float32] | None = None
    normals: npt.NDArray[np.float32] | None = None
    world_from_object: Array | None = None

    @property
    def camera_from_world(self) -> Array:
        """World points into the camera frame, shape (4, 4)."""
        return np.asarray(np.linalg.inv(self.world_from_camera))


def frame_log_path(root: str | Path, split: str, object_id: str, stem: str) -> Path:
    """The log of a frame in the layout with the ``depth/`` level; it is written last."""
    return Path(root) / split / object_id / "depth" / "log_json" / f"{stem}.json"


def frame_places(
    stem: str,
    *,
    depth_format: Literal["npy", "png"] = "npy",
    jpeg_quality: int | None = None,
    raw: Literal["depth", "disparity"] = "depth",
    object_folder: Literal["obj_mask", "object_mask"] = "obj_mask",
) -> dict[str, Path]:
    """Where the parts of a frame lie below the folder of its object, as `write_frame` writes it."""
    folders = {
        "color": ("rgb", ".png" if jpeg_quality is None else ".jpg"),
        "depth": ("depth_np" if depth_format == "npy" else "depth_png", f".{depth_format}"),
        "background": (BACKGROUND_FOLDER, ".png"),
        "raw": (RAW_FOLDER if raw == "depth" else DISPARITY_FOLDER, ".png"),
        "normals": (NORMALS_FOLDER, ".png"),
        "hand_mask": ("hand_mask", ".png"),
        "object_mask": (object_folder, ".png"),
        "keypoints": ("hand_kpt", ".txt"),
        "log": ("log_json", ".json"),
    }
    return {part: Path(folder, stem + ending) for part, (folder, ending) in folders.items()}


_KINDS = {
    **dict.fromkeys(("depth", "background_depth", "raw_depth"), ("f", "float metres")),
    **dict.fromkeys(("hand_mask", "object_mask"), ("b", "bool")),
    "color": ("u", "uint8 RGB"),
    "normals": ("f", "float"),
}
"""NumPy's kinds of a frame's images, and what they are called."""


def _check(frame: Frame) -> None:
    for name, (kind, words) in _KINDS.items():
        image = getattr(frame, name)
        if image is None:
            continue
        if image.shape[:2] != frame.camera.shape:
            raise ValueError(f"{name} has shape {image.shape}, the camera {frame.camera.shape}")
        if image.dtype.kind != kind or (kind == "u" and image.dtype != np.uint8):
            raise ValueError(f"{name} must be {words}, got {image.dtype}")
    for name in ("world_from_camera", "world_from_object"):
        pose = getattr(frame, name)
        if pose is not None and (np.shape(pose) != (4, 4) or not is_rigid(pose)):
            raise ValueError(f"{name} must be a rigid 4x4 matrix, got {np.array(pose).tolist()}")
    check_keypoints(frame.keypoints)


def _kept_normals(frame: Frame, where: pictures.Normals) -> npt.NDArray[np.float32] | None:
    if frame.normals is None or where == "none":
        return None
    if where == "all":
        return frame.normals
    if where not in ("held", "object"):
        raise ValueError(f"normals must be 'all', 'held', 'object' or 'none', got {where!r}")
    kept = frame.object_mask | frame.hand_mask if where == "held" else frame.object_mask
    return np.where(kept[..., None], frame.normals, np.float32(0))


def _rounded(values: npt.ArrayLike, digits: int) -> Any:
    """Nested lists of numbers, short enough for a log."""
    return (np.round(np.asarray(values, dtype=float), digits) + 0.0).tolist()


def _log(frame: Frame) -> dict[str, Any]:
    point, angle = camera_log(frame.world_from_camera)
    world = transform_points(frame.world_from_camera, frame.keypoints)
    log: dict[str, Any] = {
        "camera point": _rounded(point, 9),
        "camera angle": _rounded(angle, 9),
        "camera internal": frame.camera.matrix.tolist(),
        "hand_keypoint": dict(zip(KEYPOINT_NAMES, _rounded(world, 7), strict=True)),
    }
    if frame.world_from_object is not None:
        log[OBJECT_POSE_KEY] = _rounded(frame.world_from_object, 9)
    if frame.hold_id is not None:
        log["hold_id"] = frame.hold_id
    return log


def _older_files(frame: Frame, base: Path) -> list[Path]:
    """All files of a frame that was written before by the same name, in any form; the log first."""
    forms = (
        frame_places(frame.stem),
        frame_places(
            frame.stem,
            depth_format="png",
            jpeg_quality=90,
            raw="disparity",
            object_folder="object_mask",
        ),
    )
    places = [form[part] for part in reversed(forms[0]) for form in forms]
    return [base / place for place in dict.fromkeys(places)]


def _place(root: Path, files: Mapping[Path, bytes], older: Sequence[Path] = ()) -> None:
    """Write all files, remove older ones, then move the new to their places in the given order."""
    root.mkdir(parents=True, exist_ok=True)
    staged = Path(tempfile.mkdtemp(dir=root, prefix=PART))
    try:
        for number, data in enumerate(files.values()):
            (staged / str(number)).write_bytes(data)
        for path in older:
            path.unlink(missing_ok=True)
        for number, place in enumerate(files):
            place.parent.mkdir(parents=True, exist_ok=True)
            os.replace(staged / str(number), place)
    finally:
        shutil.rmtree(staged, ignore_errors=True)


def write_frame(
    root: str | Path,
    frame: Frame,
    *,
    extra_log: Mapping[str, Any] | None = None,
    depth_format: Literal["npy", "png"] = "npy",
    depth_scale: float = 0.0001,
    rest_step: float | None = None,
    raw_scale: float | pictures.DisparityScale = 0.001,
    jpeg_quality: int | None = None,
    normals: pictures.Normals = "all",
    nested: bool = True,
    object_folder: Literal["obj_mask", "object_mask"] = "obj_mask",
) -> Path:
    """Write a frame in TransHand-14K's form.

    Args:
        root: The folder that holds ``train``, ``val`` and ``test``; made where it is missing.
        frame: What to write.
        extra_log: More values for the log.
        depth_format: ``npy`` writes ``depth_np``, float32 metres; ``png`` writes 16-bit steps.
        depth_scale: Metres of one step of the PNG.
        rest_step: Rounds the depth of all that is neither hand nor glass to multiples of this,
            metres, which makes the PNG smaller.
        raw_scale: Metres of one step of ``raw_depth``; real depth cameras report millimetres. Or
            a stereo camera's scale: ``raw_disparity`` is written instead, without loss.
        jpeg_quality: 1 to 100 stores the colour as JPEG; PNG where it is left out.
        normals: Where normals are kept: ``all``, ``held`` (glass and hand), ``object`` (the
            glass alone), or ``none``.
        nested: With the level ``depth/``.
        object_folder: Name of the folder of the object masks.

    Returns:
        The path of the log, which is written last: a frame with a log is complete. One of the same
        name is replaced with all of its files.

    Raises:
        ValueError: A depth does not fit into 16 bits, an image's shape or type is another, or a
            keypoint is not finite, or a pose is not rigid.
        OSError: The folder can't be written.
    """
    _check(frame)
    root = Path(root)
    base = root / frame.split / frame.object_id / ("depth" if nested else ".")
    places = frame_places(
        frame.stem,
        depth_format=depth_format,
        jpeg_quality=jpeg_quality,
        raw="disparity" if isinstance(raw_scale, pictures.DisparityScale) else "depth",
        object_folder=object_folder,
    )
    log, depth = _log(frame), frame.depth
    if rest_step is not None:
        coarse = np.rint(depth / rest_step) * rest_step
        held = frame.object_mask | frame.hand_mask
        depth = np.where(held, depth, coarse).astype(np.float32)
    parts = {"color": pictures.encode_color(frame.color, jpeg_quality)}
    if depth_format == "npy":
        parts["depth"] = pictures.encode_depth_array(depth)
    else:
        parts["depth"] = pictures.encode_depth(depth, depth_scale)
        log[DEPTH_SCALE_KEY] = depth_scale
    if frame.background_depth is not None:
        # Elsewhere it is the depth itself: the reader puts it back.
        behind = np.where(frame.object_mask, frame.background_depth, np.float32(0))
        parts["background"] = pictures.encode_depth(behind, depth_scale)
        log[DEPTH_SCALE_KEY] = depth_scale
    if frame.raw_depth is not None:
        if isinstance(raw_scale, pictures.DisparityScale):
            parts["raw"] = pictures.encode_disparity(frame.raw_depth, raw_scale)
            log[DISPARITY_SCALE_KEY] = asdict(raw_scale)
        else:
            parts["raw"] = pictures.encode_depth(frame.raw_depth, raw_scale)
            log[RAW_SCALE_KEY] = raw_scale
    kept = _kept_normals(frame, normals)
    if kept is not None:
        parts["normals"] = pictures.encode_normals(kept)
    parts["hand_mask"] = pictures.encode_mask(frame.hand_mask)
    parts["object_mask"] = pictures.encode_mask(frame.object_mask)
    uv = rescaled_pixels(frame.keypoints_uv, frame.camera, TRANSHAND_CAMERA)
    parts["keypoints"] = "".join(f"{u:.4f} {v:.4f}\n" for u, v in uv).encode()
    log |= dict(extra_log or {})
    parts["log"] = (json.dumps(log, separators=(",", ":")) + "\n").encode()
    files = {base / places[part]: data for part, data in parts.items()}
    _place(root, files, _older_files(frame, base))
    return base / places["log"]
