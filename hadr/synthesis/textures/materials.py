"""Procedural textures of what tables, floors and walls are made of; they repeat without seams."""

from __future__ import annotations

import cv2
import numpy as np

from hadr.synthesis.textures.noise import (
    SIZE,
    Canvas,
    grid,
    leaf_polygons,
    lit,
    noise,
    ramp,
    room_colors,
    shapes,
)

_WOODS = (
    ((0.36, 0.22, 0.13), (0.55, 0.36, 0.21), (0.70, 0.49, 0.31)),
    ((0.58, 0.44, 0.29), (0.76, 0.61, 0.43), (0.88, 0.75, 0.57)),
    ((0.30, 0.13, 0.08), (0.48, 0.22, 0.13), (0.63, 0.34, 0.21)),
    ((0.60, 0.57, 0.53), (0.76, 0.73, 0.69), (0.89, 0.87, 0.83)),
    ((0.72, 0.66, 0.58), (0.85, 0.80, 0.72), (0.94, 0.91, 0.86)),
)

_BRICKS = (
    ((0.55, 0.30, 0.23), (0.72, 0.46, 0.36)),
    ((0.45, 0.45, 0.47), (0.62, 0.62, 0.64)),
    ((0.60, 0.52, 0.44), (0.78, 0.71, 0.62)),
    ((0.86, 0.84, 0.80), (0.94, 0.93, 0.91)),
    ((0.33, 0.36, 0.38), (0.50, 0.47, 0.45)),
)


def wood(rng: np.random.Generator) -> Canvas:
    """Planks with grain, few of them with knots."""
    u, v = grid()
    planks = int(rng.integers(4, 9))
    row = np.floor(v * planks).astype(int) % planks
    shift, tone = rng.random(planks)[row], rng.normal(size=planks)[row]
    streaks = noise(rng, (64, 3), 3, 0.6)
    broad = noise(rng, (planks * 2, 2), 3, 0.5)
    rings = np.sin((broad * 5 + v * planks * 2 + shift * 9) * 6.3)
    value = 0.5 + 0.13 * rings + 0.5 * (streaks - 0.5) + 0.13 * tone
    image = ramp(np.clip(value, 0, 1).astype(np.float32), _WOODS[int(rng.integers(5))])
    gap = np.minimum((v * planks) % 1, 1 - (v * planks) % 1) / planks * SIZE
    ends = np.abs((u - shift + 0.5) % 1 - 0.5) * SIZE
    joint = np.clip(np.minimum(gap, ends) / 1.6, 0.35, 1)
    return np.asarray(image * joint[..., None], dtype=np.float32)


def boards(rng: np.random.Generator) -> Canvas:
    """White or pale siding: boards that overlap, each with a shaded lower edge."""
    _, v = grid()
    count = int(rng.integers(7, 15))
    within = (v * count) % 1
    base = np.array([0.93, 0.93, 0.91]) if rng.random() < 0.6 else room_colors(rng, 1, pale=0.65)[0]
    light = 0.86 + 0.12 * within - 0.42 * np.exp(-((within / 0.05) ** 2))
    dirt = 0.94 + 0.10 * noise(rng, (4, 12), 4)
    grain = 0.97 + 0.06 * noise(rng, (128, 6), 2)
    return np.asarray(base * (light * dirt * grain)[..., None], dtype=np.float32)


def shingles(rng: np.random.Generator) -> Canvas:
    """Roof shingles or bricks in staggered rows."""
    u, v = grid()
    rows = int(rng.integers(8, 15))
    columns = int(rng.integers(5, 9))
    r = np.floor(v * rows)
    a = u * columns + 0.5 * (r % 2) + 0.04 * np.sin(r * 5)
    ids = ((np.floor(a).astype(int) % columns) * 37 + r.astype(int) * 11) % 997
    tone = rng.normal(size=997)[ids]
    base = np.asarray(_BRICKS[int(rng.integers(len(_BRICKS)))])
    mix = np.clip(0.5 + 0.3 * tone, 0, 1)[..., None]
    image = base[0] * mix + base[1] * (1 - mix)
    image = image * (0.85 + 0.3 * noise(rng, (32, 32), 3))[..., None]
    edge = np.minimum((a % 1) / columns, (v * rows % 1) / rows) * SIZE
    return np.asarray(image * np.clip(edge / 3.0, 0.4, 1)[..., None], dtype=np.float32)


