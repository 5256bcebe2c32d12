"""An early look at what a network restores: a few frames side by side as one PNG."""

from __future__ import annotations

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


def depth_picture(model: nn.Module, frames: FrameTensors) -> Picture:
    """Draw colour, corrupted, restored and true depth and the error of four frames, evenly spread.

    Each row shows the half of a frame in which the glass is (all of it for a large one). Depth has
    one colour scale a row, `AROUND_M` to both sides of the glass's median; black is missing. The
    error is blue in front of the surface and red behind it, `ERROR_M` at most; the number is the
    frame's RMSE.
    """
    chosen = [int(n) for n in np.unique(np.linspace(0, len(frames) - 1, 4).round())]
    some = frames.take(chosen)
    device = next(model.parameters()).device
    with torch.no_grad():
        found = model(some.inputs.to(device)).depth.cpu()
    restored = torch.where(some.inputs.mask, found, some.inputs.depth)
    lines = []
    for number in range(len(some)):
        color = some.inputs.color[number].permute(1, 2, 0).numpy()
        lines.append(
            _line(
                np.round(color * 255).astype(np.uint8),
                some.inputs.depth[number].numpy(),
                restored[number].numpy(),
                some.true_depth[number].numpy(),
                some.object_mask[number].numpy(),
            )
        )
    return np.vstack([_header(lines[0].shape[1]), *lines])


def save_png(path: Path, picture: Picture) -> None:
    """Write an RGB picture as PNG, whole or not at all."""
    _, data = cv2.imencode(".png", picture[..., ::-1])
    write_whole(path, data.tobytes())


def _line(
    color: Picture, corrupted: FloatArray, restored: FloatArray, truth: FloatArray, mask: BoolArray
) -> Picture:
    """One frame: five pictures beside each other, of the half around the glass where it fits."""
    window = _window(mask)
    color = color[window]
    corrupted, restored, truth = corrupted[window], restored[window], truth[window]
    mask = mask[window]
    on_glass = mask & (truth > 0)
    middle = float(np.median(truth[on_glass])) if on_glass.any() else 1.0
    error = np.where(on_glass, restored - truth, 0)
    rmse = float(np.sqrt(np.mean(error[on_glass] ** 2))) if on_glass.any() else 0.0
    panels = [
        color,
        *(_depth_colors(image, middle) for image in (corrupted, restored, truth)),
        _error_colors(error, on_glass),
    ]
    scale = _HEIGHT / mask.shape[0]
    size = (round(mask.shape[1] * scale), _HEIGHT)
    big = [cv2.resize(panel, size, interpolation=cv2.INTER_NEAREST) for panel in panels]
    _write(big[-1], f"{rmse * 100:.1f} cm", (6, _HEIGHT - 8), dark=True)
    _write(big[3], f"{middle:.2f} m", (6, _HEIGHT - 8), dark=False)
    gap = np.full((_HEIGHT, _GAP, 3), 255, np.uint8)
    parts = [part for panel in big for part in (panel, gap)][:-1]
    line = np.hstack(parts)
    return np.vstack([line, np.full((_GAP, line.shape[1], 3), 255, np.uint8)])


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


def _header(width: int) -> Picture:
    strip = np.full((22, width, 3), 255, np.uint8)
    step = (width + _GAP) / len(_TITLES)
    for number, title in enumerate(_TITLES):
        cv2.putText(
            strip,
            title,
            (round(number * step) + 4, 16),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.5,
            (0, 0, 0),
            1,
            cv2.LINE_AA,
        )
    return strip


def _write(picture: Picture, text: str, where: tuple[int, int], dark: bool) -> None:
    black, white = (0, 0, 0), (255, 255, 255)
    pen, edge = (black, white) if dark else (white, black)
    for color, thick in ((edge, 3), (pen, 1)):
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
