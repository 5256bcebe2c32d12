"""A user's photographs for the surroundings: found in a folder, loaded when a scene shows them."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]

_ENDINGS = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
_LARGEST = 1024


def find_backgrounds(folder: str | Path) -> tuple[Path, ...]:
    """The photographs of a folder, by name.

    Args:
        folder: With JPEG, PNG, BMP, WebP or TIFF files.

    Raises:
        ValueError: There is no such folder, or no photograph in it.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ValueError(f"no folder of photographs at {folder}")
    found = tuple(sorted(p for p in folder.iterdir() if p.suffix.lower() in _ENDINGS))
    if not found:
        raise ValueError(f"{folder} holds no photograph ({', '.join(_ENDINGS)})")
    return found


@lru_cache(maxsize=24)
def load_background(path: Path) -> Image:
    """A photograph, at most 1024 pixels wide or high.

    Args:
        path: Of the file.

    Returns:
        sRGB, shape (H, W, 3) uint8.

    Raises:
        ValueError: The file is no picture that can be read, or smaller than 16 pixels.
    """
    image = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
    if image is None:
        raise ValueError(f"can't read the photograph {path}")
    if min(image.shape[:2]) < 16:
        raise ValueError(f"the photograph {path} has only {image.shape[1]}x{image.shape[0]} pixels")
    scale = min(_LARGEST / max(image.shape[:2]), 1.0)
    if scale < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(image[..., ::-1], dtype=np.uint8)