def tiles(rng: np.random.Generator) -> Canvas:
    """Floor or wall tiles, each one a little different, with joints."""
    u, v = grid()
    n = int(rng.integers(3, 7))
    a, b = u * n, v * n
    ids = (np.floor(a).astype(int) % n) * 31 + np.floor(b).astype(int) % n
    colors = room_colors(rng, 2, pale=0.55)
    checked = (np.floor(a) + np.floor(b)) % 2
    if n % 2 or rng.random() < 0.5:
        checked = np.zeros_like(checked)
    image = np.where(checked[..., None] > 0, colors[0], colors[1])
    clouds = noise(rng, (5, 5), 5, 0.6)
    veins = np.clip(np.abs(noise(rng, (4, 4), 5) - 0.5) * 9, 0, 1)
    image = image * (1 + 0.07 * rng.normal(size=400)[ids % 400])[..., None]
    image = image * (0.88 + 0.16 * clouds + 0.06 * veins)[..., None]
    edge = np.minimum(np.minimum(a % 1, 1 - a % 1), np.minimum(b % 1, 1 - b % 1)) / n * SIZE
    joint = np.clip(edge / 2 - 0.4, 0, 1)[..., None]
    return np.asarray(image * joint + rng.uniform(0.45, 0.85) * (1 - joint), dtype=np.float32)


def marble(rng: np.random.Generator) -> Canvas:
    """Marble or slate: clouds and thin veins."""
    cloud = noise(rng, (3, 3), 6, 0.6)
    bend = noise(rng, (2, 3), 5, 0.55)
    vein = np.abs(noise(rng, (3, 3), 5, 0.6) - bend)
    base = room_colors(rng, 2, pale=0.8)
    if rng.random() < 0.2:
        base = base * 0.35
    image = ramp(cloud, [base[0] * 0.86, base[1], np.minimum(base[0] * 1.06, 0.97)])
    line = np.exp(-((vein / 0.02) ** 2))[..., None]
    return np.asarray(image * (1 - 0.35 * line) + 0.1 * line * base[1], dtype=np.float32)


def terrazzo(rng: np.random.Generator) -> Canvas:
    """Chips of stone in a pale ground."""
    colors = room_colors(rng, 6, pale=0.3)
    ground = np.full((SIZE, SIZE, 3), 0.86, dtype=np.float32) * (0.7 + 0.3 * colors[0])
    canvas = ground.astype(np.float32)
    n = 700
    angle = np.sort(rng.random((n, 6)) * 2 * np.pi, axis=1)
    size = rng.gamma(2.5, 2.4, n)
    ring = np.stack([np.cos(angle), np.sin(angle)], -1) * size[:, None, None]
    polygons = ring + rng.random((n, 1, 2)) * SIZE
    shapes(canvas, polygons, colors[rng.integers(0, 6, n)] * rng.uniform(0.8, 1.1, (n, 1)), 40)
    return np.asarray(canvas * (0.92 + 0.12 * noise(rng, (6, 6), 5))[..., None], dtype=np.float32)


def _folds(rng: np.random.Generator, image: Canvas) -> Canvas:
    weave = rng.normal(size=(SIZE, SIZE)).astype(np.float32) * 0.02
    fold = 0.82 + 0.32 * noise(rng, (2, 3), 3, 0.4)
    return np.asarray(image * (weave + fold)[..., None], dtype=np.float32)


def plaid(rng: np.random.Generator) -> Canvas:
    """Woven cloth with stripes both ways."""
    colors = room_colors(rng, 4, pale=0.3)
    lines = []
    for _ in range(2):
        line = np.tile(colors[0], (SIZE, 1))
        t = np.arange(SIZE) / SIZE
        for k in range(1, 4):
            count, phase, wide = int(rng.integers(2, 7)), rng.random(), rng.uniform(0.05, 0.4)
            band = ((t * count + phase) % 1 < wide)[:, None]
            line = np.where(band, 0.3 * line + 0.7 * colors[k], line)
        lines.append(line)
    image = 0.5 * (lines[0][None] + lines[1][:, None])
    return _folds(rng, image.astype(np.float32))


