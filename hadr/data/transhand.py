"""TransHand-14K on disk: the reader for its layouts, and the writer of frames in the same form.

A frame is spread over the folders ``{train,val,test}/{object}/depth/`` ``rgb``, ``depth_np`` or
``depth_png``, ``hand_mask``, ``obj_mask`` or ``object_mask``, ``log_json`` and ``hand_kpt``; the
level ``depth/`` may be missing. The log holds the camera in Blender's convention: it looks along
-z with y up, so camera coordinates in our OpenCV frame are ``diag(1, -1, -1) inverse(T) X``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, overload

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics, transform_points
from hadr.synthesis.camera_log import image_pixels, log_camera, log_keypoints, log_pose, read_log
from hadr.synthesis.transhand_frame import (
    BACKGROUND_FOLDER,
    DEPTH_SCALE_KEY,
    Frame,
    frame_log_path,
    write_frame,
)

Array = npt.NDArray[np.float64]

__all__ = ["SPLITS", "Frame", "FrameFiles", "TransHand", "frame_log_path", "write_frame"]

SPLITS = ("train", "val", "test")
_FOLDERS: dict[str, tuple[str, ...]] = {
    "color": ("rgb",),
    "depth": ("depth_np", "depth_png"),
    "hand_mask": ("hand_mask",),
    "object_mask": ("obj_mask", "object_mask"),
    "log": ("log_json",),
    "hand_kpt": ("hand_kpt",),
}


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
    background = base / BACKGROUND_FOLDER
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
