"""A user's photographs for the surroundings: found in a folder, loaded when a scene shows them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from hadr.data.frame_pictures import JPEG_START, PNG_START, check_whole, decode_unchecked

Image = npt.NDArray[np.uint8]

#: How the files of photographs end.
ENDINGS = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
_LARGEST = 1024
_NAMED = 10


def find_backgrounds(folder: str | Path) -> tuple[Path, ...]:
    """The photographs of a folder by name, not of its subfolders; a ``ValueError`` without any."""
    folder = Path(folder)
    if not folder.is_dir():
        raise ValueError(f"no folder of photographs at {folder}")
    files = (path for path in folder.iterdir() if path.is_file())
    found = tuple(sorted(path for path in files if path.suffix.lower() in ENDINGS))
    if not found:
        raise ValueError(f"{folder} holds no photograph ({', '.join(ENDINGS)})")
    return found


def check_backgrounds(folder: str | Path) -> None:
    """Load each photograph of a folder once; a ``ValueError`` names those that can't be used."""
    problems = []
    for path in find_backgrounds(folder):
        try:
            _read_photograph(path)
        except ValueError as error:
            problems.append(str(error))
    if problems:
        more = f"; and {len(problems) - _NAMED} more" if len(problems) > _NAMED else ""
        raise ValueError(
            f"{len(problems)} of the photographs can't be used; remove or replace them: "
            f"{'; '.join(problems[:_NAMED])}{more}"
        )


def load_background(path: Path) -> Image:
    """A photograph, at most 1024 pixels wide or high, sRGB, (H, W, 3) uint8; errors name it."""
    image = _read_photograph(path)
    scale = min(_LARGEST / max(image.shape[:2]), 1.0)
    if scale < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(image[..., ::-1], dtype=np.uint8)


def _read_photograph(path: Path) -> npt.NDArray[np.generic]:
    """A photograph as it is, in OpenCV's order of colours; a ``ValueError`` says what is wrong."""
    try:
        data = path.read_bytes()
        if data.startswith((JPEG_START, PNG_START)):
            check_whole(data)
        image = decode_unchecked(data, cv2.IMREAD_COLOR)
    except OSError as error:
        raise ValueError(f"can't read the photograph {path}: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"can't read the photograph {path}: {error}") from error
    if min(image.shape[:2]) < 16:
        raise ValueError(f"the photograph {path} has only {image.shape[1]}x{image.shape[0]} pixels")
    return image
