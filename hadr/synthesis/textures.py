"""Busy procedural pictures for the surroundings: wood, cloth, books, leaves, tiles and more.

Each picture is 256 x 256, 8-bit sRGB, and is kept with its halved copies (a pyramid), so that
far surfaces look up a copy of the right coarseness.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

SIZE = 256
LEVELS = 7


def noise(rng: np.random.Generator, cells: int, octaves: int = 4, roughness: float = 0.55) -> Array:
    """Fractal value noise in [0, 1], shape (SIZE, SIZE), that repeats seamlessly."""
    total, weight = np.zeros((SIZE, SIZE)), 0.0
    for octave in range(octaves):
        n = min(cells * 2**octave, SIZE)
        grid = rng.random((n, n)).astype(np.float32)
        grid = np.pad(grid, 2, mode="wrap")
        scale = SIZE / n
        wide = cv2.resize(grid, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        edge = round(2 * scale)
        total += roughness**octave * wide[edge : edge + SIZE, edge : edge + SIZE]
        weight += roughness**octave
    value = total / weight
    return np.asarray((value - value.min()) / (np.ptp(value) + 1e-9))


def _ramp(value: Array, colors: list[tuple[float, float, float]]) -> Array:
    stops = np.linspace(0, 1, len(colors))
    c = np.asarray(colors)
    return np.stack([np.interp(value, stops, c[:, i]) for i in range(3)], axis=-1)


def _grid() -> tuple[Array, Array]:
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    return u, v


def _colors(rng: np.random.Generator, count: int) -> Array:
    """Colours as rooms have them: mostly warm or green, some blue, few of them loud; (count, 3)."""
    centers = np.array([8.0, 28.0, 42.0, 95.0, 140.0, 205.0, 225.0, 340.0])
    odds = np.array([0.16, 0.24, 0.18, 0.1, 0.08, 0.12, 0.08, 0.04])
    hsv = np.empty((1, count, 3), dtype=np.float32)
    hsv[0, :, 0] = (rng.choice(centers, count, p=odds) + 9 * rng.normal(size=count)) % 360
    hsv[0, :, 1] = rng.beta(1.5, 2.2, count)
    hsv[0, :, 2] = rng.uniform(0.25, 0.98, count)
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0], dtype=float)


def _wood(rng: np.random.Generator) -> Array:
    u, v = _grid()
    planks = int(rng.integers(3, 7))
    row = np.floor(v * planks)
    shift = rng.random(planks)[row.astype(int)]
    warp = noise(rng, 4, 3)
    rings = np.sin(
        (v * planks * 3.0 + 2.5 * warp + 7 * shift + 0.4 * np.sin(6.3 * (u + shift))) * 6.3
    )
    grain = cv2.GaussianBlur(rng.random((SIZE, SIZE)), (0, 0), sigmaX=9, sigmaY=0.6)
    grain = (grain - grain.mean()) / grain.std()
    palettes = [
        [(0.27, 0.14, 0.07), (0.50, 0.29, 0.15), (0.70, 0.46, 0.27)],
        [(0.50, 0.36, 0.22), (0.74, 0.57, 0.38), (0.88, 0.74, 0.55)],
        [(0.16, 0.06, 0.04), (0.36, 0.13, 0.08), (0.55, 0.24, 0.14)],
        [(0.55, 0.52, 0.48), (0.75, 0.72, 0.67), (0.90, 0.88, 0.84)],
    ]
    value = np.clip(0.5 + 0.22 * rings + 0.10 * grain + 0.5 * (shift - 0.5), 0, 1)
    image = _ramp(value, palettes[int(rng.integers(4))])
    gap = np.minimum((v * planks) % 1, 1 - (v * planks) % 1)
    return np.asarray(image * np.clip(gap * 30, 0.35, 1)[..., None])


def _leaves(rng: np.random.Generator) -> Array:
    palettes = [
        [(0.05, 0.12, 0.03), (0.16, 0.36, 0.08), (0.42, 0.62, 0.16), (0.80, 0.88, 0.42)],
        [(0.14, 0.09, 0.02), (0.55, 0.36, 0.06), (0.86, 0.66, 0.14), (0.97, 0.90, 0.52)],
        [(0.10, 0.05, 0.03), (0.50, 0.14, 0.06), (0.80, 0.35, 0.12), (0.95, 0.72, 0.40)],
    ]
    palette = np.asarray(palettes[int(rng.integers(3))])
    image = _ramp(noise(rng, 5, 5) * 0.5, [tuple(c) for c in palette]) * 0.7
    image = np.ascontiguousarray(image.astype(np.float32))
    for _ in range(420):
        center = rng.integers(0, SIZE, 2)
        length, width = rng.uniform(6, 22), rng.uniform(2.5, 7)
        color = palette[1] + (palette[3] - palette[1]) * rng.random() ** 1.5
        color = color * rng.uniform(0.6, 1.15)
        axes, angle = (round(length), max(round(width), 1)), float(rng.uniform(0, 180))
        center_xy = (int(center[0]), int(center[1]))
        cv2.ellipse(image, center_xy, axes, angle, 0, 360, color.tolist(), -1, cv2.LINE_AA)
        half = np.deg2rad(angle)
        tip = np.array([np.cos(half), np.sin(half)]) * length
        a, b = (center - tip).astype(int), (center + tip).astype(int)
        vein = (color * 1.25).tolist()
        cv2.line(image, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), vein, 1, cv2.LINE_AA)
    return np.asarray(image, dtype=float)


def _books(rng: np.random.Generator) -> Array:
    image = np.zeros((SIZE, SIZE, 3), dtype=np.float32)
    shelf_color = np.array([0.45, 0.28, 0.15]) * rng.uniform(0.5, 1.4)
    image[:] = shelf_color * 0.35
    rows = int(rng.integers(3, 5))
    height = SIZE // rows
    hues = _colors(rng, 9)
    for row in range(rows):
        x, floor = 0, (row + 1) * height - 5
        while x < SIZE:
            width = int(rng.integers(5, 15))
            tall = int(height * rng.uniform(0.58, 0.86))
            if rng.random() < 0.07:
                x += int(rng.integers(8, 25))
                continue
            color = np.clip(hues[int(rng.integers(9))] + 0.05 * rng.normal(size=3), 0.05, 1)
            round_back = 1 - 0.35 * np.abs(np.linspace(-1, 1, width))[None, :, None] ** 2
            block = image[floor - tall : floor, x : x + width]
            block[:] = (color * round_back)[:, : block.shape[1]]
            for _ in range(int(rng.integers(1, 4))):
                y = floor - int(tall * rng.uniform(0.1, 0.9))
                label = 0.9 if rng.random() < 0.5 else 0.15
                image[y : y + int(rng.integers(2, 7)), x + 1 : x + width - 1] = label * (
                    0.4 + color / 2
                )
            x += width + (rng.random() < 0.3)
        image[floor : floor + 5] = shelf_color
    return np.asarray(image, dtype=float)


def _cloth(rng: np.random.Generator) -> Array:
    u, v = _grid()
    colors = _colors(rng, 4)
    image = np.ones((SIZE, SIZE, 3)) * colors[0]
    for axis, w in ((u, colors[1]), (v, colors[2])):
        for _ in range(3):
            count, phase, wide = int(rng.integers(2, 9)), rng.random(), rng.uniform(0.1, 0.5)
            band = ((axis * count + phase) % 1) < wide
            image = np.where(band[..., None], 0.55 * image + 0.45 * w, image)
    weave = 0.92 + 0.08 * np.sin(u * SIZE * 1.6) * np.sin(v * SIZE * 1.6)
    fold = 0.75 + 0.45 * noise(rng, 3, 2)
    return np.asarray(image * (weave * fold)[..., None])


def _tiles(rng: np.random.Generator) -> Array:
    u, v = _grid()
    n = int(rng.integers(4, 9))
    offset = 0.5 * (np.floor(v * n * (2 if rng.random() < 0.5 else 1)) % 2)
    rows = n * 2 if rng.random() < 0.5 else n
    a, b = (u * n + offset), v * rows
    ids = (np.floor(a).astype(int) % n) * 31 + np.floor(b).astype(int) % rows
    base = 0.35 * _colors(rng, 1)[0] + 0.4
    tone = rng.normal(size=2048)[ids % 2048]
    hue = (_colors(rng, 2048) - 0.5)[ids % 2048]
    image = (
        base * (1 + 0.16 * tone[..., None])
        + 0.12 * hue
        + 0.15 * (noise(rng, 16, 4)[..., None] - 0.5)
    )
    edge = np.minimum(np.minimum(a % 1, 1 - a % 1) / n, np.minimum(b % 1, 1 - b % 1) / rows) * SIZE
    joint = np.clip(edge - 0.6, 0, 1)[..., None]
    return np.asarray(image * joint + 0.75 * rng.random() * (1 - joint))


def _painting(rng: np.random.Generator) -> Array:
    image = _ramp(noise(rng, 3, 5), [tuple(c) for c in _colors(rng, 5)]).astype(np.float32)
    image = np.ascontiguousarray(image)
    for _ in range(26):
        points = rng.integers(0, SIZE, 2) + rng.normal(
            size=(int(rng.integers(3, 7)), 2)
        ) * rng.uniform(8, 60)
        color = _colors(rng, 1)[0]
        if rng.random() < 0.6:
            hull = cv2.convexHull(points.astype(np.int32))
            cv2.fillConvexPoly(image, hull, color.tolist(), cv2.LINE_AA)
        else:
            thick = int(rng.integers(1, 6))
            cv2.polylines(
                image, [points.astype(np.int32)], False, color.tolist(), thick, cv2.LINE_AA
            )
    return np.asarray(image * (0.8 + 0.4 * noise(rng, 20, 3))[..., None])


def _print(rng: np.random.Generator) -> Array:
    paper = np.array([0.93, 0.91, 0.86]) * rng.uniform(0.85, 1.0)
    image = np.ones((SIZE, SIZE, 3)) * paper
    y = 8
    while y < SIZE - 12:
        kind = rng.random()
        if kind < 0.22:
            h = int(rng.integers(26, 70))
            colors = [tuple(c) for c in _colors(rng, 4)]
            x0, x1 = int(rng.integers(6, 60)), int(rng.integers(120, SIZE - 6))
            image[y : y + h, x0:x1] = _ramp(noise(rng, 4, 4), colors)[y : y + h, x0:x1]
            y += h + 6
        elif kind < 0.32:
            image[y : y + 9, 10 : int(rng.integers(90, SIZE - 10))] = rng.random(3) * 0.4
            y += 15
        else:
            words = np.repeat(rng.random(SIZE // 4) < 0.78, 4)
            words[:10] = False
            words[SIZE - 10 :] = False
            image[y : y + 2, words] = 0.25
            y += 5
    return np.asarray(image)


def _stone(rng: np.random.Generator) -> Array:
    value = noise(rng, 4, 6, 0.65)
    vein = np.abs(noise(rng, 3, 5) - 0.5) * 2
    light = rng.random() < 0.6
    colors = [(0.45, 0.43, 0.41), (0.72, 0.70, 0.66), (0.93, 0.92, 0.90)]
    image = _ramp(
        value, colors if light else [(0.08, 0.08, 0.1), (0.2, 0.2, 0.22), (0.42, 0.4, 0.4)]
    )
    image *= rng.uniform(0.85, 1.1, 3)
    return np.asarray(image * np.clip(vein * 5, 0.55, 1)[..., None])


def _window(rng: np.random.Generator) -> Array:
    u, v = _grid()
    sky = _ramp(
        1 - v + 0.2 * (noise(rng, 4, 4) - 0.5),
        [(0.55, 0.62, 0.5), (0.85, 0.9, 0.95), (0.7, 0.85, 1)],
    )
    trees = noise(rng, 6, 5) > (0.35 + 0.6 * (1 - v))
    leaves = _leaves(rng)
    image = np.where(trees[..., None], leaves, sky * 1.0)
    nx, ny = int(rng.integers(2, 4)), int(rng.integers(2, 4))
    frame = (np.minimum((u * nx) % 1, 1 - (u * nx) % 1) / nx < 0.014) | (
        np.minimum((v * ny) % 1, 1 - (v * ny) % 1) / ny < 0.014
    )
    return np.asarray(np.where(frame[..., None], rng.uniform(0.2, 0.95), image))


def _branches(rng: np.random.Generator) -> Array:
    ground = _ramp(noise(rng, 3, 3), [tuple(c) for c in (_colors(rng, 3) * 0.5 + 0.45)])
    image = np.ascontiguousarray(ground.astype(np.float32))
    ink = (
        (rng.random(3) * 0.25).tolist()
        if rng.random() < 0.6
        else (0.85 + 0.1 * rng.random(3)).tolist()
    )
    for _ in range(46):
        point, heading = rng.random(2) * SIZE, rng.uniform(0, 2 * np.pi)
        line = [point]
        for _ in range(26):
            heading += rng.normal() * 0.35
            point = point + 6 * np.array([np.cos(heading), np.sin(heading)])
            line.append(point)
        path = np.asarray(line).astype(np.int32)
        cv2.polylines(image, [path], False, ink, int(rng.integers(1, 4)), cv2.LINE_AA)
    return np.asarray(image, dtype=float)


_MAKERS: tuple[Callable[[np.random.Generator], Array], ...] = (
    _wood,
    _leaves,
    _books,
    _cloth,
    _tiles,
    _painting,
    _print,
    _stone,
    _window,
    _branches,
)
#: Names of the kinds of picture, in the order of :data:`COUNT`'s cycle.
KINDS: tuple[str, ...] = tuple(maker.__name__[1:] for maker in _MAKERS)
#: How many different pictures the library holds.
COUNT = 5 * len(_MAKERS)
#: First pixel of each level in a flattened pyramid.
OFFSETS: tuple[int, ...] = tuple(
    int(sum((SIZE >> k) ** 2 for k in range(level))) for level in range(LEVELS)
)


@lru_cache(maxsize=1)
def library() -> Image:
    """All pictures with their pyramids, shape (COUNT, pixels of all levels, 3), uint8 sRGB."""
    pictures = []
    for number in range(COUNT):
        rng = np.random.default_rng([20240917, number])
        image = np.clip(_MAKERS[number % len(_MAKERS)](rng), 0, 1)
        level = (image * 255).round().astype(np.uint8)
        flat = [level.reshape(-1, 3)]
        for _ in range(LEVELS - 1):
            half = (level.shape[1] // 2, level.shape[0] // 2)
            level = cv2.resize(level, half, interpolation=cv2.INTER_AREA)
            flat.append(level.reshape(-1, 3))
        pictures.append(np.concatenate(flat))
    return np.stack(pictures)


@lru_cache(maxsize=COUNT)
def pyramid(number: int) -> tuple[Image, ...]:
    """A picture and its halved copies, sRGB, shapes (SIZE, SIZE, 3), (SIZE / 2, ...) and so on."""
    flat = library()[number]
    sizes = [SIZE >> level for level in range(LEVELS)]
    return tuple(
        flat[start : start + n * n].reshape(n, n, 3)
        for start, n in zip(OFFSETS, sizes, strict=True)
    )


def sample(number: Array, uv: Array, texels: Array) -> Array:
    """Look colours up, bilinearly in the level whose pixels are about as large as asked for.

    Args:
        number: Picture of each look-up, whole numbers below COUNT, shape (N,).
        uv: Coordinates; one unit is one repeat, shape (N, 2).
        texels: Size of a look-up in pixels of the finest level, shape (N,).

    Returns:
        Linear RGB in [0, 1], shape (N, 3).
    """
    level = np.clip(np.round(np.log2(np.maximum(texels, 1.0))), 0, LEVELS - 1).astype(np.int64)
    size = SIZE >> level
    x = (uv[:, 0] % 1.0) * size - 0.5
    y = (uv[:, 1] % 1.0) * size - 0.5
    x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - x0)[:, None].astype(np.float32), (y - y0)[:, None].astype(np.float32)
    start = np.asarray(OFFSETS)[level]
    pixels = library()
    flat = pixels.reshape(-1, 3)
    base = number.astype(np.int64) * pixels.shape[1] + start
    x1, y1 = (x0 + 1) & (size - 1), (y0 + 1) & (size - 1)
    x0, y0 = x0 & (size - 1), y0 & (size - 1)
    top = flat[base + y0 * size + x0] * (1 - fx) + flat[base + y0 * size + x1] * fx
    bottom = flat[base + y1 * size + x0] * (1 - fx) + flat[base + y1 * size + x1] * fx
    srgb = (top * (1 - fy) + bottom * fy) / 255.0
    return np.asarray(srgb**2.2)
