"""TransHand-14K on disk: the reader for its layouts, and the writer of frames in the same form.

A frame is spread over the folders ``{train,val,test}/{object}/depth/`` ``rgb``, ``depth_np`` or
``depth_png``, ``hand_mask``, ``obj_mask`` or ``object_mask``, ``log_json`` and ``hand_kpt``; the
level ``depth/`` may be missing. The log holds the camera in Blender's convention: it looks along
-z with y up, so camera coordinates in our OpenCV frame are ``diag(1, -1, -1) inverse(T) X``.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, overload

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics, transform_points
from hadr.data.camera_log import (
    camera_log,
    image_pixels,
    log_camera,
    log_keypoints,
    log_pose,
    native_pixels,
    read_log,
)
from hadr.hand import KEYPOINT_NAMES

Array = npt.NDArray[np.float64]

SPLITS = ("train", "val", "test")
#: The log's name for the metres of one step of ``depth_png``.
DEPTH_SCALE_KEY = "depth_png scale"
_FOLDERS: dict[str, tuple[str, ...]] = {
    "color": ("rgb",),
    "depth": ("depth_np", "depth_png"),
    "hand_mask": ("hand_mask",),
    "object_mask": ("obj_mask", "object_mask"),
    "log": ("log_json",),
    "hand_kpt": ("hand_kpt",),
}
_BACKGROUND = "background_depth_png"


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


@dataclass(frozen=True)
class FrameFiles:
    """Where the files of one frame lie."""

    stem: str
    object_id: str
    split: str
    color: Path
    depth: Path
    hand_mask: Path
    object_mask: Path
    log: Path
    hand_kpt: Path
    background: Path | None


class TransHand(Sequence[Frame]):
    """The frames of one split, read when asked for.

    Args:
        root: The folder that holds ``train``, ``val`` and ``test``.
        split: One of the three.
        objects: Only these objects, in this order; all where it is left out.
        pair_by: ``stem`` pairs files by name; ``order`` by sorted position, as the published
            loader does.
        camera: Intrinsics to use in place of the log's ``camera internal``.
        depth_scale: Metres per step of ``depth_png`` where the log does not name them.

    Raises:
        FileNotFoundError: The split, an object or a folder is missing.
        ValueError: Files of a frame do not pair; the message names frame and file.
    """

    def __init__(
        self,
        root: str | Path,
        split: str,
        objects: Sequence[str] | None = None,
        *,
        pair_by: Literal["stem", "order"] = "stem",
        camera: Intrinsics | None = None,
        depth_scale: float | None = None,
    ) -> None:
        self.root, self.split = Path(root), split
        self._camera, self._depth_scale = camera, depth_scale
        if split not in SPLITS:
            raise ValueError(f"split must be one of {', '.join(SPLITS)}, got {split!r}")
        if pair_by not in ("stem", "order"):
            raise ValueError(f"pair_by must be 'stem' or 'order', got {pair_by!r}")
        folder = self.root / split
        if not folder.is_dir():
            raise FileNotFoundError(
                f"{self.root} has no folder {split!r}; a TransHand root holds "
                "{train,val,test}/{object}/"
            )
        found = sorted(p.name for p in folder.iterdir() if p.is_dir())
        for name in objects or ():
            if name not in found:
                raise FileNotFoundError(f"no object {name!r} in {folder}; found {', '.join(found)}")
        self.files: tuple[FrameFiles, ...] = tuple(
            files
            for name in (found if objects is None else objects)
            for files in _list_frames(folder / name, name, split, pair_by)
        )

    def __len__(self) -> int:
        return len(self.files)

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...

    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        """Read one frame, or a list of them for a slice."""
        if isinstance(index, slice):
            return [self._read(files) for files in self.files[index]]
        return self._read(self.files[index])

    @property
    def object_ids(self) -> list[str]:
        """The object of each frame, without reading pictures."""
        return [files.object_id for files in self.files]

    @property
    def hold_ids(self) -> list[str | None]:
        """The holding pose of each frame from its log; None where the log has none."""
        return [read_log(files.log).get("hold_id") for files in self.files]

    def _read(self, files: FrameFiles) -> Frame:
        log = read_log(files.log)
        color = cv2.imread(str(files.color), cv2.IMREAD_COLOR)
        if color is None:
            raise ValueError(f"{files.color} is not a readable picture")
        color = np.ascontiguousarray(color[..., ::-1])
        height, width = color.shape[:2]
        scale = self._depth_scale or log.get(DEPTH_SCALE_KEY)
        depth = _read_depth(files.depth, scale)
        hand_mask, object_mask = _read_mask(files.hand_mask), _read_mask(files.object_mask)
        images = {"depth": depth, "hand_mask": hand_mask, "object_mask": object_mask}
        for name, image in images.items():
            if image.shape != (height, width):
                raise ValueError(
                    f"frame {files.stem} of object {files.object_id}: {name} has shape "
                    f"{image.shape}, but the colour picture is {(height, width)}"
                )
        background = None if files.background is None else _read_depth(files.background, scale)
        camera = self._camera or log_camera(log, width, height, files.log)
        pose = log_pose(log, files.log)
        keypoints = transform_points(np.linalg.inv(pose), log_keypoints(log, files.log))
        uv = _read_keypoints_uv(files.hand_kpt)
        return Frame(
            files.stem,
            files.object_id,
            files.split,
            color,
            depth,
            hand_mask,
            object_mask,
            keypoints,
            image_pixels(uv, camera),
            camera,
            pose,
            background,
            log.get("hold_id"),
        )


def _list_frames(
    folder: Path, object_id: str, split: str, pair_by: Literal["stem", "order"]
) -> list[FrameFiles]:
    base = folder / "depth" if (folder / "depth").is_dir() else folder
    listed: dict[str, list[Path]] = {}
    for part, names in _FOLDERS.items():
        present = [base / name for name in names if (base / name).is_dir()]
        if not present:
            raise FileNotFoundError(f"{base} lacks the folder {' or '.join(names)}")
        listed[part] = sorted(p for p in present[0].iterdir() if not p.name.startswith("."))
    stems = [p.stem for p in listed["color"]]
    if pair_by == "order":
        counts = {part: len(paths) for part, paths in listed.items()}
        if len(set(counts.values())) > 1:
            raise ValueError(f"{base}: the folders hold different numbers of files: {counts}")
        table = {part: dict(zip(stems, paths, strict=True)) for part, paths in listed.items()}
    else:
        table = {part: {p.stem: p for p in paths} for part, paths in listed.items()}
        problems = [
            f"frame {stem} lacks {base.name}/{paths[0].parent.name if paths else part}"
            for part, paths in listed.items()
            for stem in sorted(set().union(*table.values()) - set(table[part]))
        ]
        if problems:
            more = f", and {len(problems) - 5} more" if len(problems) > 5 else ""
            raise ValueError(
                f"{split}/{object_id}: {'; '.join(problems[:5])}{more} "
                "(pair_by='order' pairs by sorted position instead)"
            )
    background = base / _BACKGROUND
    return [
        FrameFiles(
            stem,
            object_id,
            split,
            table["color"][stem],
            table["depth"][stem],
            table["hand_mask"][stem],
            table["object_mask"][stem],
            table["log"][stem],
            table["hand_kpt"][stem],
            path if (path := background / f"{stem}.png").is_file() else None,
        )
        for stem in stems
    ]


def _read_depth(path: Path, scale: float | None) -> npt.NDArray[np.float32]:
    if path.suffix == ".npy":
        depth = np.load(path, allow_pickle=False)
        depth = depth[..., 0] if depth.ndim == 3 else depth
        if depth.ndim != 2 or not np.issubdtype(depth.dtype, np.floating):
            raise ValueError(
                f"{path}: depth must be (H, W) or (H, W, C) float metres, got {depth.shape} "
                f"{depth.dtype}"
            )
    else:
        raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if raw is None or raw.dtype != np.uint16:
            got = "nothing readable" if raw is None else f"{raw.shape} {raw.dtype}"
            raise ValueError(f"{path}: depth must be a 16-bit PNG, got {got}")
        if not scale:
            raise ValueError(
                f"{path}: the log does not name {DEPTH_SCALE_KEY!r}; pass depth_scale= (metres "
                "per step)"
            )
        depth = (raw[..., 0] if raw.ndim == 3 else raw) * float(scale)
    valid = np.isfinite(depth) & (depth > 0)
    return np.where(valid, depth, 0.0).astype(np.float32)


def _read_mask(path: Path) -> npt.NDArray[np.bool_]:
    mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if mask is None:
        raise ValueError(f"{path} is not a readable mask")
    return np.asarray(mask > 127)


def _read_keypoints_uv(path: Path) -> Array:
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    try:
        uv = np.array([[float(line[0]), float(line[1])] for line in lines])
    except (IndexError, ValueError) as error:
        raise ValueError(f"{path}: each line must hold 'u v' in pixels ({error})") from error
    if len(uv) < 21:
        raise ValueError(f"{path} holds {len(uv)} keypoints, expected 21")
    return uv[:21]


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
        _write(base / _BACKGROUND / f"{frame.stem}.png", _encode(".png", steps, best))
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
