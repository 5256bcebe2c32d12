"""Do the pictures of a data folder show what its logs say? One sentence where they do not.

A command asks once, before it reads the frames. Of each split it looks at a few, evenly taken: a
wrong unit, another camera's numbers or swapped folders are in all of them. The limits leave in
what true hands show with much to spare: of 577 bundled and generated frames all keypoints lie in
the pixels of hand or glass, in the median 6 to 128 mm behind the depth there, and the farthest is
0.11 to 0.20 m from the wrist.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from hadr.camera import project
from hadr.data.folders import FrameFolder, check_folders, has_split, open_folder
from hadr.data.frame import Frame
from hadr.data.transhand import FrameFiles, TransHand

LOOKED_AT = 12
"""So many frames of a split are read."""
HAND_M = (0.05, 0.30)
"""From the wrist to the farthest keypoint."""
LEAST_SHARE = 0.5
"""Of a hand's keypoints in the picture, in the pixels of hand or glass."""
LARGEST_GAP_M = 0.25
"""Between keypoints and the depth at their pixels, median: fingers may lie behind the glass."""
LEAST_SEEN = 5
"""Of fewer keypoints with depth at their pixels nothing is said."""
LARGEST_SHIFT = 0.2
"""Of the picture's width, between a keypoint of the log and its pixel in `hand_kpt`, median."""
LEAST_FRAMES = 4
"""Of fewer frames it is not said that their masks are swapped: a hand may hide behind a glass."""
SAMPLE = 4096
"""Bytes that are read of a file's middle, to tell it from another of its size."""


def check_data(
    folders: Sequence[str | Path], splits: Sequence[str], objects: Sequence[str] | None = None
) -> str:
    """Refuse data folders whose logs contradict their pictures, or of which two parts are one.

    The folders are read as one, of them these splits, of which one may be missing, and these
    objects, or all. Gives 64 hexadecimal digits that tell these frames from others.

    Raises:
        FileNotFoundError: A folder has no split at all, or an object is missing.
        ValueError: A frame can't be read or contradicts itself, or two folders or splits hold the
            same one; the message names frame and value.
    """
    check_folders(folders)
    known: dict[str, str] = {}
    every = hashlib.sha256()
    for folder in folders:
        found: dict[str, str] = {}
        for split in splits:
            if has_split(folder, split):
                frames = open_folder(folder, split, objects)
                if not len(frames):
                    raise ValueError(f"{Path(folder) / split} holds no frame")
                _check_split(frames, str(folder))
                digests = frame_digests(frames)
                every.update(f"{split} {digests}".encode())
                if same := found.keys() & set(digests):
                    raise ValueError(
                        f"{Path(folder) / split} holds {len(same)} frames of a split named before "
                        f"it, such as {found[min(same)]}: what is learned would be its own judge"
                    )
                found |= zip(digests, frames.names, strict=False)
        if same := known.keys() & found.keys():
            one = min(same, key=lambda digest: found[digest])
            raise ValueError(
                f"{folder} holds {len(same)} frames of the folders named before it, such as "
                f"{found[one]} ({known[one]}): they would count twice"
            )
        known |= {digest: f"{name} of {folder}" for digest, name in found.items()}
    return every.hexdigest()


def frame_digests(frames: FrameFolder) -> list[str]:
    """What tells each frame from others: size and middle of its files; none of other layouts."""
    return [_digest(files) for files in frames.files] if isinstance(frames, TransHand) else []


def _digest(files: FrameFiles) -> str:
    found = hashlib.sha256()
    for part in fields(files):
        path = getattr(files, part.name)
        if isinstance(path, Path) and path.is_file():
            size = path.stat().st_size
            with path.open("rb") as file:
                file.seek(max((size - SAMPLE) // 2, 0))
                found.update(f"{part.name} {size} ".encode() + file.read(SAMPLE))
    return found.hexdigest()


def _check_split(frames: FrameFolder, where: str) -> None:
    looked_at = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), LOOKED_AT)).astype(int))
    counts, name = [], ""
    for number in looked_at:
        frame = frames[int(number)]
        name = f"{where}/{frame.split}/{frame.object_id}: frame {frame.stem}"
        try:
            counts.append(_counts(frame))
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    hand, glass, hand_area, glass_area = np.sum(counts, axis=0)
    if len(counts) >= LEAST_FRAMES and hand < glass and hand_area < glass_area:
        raise ValueError(
            f"{name}, and {len(counts) - 1} others looked at: {hand} of the hands' keypoints lie "
            f"in the hands' masks and {glass} in the objects', which are larger, too: are the two "
            "folders of masks swapped?"
        )


def _counts(frame: Frame) -> tuple[int, int, int, int]:
    """Keypoints in the pixels of hand and glass, and these pixels; ValueError if a value is odd."""
    camera, points = frame.camera, frame.keypoints
    width, height = camera.width, camera.height
    if not (-0.5 <= camera.cx <= width - 0.5 and -0.5 <= camera.cy <= height - 0.5):
        raise ValueError(
            f"its principal point ({camera.cx:g}, {camera.cy:g}) lies outside of its picture of "
            f"{width}x{height} pixels: are the intrinsics of another size?"
        )
    extent = float(np.linalg.norm(points - points[0], axis=1).max())
    if not HAND_M[0] <= extent <= HAND_M[1]:
        raise ValueError(
            f"its farthest keypoint is {extent:.3g} m from the wrist, expected {HAND_M[0]:g} to "
            f"{HAND_M[1]:g} m: are the log's keypoints in metres?"
        )
    if not (points[:, 2] > 0).all():
        raise ValueError(
            f"a hand's keypoint has z = {points[:, 2].min():.3g} m in the camera's frame, expected "
            "all in front of it: are camera and keypoints of one frame, and in metres?"
        )
    uv = project(points, camera)
    column, row = np.rint(uv).astype(int).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    at = row[inside], column[inside]
    on_hand, on_glass = frame.hand_mask[at], frame.object_mask[at]
    hand, glass = int(on_hand.sum()), int(on_glass.sum())
    share = (hand + glass) / max(int(inside.sum()), 1)
    if frame.hand_mask.any() and share < LEAST_SHARE:
        raise ValueError(
            f"{100 * share:.0f} % of its hand's keypoints lie in the pixels of hand or object, "
            f"expected {100 * LEAST_SHARE:.0f} % and more: are log, intrinsics and masks of one "
            "picture, and the log in metres?"
        )
    depth, z = frame.depth[at], points[inside, 2]
    seen = (on_hand | on_glass) & (depth > 0)
    gap = float(np.median((z - depth)[seen])) if seen.sum() >= LEAST_SEEN else 0.0
    if abs(gap) > LARGEST_GAP_M:
        raise ValueError(
            f"its hand's keypoints lie {abs(gap):.3g} m {'behind' if gap > 0 else 'before'} the "
            f"depth at their pixels, expected at most {LARGEST_GAP_M:g} m: are depth, camera and "
            "keypoints in metres?"
        )
    shift = float(np.median(np.linalg.norm(uv - frame.keypoints_uv, axis=1)))
    if shift > LARGEST_SHIFT * width:
        raise ValueError(
            f"its keypoints in hand_kpt lie {shift:.0f} pixels away from where the log's appear, "
            f"expected at most {LARGEST_SHIFT * width:.0f}: are they in pixels of 1280x720?"
        )
    return hand, glass, int(frame.hand_mask.sum()), int(frame.object_mask.sum())
