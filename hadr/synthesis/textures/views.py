"""Procedural textures of places: gardens, houses, rooms, bookshelves, streets, printed pages."""

from __future__ import annotations

import cv2
import numpy as np

from hadr.camera import Array
from hadr.synthesis.textures.materials import boards, carpet, plaid, shingles, wood
from hadr.synthesis.textures.noise import (
    SIZE,
    Box,
    Canvas,
    grid,
    lit,
    noise,
    ramp,
    rectangle,
    room_colors,
    shadow,
    shapes,
)
from hadr.synthesis.textures.plants import paint_leaves, season_colors

_SHAPE = (SIZE, SIZE + SIZE // 2)


def _blank(color: Array) -> Canvas:
    return np.full((*_SHAPE, 3), color, dtype=np.float32)


def _paste(canvas: Canvas, picture: Canvas, box: Box) -> None:
    """Put a picture into a box, cut off at the border."""
    height, width = canvas.shape[:2]
    left, right = round(box[0] * width), round(box[2] * width)
    top, bottom = round(box[1] * height), round(box[3] * height)
    if right - left < 2 or bottom - top < 2:
        return
    fitted = cv2.resize(picture, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
    y0, x0 = max(top, 0), max(left, 0)
    part = canvas[y0 : max(bottom, 0), x0 : max(right, 0)]
    part[:] = fitted[y0 - top : y0 - top + part.shape[0], x0 - left : x0 - left + part.shape[1]]


def _sky(rng: np.random.Generator) -> Canvas:
    _, v = grid(_SHAPE)
    tops = (
        ((0.42, 0.62, 0.88), (0.72, 0.84, 0.96), (0.93, 0.95, 0.96)),
        ((0.75, 0.80, 0.86), (0.87, 0.89, 0.92), (0.95, 0.95, 0.94)),
        ((0.55, 0.60, 0.78), (0.93, 0.78, 0.66), (0.98, 0.90, 0.76)),
    )
    sky = ramp(np.clip(v * 1.6, 0, 1), tops[int(rng.integers(3))])
    cloud = np.clip(noise(rng, (3, 3), 5, 0.55, _SHAPE) * 2.2 - 1.05, 0, 1)[..., None]
    return np.asarray(sky * (1 - 0.8 * cloud) + 0.8 * cloud * 0.98, dtype=np.float32)


def _grown(box: Box, x: float, y: float) -> Box:
    """A box with a frame around it."""
    return box[0] - x, box[1] - y, box[2] + x, box[3] + y


def _window(rng: np.random.Generator, canvas: Canvas, box: Box) -> None:
    """A house's window: frame, panes that mirror the sky, curtains, a sill and its shadow."""
    x0, y0, x1, y1 = box
    shadow(canvas, (x0, y0, x1 + 0.006, y1 + 0.02), 0.4, 0.02)
    rectangle(canvas, box, np.array([0.96, 0.96, 0.95]))
    mx, my = 0.07 * (x1 - x0), 0.06 * (y1 - y0)
    nx, ny = int(rng.integers(2, 4)), int(rng.integers(2, 5))
    dark = rng.uniform(0.12, 0.45)
    for i in range(nx):
        for j in range(ny):
            a = x0 + mx + (x1 - x0 - mx) * i / nx
            b = y0 + my + (y1 - y0 - my) * j / ny
            pane = (a, b, a + (x1 - x0 - mx) / nx - mx, b + (y1 - y0 - my) / ny - my)
            glow = dark * rng.uniform(0.8, 1.3) + 0.2 * (1 - j / ny) * rng.random()
            rectangle(canvas, pane, np.array([0.85, 0.95, 1.05]) * glow)
    rectangle(canvas, (x0 - mx, y1, x1 + mx, y1 + my), np.array([0.9, 0.9, 0.88]))


def _house(
    rng: np.random.Generator, canvas: Canvas, left: float, right: float, ground: float
) -> None:
    """A house with siding or bricks, windows, a door, and a roof with shingles."""
    eaves = rng.uniform(0.12, 0.30)
    wall = boards(rng) if rng.random() < 0.7 else shingles(rng)
    _paste(canvas, np.tile(wall, (1, 2, 1)), (left, eaves, right, ground))
    shadow(canvas, (left, eaves, right, eaves + 0.05), 0.45, 0.03)
    columns = int(rng.integers(2, 5))
    pitch = (right - left) / columns
    for i in range(columns):
        for story in range(2):
            top = eaves + 0.07 + story * (ground - eaves) * 0.5
            x = left + pitch * (i + 0.22)
            if rng.random() < 0.85:
                _window(rng, canvas, (x, top, x + 0.55 * pitch, top + 0.30 * (ground - eaves)))
    door = left + pitch * (int(rng.integers(columns)) + 0.25)
    tone = room_colors(rng, 1, pale=0.1)[0]
    top = ground - 0.34 * (ground - eaves)
    rectangle(canvas, (door - 0.01, top - 0.015, door + 0.45 * pitch + 0.01, ground), 0.93)
    rectangle(canvas, (door, top, door + 0.45 * pitch, ground), tone)
    peak = rng.uniform(-0.15, 0.05)
    height, width = canvas.shape[:2]
    roof = cv2.resize(np.tile(shingles(rng), (1, 2, 1))[:, :width], (width, height))
    ridge = left + rng.uniform(0.02, 0.2), right - rng.uniform(0.02, 0.2)
    places = [left - 0.03, *ridge, right + 0.03]
    heights = [eaves + 0.012, peak, peak, eaves + 0.012]
    corners = np.stack([places, heights], axis=1) * [width, height]
    mask = np.zeros(canvas.shape[:2], dtype=np.float32)
    cv2.fillPoly(mask, [np.round(corners).astype(np.int32)], 1.0, cv2.LINE_AA)
    canvas *= 1 - mask[..., None]
    canvas += roof * mask[..., None]


def garden(rng: np.random.Generator) -> Canvas:
    """Lawn, hedge, trees and often a house under a sky."""
    canvas = _sky(rng)
    ground = rng.uniform(0.58, 0.75)
    season = int(rng.choice(4, p=(0.35, 0.25, 0.22, 0.18)))
    for _ in range(int(rng.integers(2, 5))):
        x, wide = rng.uniform(-0.1, 0.9), rng.uniform(0.2, 0.45)
        top = rng.uniform(0.0, 0.35)
        size = rng.uniform(7, 12)
        paint_leaves(rng, canvas, (x, top, x + wide, ground), size, 2300, season, light=1.1)
    if rng.random() < 0.65:
        left = rng.uniform(-0.15, 0.4)
        _house(rng, canvas, left, left + rng.uniform(0.4, 0.8), ground + 0.02)
    _, v = grid(_SHAPE)
    lawn = season_colors(rng, 8, int(rng.integers(0, 2))).mean(0)
    blades = noise(rng, (40, 90), 3, 0.7, _SHAPE)
    far = np.clip((v - ground) / (1 - ground), 0, 1)
    tone = (0.60 + 0.35 * blades) * (0.95 - 0.15 * far)
    below = (v > ground)[..., None]
    if rng.random() < 0.3:
        lawn = np.array([0.80, 0.77, 0.72])
    canvas = np.where(below, lawn.astype(np.float32) * tone[..., None], canvas).astype(np.float32)
    for _ in range(int(rng.integers(2, 6))):
        x, wide = rng.uniform(-0.1, 1.0), rng.uniform(0.12, 0.4)
        tall = rng.uniform(0.08, 0.25)
        kind = season if rng.random() < 0.5 else int(rng.integers(0, 4))
        base = ground + rng.uniform(0.0, 0.22)
        shadow(canvas, (x, base - 0.02, x + wide, base + 0.03), 0.35, 0.03)
        paint_leaves(rng, canvas, (x, base - tall, x + wide, base), 11, 1500, kind, light=1.1)
    return lit(rng, canvas, 0.15)


def foliage(rng: np.random.Generator) -> Canvas:
    """Looking up into trees: leaves, gaps of sky, a few boughs."""
    canvas = _sky(rng)
    season = int(rng.choice(4, p=(0.3, 0.2, 0.3, 0.2)))
    height, width = _SHAPE
    for _ in range(int(rng.integers(3, 8))):
        ends = rng.random((2, 2)) * [width, height]
        bend = (ends[0] + ends[1]) / 2 + rng.normal(size=2) * 60
        t = np.linspace(0, 1, 12)[:, None]
        line = (1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * bend + t**2 * ends[1]
        drawn = np.round(line * 16).astype(np.int32)
        thick = int(rng.integers(3, 16))
        cv2.polylines(canvas, [drawn], False, (0.25, 0.19, 0.14), thick, cv2.LINE_AA, 4)
    for _ in range(int(rng.integers(9, 15))):
        x, y = rng.uniform(-0.2, 0.9), rng.uniform(-0.2, 0.9)
        box = (x, y, x + rng.uniform(0.2, 0.5), y + rng.uniform(0.2, 0.5))
        kind = season if rng.random() < 0.75 else int(rng.integers(0, 4))
        paint_leaves(rng, canvas, box, rng.uniform(9, 19), 620, kind, light=1.15)
    return canvas


def bookshelf(rng: np.random.Generator) -> Canvas:
    """Shelves full of books, with gaps, leaning ones and vases."""
    timber = wood(rng).mean((0, 1)) * rng.uniform(0.7, 1.15)
    canvas = _blank(timber * 0.30)
    height, width = _SHAPE
    rows = int(rng.integers(3, 6))
    pitch = height / rows
    hues = np.concatenate([room_colors(rng, 6), room_colors(rng, 4, pale=0.4)])
    bay = width / int(rng.integers(2, 4))
    for row in range(rows):
        floor = int((row + 1) * pitch) - 7
        x = 4.0
        while x < width:
            if rng.random() < 0.08:
                x += rng.uniform(12, 50)
                continue
            thick, tall = rng.uniform(7, 22), pitch * rng.uniform(0.55, 0.85)
            color = np.clip(hues[int(rng.integers(10))] * rng.uniform(0.7, 1.1), 0.03, 0.97)
            x0, x1, top = int(x), int(x + thick), int(floor - tall)
            x += thick + (rng.random() < 0.2) * 2
            block = canvas[max(top, 0) : floor, x0:x1]
            if not block.size:
                continue
            across = np.linspace(-1, 1, x1 - x0)[: block.shape[1]]
            block[:] = color * (1 - 0.45 * across**2)[None, :, None]
            for _ in range(int(rng.integers(1, 4))):
                y = top + int(tall * rng.uniform(0.06, 0.85))
                mark = np.clip(color * 0.4 + (0.55 if rng.random() < 0.6 else 0.05), 0, 1)
                canvas[max(y, 0) : y + int(rng.integers(2, 14)), x0 + 2 : x1 - 2] = mark
        rectangle(canvas, (0, floor / height, 1, (floor + 7) / height), timber)
        shade = slice(floor + 7, min(floor + 7 + int(pitch * 0.2), height))
        canvas[shade] *= np.linspace(0.45, 1, shade.stop - shade.start)[:, None, None]
    for k in range(1, 4):
        rectangle(canvas, (k * bay / width - 0.008, 0, k * bay / width + 0.008, 1), timber * 1.05)
    return lit(rng, canvas, 0.3) * np.float32(1.1)


def room(rng: np.random.Generator) -> Canvas:
    """A furnished room: window, curtains, pictures, sofa or cupboard, lamp, plant, floor."""
    wall = room_colors(rng, 1, pale=rng.uniform(0.3, 0.85))[0]
    canvas = _blank(wall)
    canvas *= 0.93 + 0.1 * noise(rng, (3, 4), 4, 0.5, _SHAPE)[..., None]
    floor = rng.uniform(0.70, 0.85)
    if rng.random() < 0.6:
        left, wide = rng.uniform(0.02, 0.6), rng.uniform(0.22, 0.42)
        box = (left, rng.uniform(0.04, 0.16), left + wide, floor - rng.uniform(0.02, 0.25))
        view = garden(rng) if rng.random() < 0.3 else _sky(rng)
        rectangle(canvas, _grown(box, 0.012, 0.02), 0.95)
        _paste(canvas, np.minimum(view * 1.1 + 0.05, 1.0).astype(np.float32), box)
        for k in range(1, 3):
            x = box[0] + wide * k / 3
            rectangle(canvas, (x - 0.005, box[1], x + 0.005, box[3]), 0.93)
        cloth = room_colors(rng, 1, pale=0.5)[0]
        for x in (box[0] - 0.05, box[2] - 0.05):
            columns = np.sin(np.linspace(0, rng.uniform(18, 34), int(0.10 * _SHAPE[1])))
            folds = np.tile((0.8 + 0.2 * columns)[None, :, None], (8, 1, 1)) * cloth
            _paste(canvas, folds.astype(np.float32), (x, box[1] - 0.04, x + 0.10, box[3] + 0.06))
    for _ in range(int(rng.integers(1, 5))):
        x, y = rng.uniform(0, 0.85), rng.uniform(0.04, 0.35)
        w, h = rng.uniform(0.07, 0.2), rng.uniform(0.12, 0.3)
        shadow(canvas, (x, y, x + w + 0.01, y + h + 0.02), 0.35, 0.02)
        box = (x, y, x + w, y + h)
        rectangle(canvas, box, rng.choice([0.12, 0.4, 0.93]))
        inner = ramp(noise(rng, (3, 3), 4, 0.6, (96, 96)), list(room_colors(rng, 4)))
        _paste(canvas, inner, _grown(box, -0.012, -0.018))
    planks = wood(rng) if rng.random() < 0.7 else carpet(rng)
    _paste(canvas, np.tile(planks, (1, 2, 1)), (0, floor, 1, 1))
    rectangle(canvas, (0, floor - 0.025, 1, floor), np.clip(wall * 1.1, 0, 0.95))
    for _ in range(int(rng.integers(1, 4))):
        x, w = rng.uniform(-0.1, 0.8), rng.uniform(0.2, 0.5)
        top, base = floor - rng.uniform(0.12, 0.38), floor + rng.uniform(0.0, 0.1)
        shadow(canvas, (x - 0.01, top + 0.05, x + w + 0.02, base + 0.03), 0.5, 0.04)
        kind = rng.random()
        if kind < 0.4:
            _paste(canvas, bookshelf(rng), (x, top - 0.15, x + w, base))
        elif kind < 0.7:
            color = room_colors(rng, 1, pale=0.2)[0]
            plain = np.tile(color.astype(np.float32), (64, 64, 1))
            fabric = plaid(rng) if rng.random() < 0.3 else plain
            count = int(rng.integers(2, 4))
            for k in range(count):
                a, b = x + w * k / count, x + w * (k + 1) / count - 0.004
                _paste(canvas, fabric, (a, top, b, base - 0.02))
                shadow(canvas, (a, base - 0.14, b, base - 0.12), 0.4, 0.015)
                rectangle(canvas, (a, top, b, top + 0.012), np.clip(color * 1.25, 0, 1))
            rectangle(canvas, (x, base - 0.02, x + w, base), color * 0.35)
        else:
            timber = wood(rng)
            _paste(canvas, timber, (x, top, x + w, base))
            count = int(rng.integers(2, 5))
            for k in range(count):
                y = top + (base - top) * k / count
                rectangle(canvas, (x, y, x + w, y + 0.008), timber.mean((0, 1)) * 0.4)
                rectangle(canvas, (x + w * 0.46, y + 0.03, x + w * 0.54, y + 0.042), 0.8)
    x = rng.uniform(0.05, 0.9)
    pot = room_colors(rng, 1, pale=0.4)[0]
    rectangle(canvas, (x, floor - 0.08, x + 0.08, floor + 0.04), pot)
    paint_leaves(rng, canvas, (x - 0.06, floor - 0.4, x + 0.14, floor - 0.06), 30, 90, 0, light=1.1)
    u, v = grid(_SHAPE)
    for _ in range(int(rng.integers(0, 3))):
        lx, ly = rng.random(), rng.uniform(0.05, 0.5)
        glow = np.exp(-(((u - lx) * 1.5) ** 2 + (v - ly) ** 2) / 0.02)[..., None]
        canvas += glow.astype(np.float32) * np.array([0.35, 0.28, 0.16], dtype=np.float32)
    return lit(rng, np.clip(canvas, 0, 1), 0.25)


def street(rng: np.random.Generator) -> Canvas:
    """Fronts of shops and offices: grids of windows, signs, awnings, a pavement."""
    canvas = _sky(rng)
    x = -0.05
    while x < 1.0:
        w, top = rng.uniform(0.15, 0.4), rng.uniform(-0.1, 0.35)
        color = room_colors(rng, 1, pale=rng.uniform(0, 0.6))[0]
        rectangle(canvas, (x, top, x + w, 0.86), color * 0.9)
        glass = rng.choice([0.0, 1.0]) * np.array([0.25, 0.42, 0.66]) + rng.uniform(0.1, 0.3)
        columns, rows = int(rng.integers(3, 7)), int(rng.integers(3, 7))
        for i in range(columns):
            for j in range(rows):
                a = x + w * (i + 0.15) / columns
                b = top + (0.6 - top) * (j + 0.15) / rows
                tone = np.clip(glass * rng.uniform(0.6, 1.4), 0, 1)
                box = (a, b, a + 0.7 * w / columns, b + 0.7 * (0.6 - top) / rows)
                rectangle(canvas, box, tone)
        sign = room_colors(rng, 2)
        rectangle(canvas, (x + 0.01, 0.62, x + w - 0.01, 0.69), sign[0])
        for k in range(int(rng.integers(4, 9))):
            a = x + 0.03 + 0.025 * k
            if a < x + w - 0.04:
                rectangle(canvas, (a, 0.64, a + 0.015, 0.67), 0.95)
        inside = ramp(noise(rng, (4, 6), 3, 0.7, (64, 128)), list(room_colors(rng, 4)))
        _paste(canvas, inside, (x + 0.02, 0.70, x + w - 0.02, 0.85))
        shadow(canvas, (x, 0.69, x + w, 0.71), 0.6, 0.01)
        x += w + 0.005
    _, v = grid(_SHAPE)
    pave = 0.62 + 0.12 * noise(rng, (30, 30), 4, 0.6, _SHAPE) + 0.06 * np.sin(v * 300)
    canvas = np.where((v > 0.86)[..., None], pave[..., None], canvas).astype(np.float32)
    return lit(rng, canvas, 0.25)


def painting(rng: np.random.Generator) -> Canvas:
    """A place again, in broad strokes of a brush."""
    maker = (garden, foliage, room, street)[int(rng.integers(4))]
    model = maker(rng)
    height, width = _SHAPE
    canvas = cv2.GaussianBlur(model, (0, 0), 12)
    flow = noise(rng, (2, 3), 2, 0.4, _SHAPE) * 1.6 * np.pi
    for count, length, wide in ((700, 46.0, 14.0), (1700, 24.0, 7.0)):
        x, y = rng.integers(0, width, count), rng.integers(0, height, count)
        colors = model[y, x] * rng.uniform(0.85, 1.15, (count, 1))
        order = np.argsort(rng.random(count))
        t = np.array([-0.5, 0.5, 0.5, -0.5]) * length
        s = np.array([-0.5, -0.35, 0.35, 0.5]) * wide
        a = flow[y, x][:, None]
        px = x[:, None] + t * np.cos(a) - s * np.sin(a)
        py = y[:, None] + t * np.sin(a) + s * np.cos(a)
        shapes(canvas, np.stack([px, py], -1)[order], np.clip(colors, 0, 1)[order], 60)
    return np.asarray(canvas, dtype=np.float32)


def magazine(rng: np.random.Generator) -> Canvas:
    """Printed pages: pictures, headlines, columns of lines."""
    canvas = _blank(rng.uniform(0.86, 0.97) * np.array([1.0, 0.99, 0.97]))
    columns = int(rng.integers(2, 5))
    makers = (garden, street, foliage, room)
    for k in range(columns):
        x0, x1 = (k + 0.08) / columns, (k + 0.92) / columns
        y = 0.03
        pictures = 0
        while y < 0.94:
            kind = rng.random()
            if kind < 0.4 and pictures < 2:
                h = rng.uniform(0.15, 0.4)
                if pictures or k % 2:
                    tones = list(room_colors(rng, 4))
                    picture = ramp(noise(rng, (3, 4), 4, 0.6, (128, 192)), tones)
                else:
                    picture = makers[int(rng.integers(4))](rng)
                _paste(canvas, picture, (x0, y, x1, min(y + h, 0.97)))
                pictures += 1
                y += h + 0.02
            elif kind < 0.5:
                tone = room_colors(rng, 1)[0] * rng.uniform(0.1, 0.9)
                rectangle(canvas, (x0, y, x0 + (x1 - x0) * rng.uniform(0.4, 1), y + 0.03), tone)
                y += 0.05
            else:
                for _ in range(int(rng.integers(3, 8))):
                    right = x0 + (x1 - x0) * (1 if rng.random() < 0.8 else rng.random())
                    rectangle(canvas, (x0, y, right, y + 0.006), 0.35)
                    y += 0.015
                y += 0.01
    return canvas