def print_cloth(rng: np.random.Generator) -> Canvas:
    """Cloth printed with flowers and leaves on a repeating ground."""
    colors = room_colors(rng, 5, pale=0.2)
    ground = room_colors(rng, 1, pale=rng.uniform(0.2, 0.9))[0]
    canvas = np.tile(ground.astype(np.float32), (SIZE, SIZE, 1))
    count = int(rng.integers(14, 40))
    centers = rng.random((count, 2)) * SIZE
    scale = rng.uniform(12, 26)
    for layer in range(2):
        petals = int(rng.integers(5, 9))
        angle = rng.random(count)[:, None] * 7 + np.arange(petals) * 2 * np.pi / petals
        reach = scale * (1.0 - 0.45 * layer)
        middle = centers[:, None] + 0.5 * reach * np.stack([np.cos(angle), np.sin(angle)], -1)
        flat = middle.reshape(-1, 2)
        n = len(flat)
        polygons = leaf_polygons(flat, np.full(n, reach), np.full(n, 0.5 * reach), angle.ravel())
        tone = np.repeat(colors[rng.integers(0, 5, count)], petals, axis=0)
        copies = [polygons + np.array([dx, dy]) * SIZE for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
        shapes(canvas, np.concatenate(copies), np.tile(tone, (9, 1)), 20)
    return _folds(rng, canvas)


def carpet(rng: np.random.Generator) -> Canvas:
    """A rug with mirrored ornaments, soft from its pile."""
    colors = room_colors(rng, 5, pale=0.1)
    half = ramp(noise(rng, (6, 6), 2, 0.6, (SIZE // 2, SIZE // 2)), list(colors))
    steps = np.round(half * 7) / 7
    top = np.concatenate([steps, steps[:, ::-1]], axis=1)
    image = np.concatenate([top, top[::-1]], axis=0).astype(np.float32)
    for color, inset in zip(colors, (4, 16, 22, 44), strict=False):
        ends = (inset, inset), (SIZE - inset, SIZE - inset)
        cv2.rectangle(image, *ends, color.tolist(), int(rng.integers(2, 11)))
    pile = 0.93 + 0.14 * rng.random((SIZE, SIZE), dtype=np.float32)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8) * pile[..., None], dtype=np.float32)


def plaster(rng: np.random.Generator) -> Canvas:
    """A painted wall, a little rough and stained."""
    base = room_colors(rng, 1, pale=rng.uniform(0.4, 0.9))[0]
    rough = noise(rng, (24, 24), 4, 0.7) - 0.5
    stain = noise(rng, (3, 3), 5, 0.5) - 0.5
    return lit(rng, np.asarray(base * (1 + 0.10 * rough + 0.12 * stain)[..., None], np.float32))


def pebbles(rng: np.random.Generator) -> Canvas:
    """Gravel or paving of rounded stones."""
    colors = 0.4 * room_colors(rng, 4, pale=0.5) + 0.6 * np.array([0.66, 0.64, 0.61])
    canvas = np.tile((colors[0] * 0.45).astype(np.float32), (SIZE, SIZE, 1))
    n = 1500
    angle = np.arange(10) * 2 * np.pi / 10
    size = rng.uniform(4, 13, n) * rng.uniform(0.6, 1.3)
    wobble = rng.uniform(0.8, 1.15, (n, 10))
    ring = np.stack([np.cos(angle), 0.8 * np.sin(angle)], -1)[None] * wobble[..., None]
    ring = ring * size[:, None, None]
    centers = rng.random((n, 1, 2)) * SIZE
    tone = colors[rng.integers(0, 4, n)] * rng.uniform(0.7, 1.1, (n, 1))
    shapes(canvas, ring + centers, tone * 0.75, 60)
    shapes(canvas, 0.75 * ring + centers - 0.12 * size[:, None, None], tone, 60)
    return np.asarray(canvas * (0.9 + 0.2 * noise(rng, (40, 40), 3))[..., None], dtype=np.float32)
