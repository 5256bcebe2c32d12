"""Procedural textures of what grows: leaf walls, grass, branches, flowers."""

from __future__ import annotations

import cv2
import numpy as np

from hadr.camera import Array
from hadr.synthesis.textures.noise import (
    SIZE,
    Box,
    Canvas,
    hsv,
    leaf_polygons,
    noise,
    ramp,
    room_colors,
    shapes,
)

#: Hue and its spread, saturation, of foliage through the year.
SEASONS = ((96.0, 14.0, 0.62), (84.0, 18.0, 0.55), (48.0, 9.0, 0.75), (26.0, 14.0, 0.78))


def season_colors(rng: np.random.Generator, count: int, season: int) -> Array:
    """Colours of leaves in one season, shape (count, 3), brightness around 1 before shading."""
    hue, spread, saturation = SEASONS[season]
    table = [
        hsv(hue + rng.normal() * spread, saturation * rng.uniform(0.65, 1.05), 1.0)
        for _ in range(24)
    ]
    return np.asarray(table)[rng.integers(0, 24, count)]


def paint_leaves(
    rng: np.random.Generator,
    canvas: Canvas,
    box: Box,
    size: float,
    count: int,
    season: int,
    *,
    light: float,
    round_off: bool = True,
) -> None:
    """Paint a mass of leaves, ``size`` pixels long, the deep ones dark, those on top bright.

    They make up a crown or bush of several balls, or fill the box without ``round_off``.
    """
    height, width = canvas.shape[:2]
    x0, y0, x1, y1 = box
    within = rng.random((count, 2))
    if round_off:
        balls = np.stack([rng.uniform(0.22, 0.78, 9), rng.uniform(0.22, 0.85, 9)], axis=1)
        angle, reach = rng.uniform(0, 2 * np.pi, count), 0.24 * np.sqrt(rng.random(count))
        reach = reach * (1 + 0.12 * rng.normal(size=count))
        spot = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)
        within = balls[rng.integers(0, 9, count)] + spot
    centers = (np.array([x0, y0]) + within * np.array([x1 - x0, y1 - y0])) * [width, height]
    clumps = noise(rng, (5, 7), 3, 0.6, (64, 64))
    column = np.clip(centers[:, 0] / width * 63, 0, 63).astype(int)
    row = np.clip(centers[:, 1] / height * 63, 0, 63).astype(int)
    depth = np.linspace(0, 1, count)
    shade = (0.16 + 0.78 * depth**1.3) * (0.55 + 0.75 * clumps[row, column])
    colors = season_colors(rng, count, season) * shade[:, None] * rng.uniform(0.8, 1.15, (count, 1))
    # Light that falls through the uppermost leaves makes them pale.
    pale = np.clip(shade - 0.75, 0, 1)[:, None]
    colors = np.clip(colors * light * (1 - pale) + pale * np.array([0.97, 0.98, 0.88]), 0, 1)
    lengths = size * rng.uniform(0.6, 1.3, count)
    angles = rng.normal(size=count) * 0.9 + rng.choice([0.6, 2.4], count)
    polygons = leaf_polygons(centers, lengths, lengths * rng.uniform(0.28, 0.5, count), angles)
    shapes(canvas, polygons, colors, 44)


def leaf_wall(rng: np.random.Generator) -> Canvas:
    """A hedge or ivy close by."""
    season = int(rng.choice(4, p=(0.4, 0.3, 0.18, 0.12)))
    dark = season_colors(rng, 1, season)[0] * 0.16
    canvas = np.tile(dark.astype(np.float32), (SIZE, SIZE, 1))
    size = rng.uniform(16, 46)
    box = (-0.05, -0.05, 1.05, 1.05)
    count = int(9.0e5 / size**1.8)
    paint_leaves(rng, canvas, box, size, count, season, light=rng.uniform(1, 1.2), round_off=False)
    return canvas


def big_leaves(rng: np.random.Generator) -> Canvas:
    """A house plant's large leaves with their ribs."""
    ground = room_colors(rng, 2, pale=0.6)
    canvas = ramp(noise(rng, (2, 2), 3), list(ground)) * np.float32(0.9)
    season = int(rng.integers(0, 2))
    count = int(rng.integers(16, 34))
    for k in range(count):
        shade = 0.25 + 0.65 * k / count
        color = season_colors(rng, 1, season)[0] * shade * rng.uniform(0.8, 1.1)
        center = rng.random(2) * SIZE
        length, angle = rng.uniform(130, 260), rng.uniform(0, 2 * np.pi)
        width = length * rng.uniform(0.3, 0.5)
        one = np.ones(1)
        outline = leaf_polygons(center[None], one * length, one * width, one * angle)
        for layer, factor in ((1.0, 1.0), (0.55, 1.13)):
            part = center + (outline - center) * np.array([layer])
            shapes(canvas, part, np.minimum(color * factor, 1)[None], 1)
        tip = np.array([np.cos(angle), np.sin(angle)])
        side = np.array([-tip[1], tip[0]])
        rib = np.minimum(color * 1.45 + 0.06, 1).tolist()
        a, b = center - tip * length * 0.5, center + tip * length * 0.48
        lines = [np.stack([a, b])]
        for along in np.linspace(0.15, 0.85, 7):
            start, reach = a + (b - a) * along, width * 0.42 * np.sin(np.pi * along)
            ends = (start + sign * side * reach + tip * reach * 0.7 for sign in (-1, 1))
            lines += [np.stack([start, end]) for end in ends]
        drawn = [np.round(line * 16).astype(np.int32) for line in lines]
        cv2.polylines(canvas, drawn, False, rib, 1, cv2.LINE_AA, 4)
    return canvas


