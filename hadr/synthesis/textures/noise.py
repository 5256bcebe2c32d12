"""What procedural textures are painted with: noise, colour ramps, palettes, many small shapes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Array

#: A texture in the making: sRGB in [0, 1], float32, shape (H, W, 3).
Canvas = npt.NDArray[np.float32]
Field = npt.NDArray[np.float32]
Color = float | Sequence[float] | npt.NDArray[np.floating]
#: Left, top, right and bottom, in fractions of a picture's sides.
Box = tuple[float, float, float, float]

SIZE = 512
_SHIFT = 4


def noise(
    rng: np.random.Generator,
    cells: tuple[int, int],
    octaves: int = 4,
    roughness: float = 0.55,
    shape: tuple[int, int] = (SIZE, SIZE),
) -> Field:
    """Fractal value noise in [0, 1] that repeats seamlessly.

    The coarsest of its octaves has so many ``cells`` down and across, each further one twice as
    many; it weighs ``roughness`` of the one before.
    """
    height, width = shape
    total = np.zeros(shape, dtype=np.float32)
    for octave in range(octaves):
        rows, columns = min(cells[0] * 2**octave, height), min(cells[1] * 2**octave, width)
        grid = np.pad(rng.random((rows, columns), dtype=np.float32), 2, mode="wrap")
        down, across = height / rows, width / columns
        at = np.array([[1 / across, 0, 1.5 + 0.5 / across], [0, 1 / down, 1.5 + 0.5 / down]])
        how = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        large = cv2.warpAffine(
            grid, at, (width, height), flags=how, borderMode=cv2.BORDER_REPLICATE
        )
        total += np.float32(roughness**octave) * large
    low, high = float(total.min()), float(total.max())
    return np.asarray((total - low) / max(high - low, 1e-9), dtype=np.float32)


def ramp(value: Field, colors: Sequence[Color]) -> Canvas:
    """Colours between stops, evenly spread over [0, 1]."""
    at, stops = np.linspace(0, 1, 256), np.linspace(0, 1, len(colors))
    channels = [np.interp(at, stops, c) for c in np.asarray(colors, dtype=float).T]
    table = np.stack(channels, axis=-1).astype(np.float32)
    return np.asarray(table[np.clip(value * 255, 0, 255).astype(np.uint8)])


def grid(shape: tuple[int, int] = (SIZE, SIZE)) -> tuple[Field, Field]:
    """Coordinates across (u) and down (v) in [0, 1)."""
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]].astype(np.float32)
    return u / shape[1], v / shape[0]


def hsv(hue: float, saturation: float, value: float) -> Array:
    """One colour from hue in degrees, saturation and value in [0, 1]."""
    pixel = np.array([[[hue % 360, np.clip(saturation, 0, 1), np.clip(value, 0, 1)]]], np.float32)
    return np.asarray(cv2.cvtColor(pixel, cv2.COLOR_HSV2RGB)[0, 0], dtype=float)


def room_colors(rng: np.random.Generator, count: int, *, pale: float = 0.0) -> Array:
    """Colours (count, 3) that go together as rooms have them; pale from 0 to 1, which is white."""
    main = rng.choice([22.0, 32.0, 42.0, 95.0, 150.0, 205.0, 220.0, 8.0])
    result = []
    for number in range(count):
        hue = main + rng.normal() * 14 if number % 3 else main + rng.choice([0, 0, 30, 180, -40])
        saturation = rng.beta(1.3, 3.6) * (0.75 if 60 < hue % 360 < 200 else 1.0)
        value = rng.uniform(0.45, 1.0)
        color = hsv(hue, saturation, value)
        result.append(color + (np.array([0.93, 0.92, 0.90]) - color) * pale)
    return np.asarray(result)


def shapes(canvas: Canvas, polygons: Array, colors: Array, buckets: int = 28) -> None:
    """Fill polygons (N, K, 2), corners (x, y) in pixels, the last ones on top, in colours (N, 3).

    They are painted in ``buckets`` goes, in bands of like colours, each in its mean.
    """
    fixed = np.round(polygons * 2**_SHIFT).astype(np.int32)
    for rows in np.array_split(np.arange(len(polygons)), min(buckets, len(polygons))):
        order = rows[np.argsort(colors[rows].sum(1))]
        for part in np.array_split(order, min(4, len(order))):
            color = colors[part].mean(0)
            cv2.fillPoly(canvas, list(fixed[part]), color.tolist(), cv2.LINE_AA, _SHIFT)


def leaf_polygons(centers: Array, lengths: Array, widths: Array, angles: Array) -> Array:
    """Outlines of pointed leaves, pixels, shape (N, 8, 2)."""
    along = np.array([-1.0, -0.55, 0.0, 0.55, 1.0, 0.55, 0.0, -0.55])
    across = np.array([0.0, 0.75, 1.0, 0.62, 0.0, -0.62, -1.0, -0.75])
    x = along * lengths[:, None] / 2
    y = across * widths[:, None] / 2
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return np.stack([x * cos - y * sin, x * sin + y * cos], axis=-1) + centers[:, None]


def rectangle(canvas: Canvas, box: Box, color: Color) -> None:
    """Fill a rectangle."""
    height, width = canvas.shape[:2]
    x0, y0, x1, y1 = box
    left, right = round(x0 * width), round(x1 * width)
    top, bottom = round(y0 * height), round(y1 * height)
    canvas[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = np.asarray(color)


def shadow(canvas: Canvas, box: Box, depth: float, blur: float) -> None:
    """Darken softly around a box as a thing before a wall does: a fraction ``depth`` of the light.

    The softness ``blur`` is in fractions of the picture's height.
    """
    height, width = canvas.shape[:2]
    small = np.zeros((max(height // 4, 1), max(width // 4, 1), 3), dtype=np.float32)
    rectangle(small, box, depth)
    soft = cv2.GaussianBlur(small[..., 0], (0, 0), max(blur * height / 4, 0.5))
    canvas *= 1 - cv2.resize(soft, (width, height))[..., None]


def look_up(
    image: npt.NDArray[Any], x: Array, y: Array, border: int = cv2.BORDER_WRAP
) -> npt.NDArray[np.float64]:
    """Values of a picture (H, W) or (H, W, C) between its pixels, bilinear, (N,) or (N, C).

    Columns ``x`` and rows ``y`` are 0 at the first one's middle; ``border`` is OpenCV's rule for
    what lies outside.
    """
    found = np.empty((len(x), *image.shape[2:]))
    for first in range(0, len(x), 30000):  # OpenCV's largest picture side is 32767
        part = slice(first, first + 30000)
        u, v = (places[part].astype(np.float32).reshape(1, -1) for places in (x, y))
        found[part] = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=border)[0]
    return found


def lit(rng: np.random.Generator, canvas: Canvas, strength: float = 0.2) -> Canvas:
    """Uneven light over a picture, as a photograph has it."""
    height, width = canvas.shape[:2]
    u, v = grid((height, width))
    slope = rng.normal(size=2) * strength
    light = 1 + slope[0] * (u - 0.5) + slope[1] * (v - 0.5)
    light = light + strength * (noise(rng, (2, 3), 2, 0.5, (height, width)) - 0.5)
    return np.asarray(canvas * light[..., None], dtype=np.float32)
