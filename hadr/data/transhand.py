"""TransHand-14K on disk: the reader for its layouts; `hadr.data.frame` writes them.

A frame is spread over the folders ``{train,val,test}/{object}/depth/`` ``rgb``, ``depth_np`` or
``depth_png``, ``hand_mask``, ``obj_mask`` or ``object_mask``, ``log_json`` and ``hand_kpt``; the
level ``depth/`` may be missing. What a log holds is in `hadr.data.camera_log`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal, TypeVar, overload

import numpy as np
import numpy.typing as npt

from hadr.camera import TRANSHAND_CAMERA, Array, Intrinsics, transform_points
from hadr.data import frame_pictures as pictures
from hadr.data.camera_log import (
    log_camera,
    log_keypoints,
    log_pose,
    log_transform,
    read_log,
    rescaled_pixels,
)
from hadr.data.frame import (
    BACKGROUND_FOLDER,
    DEPTH_SCALE_KEY,
    DISPARITY_FOLDER,
    DISPARITY_SCALE_KEY,
    NORMALS_FOLDER,
    OBJECT_POSE_KEY,
    RAW_FOLDER,
    RAW_SCALE_KEY,
    Frame,
)
from hadr.records.reading import read_bytes, structured

Dtype = TypeVar("Dtype", bound=np.generic)

SPLITS = ("train", "val", "test")
#: The folders of a frame's parts; the first that exists is read.
_FOLDERS: dict[str, tuple[str, ...]] = {
    "color": ("rgb",),
    "depth": ("depth_np", "depth_png"),
    "hand_mask": ("hand_mask",),
    "object_mask": ("obj_mask", "object_mask"),
    "log": ("log_json",),
    "hand_kpt": ("hand_kpt",),
}
#: Depth in coarser steps would show no glass; a larger number is of another unit.
LARGEST_STEP_M = 0.01
#: Those that a data set may lack altogether.
_MORE_FOLDERS = {
    "background": (BACKGROUND_FOLDER,),
    "raw_depth": (RAW_FOLDER, DISPARITY_FOLDER),
    "normals": (NORMALS_FOLDER,),
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
    background: Path | None = None
    raw_depth: Path | None = None
    normals: Path | None = None

    def __str__(self) -> str:
        return f"{self.split}/{self.object_id}: frame {self.stem}"


class TransHand(Sequence[Frame]):
    """The frames of one split, read when asked for.

    Args:
        root: The folder that holds ``train``, ``val`` and ``test``.
        split: One of the three, or several, one after the other.
        objects: Only these objects, in this order; all where it is left out.
        pair_by: ``stem`` pairs files by name; ``order`` by sorted position, as the published
            loader does.
        camera: Intrinsics to use in place of the log's ``camera internal``.
        depth_scale: Metres per step of ``depth_png`` where the log does not name them.

    Raises:
        FileNotFoundError: The split, an object or a folder is missing.
        ValueError: Files of a frame do not pair, or a split or object is named twice; the message
            names it.
    """

    def __init__(
        self,
        root: str | Path,
        split: str | Sequence[str],
        objects: Sequence[str] | None = None,
        *,
        pair_by: Literal["stem", "order"] = "stem",
        camera: Intrinsics | None = None,
        depth_scale: float | None = None,
    ) -> None:
        self.root, self.split = Path(root), split
        self._camera, self._depth_scale = camera, depth_scale
        if pair_by not in ("stem", "order"):
            raise ValueError(f"pair_by must be 'stem' or 'order', got {pair_by!r}")
        names = (split,) if isinstance(split, str) else tuple(split)
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"split {twice[0]!r} is named twice; its frames would count twice")
        self.files: tuple[FrameFiles, ...] = tuple(
            files for name in names for files in _list_split(self.root, name, objects, pair_by)
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
    def names(self) -> list[str]:
        """Name of each frame, OBJECT/STEM."""
        return [f"{files.object_id}/{files.stem}" for files in self.files]

    @property
    def object_ids(self) -> list[str]:
        """The object of each frame, without reading pictures."""
        return [files.object_id for files in self.files]

    @property
    def hold_ids(self) -> list[str | None]:
        """The holding pose of each frame from its log; None where the log has none."""
        return [read_log(files.log).get("hold_id") for files in self.files]

    def _read(self, files: FrameFiles) -> Frame:
        try:
            return self._read_frame(files)
        except (ValueError, OSError) as error:
            raise ValueError(f"{files}: {error}") from error

    def _read_frame(self, files: FrameFiles) -> Frame:
        log = read_log(files.log)
        color = _load(files.color, pictures.decode_color)
        height, width = color.shape[:2]

        def load(path: Path, decode: Callable[[bytes], npt.NDArray[Dtype]]) -> npt.NDArray[Dtype]:
            image = _load(path, decode)
            if image.shape[:2] != (height, width):
                raise ValueError(
                    f"{path.parent.name} has shape {image.shape} in {path}, but the colour "
                    f"picture is {(height, width)}"
                )
            return image

        def load_depth(path: Path, key: str) -> npt.NDArray[np.float32]:
            if path.suffix == ".npy":
                return load(path, pictures.decode_depth_array)
            scale = log.get(key, self._depth_scale if key == DEPTH_SCALE_KEY else None)
            if scale is None:
                remedy = "; pass depth_scale= (metres per step)" if key == DEPTH_SCALE_KEY else ""
                raise ValueError(f"{path}: the log does not name {key!r}{remedy}")
            scale = structured(scale, float, f"{files.log}: {key!r}")
            if not 0 < scale <= LARGEST_STEP_M:
                raise ValueError(
                    f"{files.log}: {key!r} must be at most {LARGEST_STEP_M} m and above 0, got "
                    f"{scale}"
                )
            return load(path, lambda data: pictures.decode_depth(data, scale))

        depth = load_depth(files.depth, DEPTH_SCALE_KEY)
        object_mask = load(files.object_mask, pictures.decode_mask)
        hand_mask = load(files.hand_mask, pictures.decode_mask)
        both = int((hand_mask & object_mask).sum())
        if both:
            raise ValueError(
                f"{files.hand_mask} and {files.object_mask} overlap in {both} pixels, but a pixel "
                "belongs to hand or object, to what its ray meets first"
            )
        background = raw = None
        if files.background is not None:
            behind = load_depth(files.background, DEPTH_SCALE_KEY)
            background = np.where(object_mask, behind, depth)
        if files.raw_depth is not None and files.raw_depth.parent.name == DISPARITY_FOLDER:
            where = f"{files.log}: {DISPARITY_SCALE_KEY!r}"
            scale = structured(log.get(DISPARITY_SCALE_KEY), pictures.DisparityScale, where)
            raw = load(files.raw_depth, lambda data: pictures.decode_disparity(data, scale))
        elif files.raw_depth is not None:
            raw = load_depth(files.raw_depth, RAW_SCALE_KEY)
        camera = self._camera or log_camera(log, width, height, files.log)
        if camera.shape != (height, width):
            raise ValueError(
                f"{files.color} is {width}x{height}, but its camera {camera.width}x{camera.height}"
            )
        pose = log_pose(log, files.log)
        keypoints = transform_points(np.linalg.inv(pose), log_keypoints(log, files.log))
        uv = read_keypoints_uv(files.hand_kpt)
        return Frame(
            files.stem,
            files.object_id,
            files.split,
            color,
            depth,
            hand_mask,
            object_mask,
            keypoints,
            rescaled_pixels(uv, TRANSHAND_CAMERA, camera),
            camera,
            pose,
            background,
            log.get("hold_id"),
            raw,
            None if files.normals is None else load(files.normals, pictures.decode_normals),
            log_transform(log, OBJECT_POSE_KEY, files.log),
        )


def _load(path: Path, decode: Callable[[bytes], npt.NDArray[Dtype]]) -> npt.NDArray[Dtype]:
    try:
        return decode(read_bytes(path))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _list_split(
    root: Path, split: str, objects: Sequence[str] | None, pair_by: Literal["stem", "order"]
) -> list[FrameFiles]:
    if split not in SPLITS:
        raise ValueError(f"split must be one of {', '.join(SPLITS)}, got {split!r}")
    folder = root / split
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{root} has no folder {split!r}; a TransHand root holds {{train,val,test}}/{{object}}/"
        )
    found = sorted(p.name for p in folder.iterdir() if p.is_dir())
    for number, name in enumerate(objects or ()):
        if name not in found:
            raise FileNotFoundError(f"no object {name!r} in {folder}; found {', '.join(found)}")
        if objects and name in objects[:number]:
            raise ValueError(f"object {name!r} is named twice")
    return [
        files
        for name in (found if objects is None else objects)
        for files in _list_frames(folder / name, name, split, pair_by)
    ]


def _list_frames(
    folder: Path, object_id: str, split: str, pair_by: Literal["stem", "order"]
) -> list[FrameFiles]:
    base = folder / "depth" if (folder / "depth").is_dir() else folder
    listed: dict[str, list[Path]] = {}
    for part, names in (_FOLDERS | _MORE_FOLDERS).items():
        present = [base / name for name in names if (base / name).is_dir()]
        if not present and part in _FOLDERS:
            raise FileNotFoundError(f"{base} lacks the folder {' or '.join(names)}")
        if present:
            listed[part] = sorted(p for p in present[0].iterdir() if not p.name.startswith("."))
    stems = [p.stem for p in listed["color"]]
    if pair_by == "order":
        counts = {part: len(paths) for part, paths in listed.items()}
        if len(set(counts.values())) > 1:
            raise ValueError(f"{base}: the folders hold different numbers of files: {counts}")
        table = {part: dict(zip(stems, paths, strict=True)) for part, paths in listed.items()}
        if twice := [path for path in listed["color"] if table["color"][path.stem] != path]:
            raise ValueError(f"{twice[0].parent} has two pictures for one frame, {twice[0].stem!r}")
    else:
        table = {part: {p.stem: p for p in paths} for part, paths in listed.items()}
        _check_pairs(f"{split}/{object_id}", base, listed, table)
    wanted = {field.name for field in fields(FrameFiles)} & set(table)
    return [
        FrameFiles(stem, object_id, split, **{part: table[part][stem] for part in wanted})
        for stem in stems
    ]


def _check_pairs(
    place: str, base: Path, listed: dict[str, list[Path]], table: dict[str, dict[str, Path]]
) -> None:
    """Each frame has one file of each kind; else a ``ValueError`` names frames and files."""
    problems = [
        f"frame {path.stem} has two files, {table[part][path.stem].name} and {path.name}, in "
        f"{path.parent.name}"
        for part, paths in listed.items()
        for path in paths
        if table[part][path.stem] != path
    ]
    problems += [
        f"frame {stem} lacks {base.name}/{paths[0].parent.name if paths else part}"
        for part, paths in listed.items()
        for stem in sorted(set().union(*table.values()) - set(table[part]))
    ]
    if problems:
        more = f", and {len(problems) - 5} more" if len(problems) > 5 else ""
        raise ValueError(
            f"{place}: {'; '.join(problems[:5])}{more} (pair_by='order' pairs by sorted position "
            "instead; `hadr generate`, started again with its settings, makes what is missing)"
        )


def read_keypoints_uv(path: Path) -> Array:
    """Read the pixels (21, 2) of a frame's keypoints; ValueError where it lacks one."""
    try:
        lines = read_bytes(path).decode("utf-8").splitlines()
        words = [line.split() for line in lines if line.strip()]
        uv = np.array([[float(line[0]), float(line[1])] for line in words])
    except (IndexError, ValueError) as error:
        raise ValueError(f"{path}: each line must hold 'u v' in pixels ({error})") from error
    if len(uv) < 21:
        raise ValueError(f"{path} holds {len(uv)} keypoints, expected 21")
    if not np.isfinite(uv[:21]).all():
        raise ValueError(f"{path}: a keypoint is not a finite number")
    return uv[:21]
