"""An early look at what a network restores: a few frames side by side as one PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from hadr.camera import BoolArray, FloatArray
from hadr.records.writing import write_whole
from hadr.training.frames.batches import FrameTensors

Picture = npt.NDArray[np.uint8]
AROUND_M = 0.15
"""Depth is coloured from so much before to so much behind the glass's median, metres."""
ERROR_M = 0.05
"""The error's colours end at this many metres."""
_HEIGHT = 160
_GAP = 4
_TITLES = ("colour", "corrupted", "restored", "truth", "error")
_BLACK, _WHITE = (0, 0, 0), (255, 255, 255)


def depth_picture(model: nn.Module, frames: FrameTensors) -> Picture:
    """Draw colour, corrupted, restored and true depth and the error of four frames, evenly spread.

    Each row shows the half of a frame in which the glass is (all of it for a large one), in one
    colour scale, `AROUND_M` to both sides of the glass's median; black is missing. The error is
    blue before the surface and red behind it, `ERROR_M` at most; the number is the frame's RMSE.
    """
    chosen = [int(n) for n in np.unique(np.linspace(0, len(frames) - 1, 4).round())]
    some = frames.take(chosen)
    with torch.no_grad():
        found = model(some.inputs.to(next(model.parameters()).device)).depth.cpu()
    restored = torch.where(some.inputs.mask, found, some.inputs.depth)
    colors = (some.inputs.color.permute(0, 2, 3, 1) * 255).round().to(torch.uint8)
    parts = (colors, some.inputs.depth, restored, some.true_depth, some.object_mask)
    lines = [_line(*images) for images in zip(*(part.numpy() for part in parts), strict=True)]
    strip = np.full((22, lines[0].shape[1], 3), 255, np.uint8)
    step = (strip.shape[1] + _GAP) / len(_TITLES)
    for number, title in enumerate(_TITLES):
        _write(strip, title, (round(number * step) + 4, 16), ((_BLACK, 1),))
    return np.vstack([strip, *lines])


def save_png(path: Path, picture: Picture) -> None:
    """Write an RGB picture as PNG, whole or not at all."""
    _, data = cv2.imencode(".png", picture[..., ::-1])
    write_whole(path, data.tobytes())


def _line(
    color: Picture, corrupted: FloatArray, restored: FloatArray, truth: FloatArray, mask: BoolArray
) -> Picture:
    """One frame: five pictures beside each other, of the half around the glass where it fits."""
    window = _window(mask)
    color, mask = color[window], mask[window]
    corrupted, restored, truth = corrupted[window], restored[window], truth[window]
    on_glass = mask & (truth > 0)
    middle = float(np.median(truth[on_glass])) if on_glass.any() else 1.0
    error = np.where(on_glass, restored - truth, 0)
    rmse = float(np.sqrt(np.mean(error[on_glass] ** 2))) if on_glass.any() else 0.0
    depths = (_depth_colors(image, middle) for image in (corrupted, restored, truth))
    size = (round(mask.shape[1] * _HEIGHT / mask.shape[0]), _HEIGHT)
    big = [
        cv2.resize(panel, size, interpolation=cv2.INTER_NEAREST)
        for panel in (color, *depths, _error_colors(error, on_glass))
    ]
    where = (6, _HEIGHT - 8)
    _write(big[-1], f"{rmse * 100:.1f} cm", where, ((_WHITE, 3), (_BLACK, 1)))
    _write(big[3], f"{middle:.2f} m", where, ((_BLACK, 3), (_WHITE, 1)))
    edge = ((0, _GAP), (0, _GAP), (0, 0))
    padded = [np.pad(panel, edge, constant_values=255) for panel in big]
    return np.hstack(padded)[:, :-_GAP]


def _window(mask: BoolArray) -> tuple[slice, slice]:
    """Half of the picture's rows and columns around the mask; all of them if it needs more."""
    rows, columns = np.nonzero(mask)
    slices = []
    for found, length in ((rows, mask.shape[0]), (columns, mask.shape[1])):
        half = (length + 1) // 2
        if len(found) == 0 or found.max() - found.min() >= half:
            return slice(None), slice(None)
        first = int(found.min() + found.max() + 1) // 2 - half // 2
        first = min(max(first, 0), length - half)
        slices.append(slice(first, first + half))
    return slices[0], slices[1]


def _write(
    picture: Picture,
    text: str,
    where: tuple[int, int],
    pens: Sequence[tuple[tuple[int, int, int], int]],
) -> None:
    """Write in one colour and width upon the other."""
    for color, thick in pens:
        cv2.putText(picture, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, thick, cv2.LINE_AA)


def _depth_colors(depth: FloatArray, middle: float) -> Picture:
    """Colour depth around a middle; black where it is missing."""
    share = np.clip((depth - middle) / (2 * AROUND_M) + 0.5, 0, 1)
    gray = np.round(255 * (1 - share)).astype(np.uint8)
    colors = cv2.applyColorMap(gray, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where((depth > 0)[..., None], colors, 0).astype(np.uint8)


def _error_colors(error: FloatArray, mask: BoolArray) -> Picture:
    """Blue in front of the surface, red behind it, white without error, grey off the glass."""
    share = np.clip(error / ERROR_M, -1, 1)[..., None]
    white, red, blue = (np.array(c, float) for c in ((255, 255, 255), (200, 30, 30), (30, 60, 200)))
    colors = white + np.abs(share) * (np.where(share > 0, red, blue) - white)
    return np.where(mask[..., None], np.round(colors), 225).astype(np.uint8)