def branches(rng: np.random.Generator) -> Canvas:
    """Twigs that fork before a pale wall, with a few leaves or blossoms."""
    ground = room_colors(rng, 2, pale=rng.uniform(0.2, 0.9))
    canvas = ramp(noise(rng, (2, 3), 4), list(ground))
    dark = rng.random() < 0.7
    ink = np.array([0.20, 0.14, 0.10]) if dark else np.array([0.93, 0.92, 0.90])
    tips = []
    for _ in range(int(rng.integers(8, 16))):
        point, heading = rng.random(2) * SIZE, rng.uniform(0, 2 * np.pi)
        stack = [(point, heading, rng.uniform(3, 6))]
        while stack:
            at, way, thick = stack.pop()
            path = [at]
            for _ in range(int(rng.integers(6, 13))):
                way += rng.normal() * 0.22
                at = at + 11 * np.array([np.cos(way), np.sin(way)])
                path.append(at)
            drawn = np.round(np.asarray(path) * 16).astype(np.int32)
            tone = np.clip(ink * rng.uniform(0.8, 1.2), 0, 1).tolist()
            cv2.polylines(canvas, [drawn], False, tone, max(int(thick), 1), cv2.LINE_AA, 4)
            tips += path[3:]
            if thick > 1.4:
                for fork in (0.5, -0.6):
                    stack.append((at, way + fork * rng.uniform(0.5, 1.4), thick * 0.62))
    centers = np.asarray(tips)
    centers = centers[rng.random(len(centers)) < rng.uniform(0.1, 0.7)]
    if len(centers):
        n = len(centers)
        centers = centers + rng.normal(size=(n, 2)) * 7
        season = int(rng.integers(0, 4))
        colors = season_colors(rng, n, season) * rng.uniform(0.5, 1.0, (n, 1))
        if rng.random() < 0.4:
            colors = np.array([0.97, 0.86, 0.88]) * rng.uniform(0.8, 1.0, (n, 1))
        lengths = rng.uniform(10, 24, n)
        leaves = leaf_polygons(centers, lengths, 0.45 * lengths, rng.uniform(0, 7, n))
        shapes(canvas, leaves, colors, 30)
    return canvas


def grass(rng: np.random.Generator) -> Canvas:
    """A meadow from above, with fallen leaves or flowers."""
    season = int(rng.integers(0, 3))
    base = season_colors(rng, 1, int(rng.integers(0, 2)))[0] * 0.3
    canvas = np.tile(base.astype(np.float32), (SIZE, SIZE, 1))
    n = 5200
    angles = rng.normal(size=n) * 0.5 + np.pi / 2
    lengths = rng.uniform(9, 24, n)
    shade = np.linspace(0.3, 0.95, n) * rng.uniform(0.75, 1.1, n)
    colors = season_colors(rng, n, int(rng.integers(0, 2))) * shade[:, None]
    blades = leaf_polygons(rng.random((n, 2)) * SIZE, lengths, 0.13 * lengths, angles)
    shapes(canvas, blades, colors)
    count = int(rng.integers(30, 260))
    lengths, places = rng.uniform(8, 17, count), rng.random((count, 2)) * SIZE
    fallen = leaf_polygons(places, lengths, 0.6 * lengths, rng.uniform(0, 7, count))
    tone = season_colors(rng, count, max(season, 1) + int(rng.integers(0, 2)))
    shapes(canvas, fallen, np.clip(tone * rng.uniform(0.7, 1.05, (count, 1)), 0, 1))
    return canvas


def flowers(rng: np.random.Generator) -> Canvas:
    """A bed of flowers over leaves."""
    canvas = leaf_wall(rng) * np.float32(0.9)
    colors = room_colors(rng, 3, pale=0.15)
    count = int(rng.integers(40, 110))
    centers = rng.random((count, 2)) * SIZE
    reach = rng.uniform(11, 26, count)
    petals = 6
    angle = rng.random((count, 1)) * 7 + np.arange(petals) * 2 * np.pi / petals
    spokes = np.stack([np.cos(angle), np.sin(angle)], -1)
    middle = centers[:, None] + 0.5 * reach[:, None, None] * spokes
    size = np.repeat(reach, petals)
    tone = np.repeat(colors[rng.integers(0, 3, count)], petals, axis=0)
    tone = np.clip(tone * rng.uniform(0.75, 1.15, (len(size), 1)), 0, 1)
    shapes(canvas, leaf_polygons(middle.reshape(-1, 2), size, 0.6 * size, angle.ravel()), tone)
    heart = leaf_polygons(centers, reach * 0.5, reach * 0.5, np.zeros(count))
    shapes(canvas, heart, np.tile([0.93, 0.78, 0.25], (count, 1)))
    return canvas
