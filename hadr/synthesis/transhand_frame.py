"""One frame with all its labels, and how it is written in TransHand-14K's form.

The reader of the same form is :mod:`hadr.data.transhand`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics, transform_points
from hadr.hand import KEYPOINT_NAMES
from hadr.synthesis.camera_log import camera_log, native_pixels

Array = npt.NDArray[np.float64]

#: The log's name for the metres of one step of ``depth_png``.
DEPTH_SCALE_KEY = "depth_png scale"
#: The folder of the depth with the glass taken away; TransHand-14K has none.
BACKGROUND_FOLDER = "background_depth_png"


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

    @property
    def camera_from_world(self) -> Array:
        """World points into the camera frame, shape (4, 4)."""
        return np.asarray(np.linalg.inv(self.world_from_camera))


def _write(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    part.write_bytes(data)
    os.replace(part, path)


def _encode(extension: str, image: npt.NDArray[Any], options: Sequence[int] = ()) -> bytes:
    done, data = cv2.imencode(extension, image, list(options))
    if not done:
        raise ValueError(f"can't encode a picture of shape {image.shape} as {extension}")
    return bytes(data.tobytes())


def _depth_steps(depth: npt.NDArray[np.float32], scale: float) -> npt.NDArray[np.uint16]:
    farthest = float(np.max(depth, initial=0.0))
    if farthest > 65535 * scale:
        raise ValueError(
            f"depth reaches {farthest:.3f} m, but 16 bits at {scale} m a step end at "
            f"{65535 * scale:.3f} m"
        )
    return np.round(np.asarray(depth, dtype=float) / scale).astype(np.uint16)


def frame_log_path(root: str | Path, split: str, object_id: str, stem: str) -> Path:
    """The log of a frame in the layout with the ``depth/`` level; it is written last."""
    return Path(root) / split / object_id / "depth" / "log_json" / f"{stem}.json"


def write_frame(
    root: str | Path,
    frame: Frame,
    *,
    extra_log: Mapping[str, Any] | None = None,
    depth_format: Literal["npy", "png"] = "npy",
    depth_scale: float = 0.0001,
    jpeg_quality: int | None = None,
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
        jpeg_quality: 1 to 100 stores the colour as JPEG; PNG where it is left out.
        nested: With the level ``depth/``.
        object_folder: Name of the folder of the object masks.

    Returns:
        The path of the log, which is written last: a frame with a log is complete.

    Raises:
        ValueError: The depth does not fit into 16 bits, or an image's shape differs.
    """
    for name in ("depth", "hand_mask", "object_mask", "color"):
        if getattr(frame, name).shape[:2] != frame.camera.shape:
            raise ValueError(
                f"{name} has shape {getattr(frame, name).shape}, the camera {frame.camera.shape}"
            )
    base = Path(root) / frame.split / frame.object_id / ("depth" if nested else ".")
    bgr = np.ascontiguousarray(frame.color[..., ::-1])
    if jpeg_quality is None:
        _write(base / "rgb" / f"{frame.stem}.png", _encode(".png", bgr))
    else:
        options = (cv2.IMWRITE_JPEG_QUALITY, jpeg_quality)
        _write(base / "rgb" / f"{frame.stem}.jpg", _encode(".jpg", bgr, options))
    log: dict[str, Any] = {}
    best = (cv2.IMWRITE_PNG_COMPRESSION, 9)
    if depth_format == "npy":
        path = base / "depth_np" / f"{frame.stem}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(f".{path.name}.{os.getpid()}.part.npy")
        np.save(part, frame.depth.astype(np.float32))
        os.replace(part, path)
    else:
        steps = _depth_steps(frame.depth, depth_scale)
        _write(base / "depth_png" / f"{frame.stem}.png", _encode(".png", steps, best))
        log[DEPTH_SCALE_KEY] = depth_scale
    if frame.background_depth is not None:
        steps = _depth_steps(frame.background_depth, depth_scale)
        _write(base / BACKGROUND_FOLDER / f"{frame.stem}.png", _encode(".png", steps, best))
        log[DEPTH_SCALE_KEY] = depth_scale
    for folder, mask in (("hand_mask", frame.hand_mask), (object_folder, frame.object_mask)):
        image = mask.astype(np.uint8) * 255
        _write(base / folder / f"{frame.stem}.png", _encode(".png", image, best))
    uv = native_pixels(frame.keypoints_uv, frame.camera)
    text = "".join(f"{u:.4f} {v:.4f}\n" for u, v in uv)
    _write(base / "hand_kpt" / f"{frame.stem}.txt", text.encode())
    point, angle = camera_log(frame.world_from_camera)
    world = transform_points(frame.world_from_camera, frame.keypoints)
    log |= {
        "camera point": point,
        "camera angle": angle,
        "camera internal": frame.camera.matrix.tolist(),
        "hand_keypoint": dict(zip(KEYPOINT_NAMES, world.tolist(), strict=True)),
    }
    if frame.hold_id is not None:
        log["hold_id"] = frame.hold_id
    log |= dict(extra_log or {})
    path = base / "log_json" / f"{frame.stem}.json"
    _write(path, (json.dumps(log, indent=1) + "\n").encode())
    return path
