"""Colour augmentation for training: bright patches, colour jitter, blur or noise, dropout.

Only the colour picture changes; depth, masks and keypoints stay. Source: paper, section IV-A,
with the probabilities of the published code.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Float = npt.NDArray[np.float32]


def bright_patches(color: Float, rng: np.random.Generator) -> Float:
    """Add smooth white patches, as lamps leave them on a camera's picture; [0, 1] colour."""
    height, width = color.shape[:2]
    cells = int(rng.integers(3, 9))
    grid = rng.normal(size=(cells, cells)).astype(np.float32)
    field = cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC)
    patch = np.clip((field - rng.uniform(0.3, 1.0)) * rng.uniform(0.5, 1.5), 0.0, 0.8)
    return np.asarray(color + (1.0 - color) * patch[..., None], dtype=np.float32)


def color_jitter(color: Float, rng: np.random.Generator) -> Float:
    """Change brightness, contrast and saturation by up to 30 %, and hue by up to 18 degrees."""
    brightness, contrast, saturation = rng.uniform(0.7, 1.3, 3)
    changed = np.clip((color - 0.5) * contrast + 0.5, 0.0, 1.0) * brightness
    hsv = cv2.cvtColor(np.clip(changed, 0, 1).astype(np.float32), cv2.COLOR_RGB2HSV)
    hsv[..., 0] = (hsv[..., 0] + rng.uniform(-18.0, 18.0)) % 360.0
    hsv[..., 1] = np.clip(hsv[..., 1] * saturation, 0.0, 1.0)
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), dtype=np.float32)


def blur_or_noise(color: Float, rng: np.random.Generator) -> Float:
    """Either a Gaussian or a motion blur, or Gaussian noise."""
    kind = int(rng.integers(3))
    if kind == 0:
        sigma = float(rng.uniform(0.5, 1.5))
        return np.asarray(cv2.GaussianBlur(color, (0, 0), sigma), dtype=np.float32)
    if kind == 1:
        length, angle = int(rng.integers(3, 8)), float(rng.uniform(0, 180))
        kernel = np.zeros((length, length), dtype=np.float32)
        kernel[length // 2] = 1.0
        middle = ((length - 1) / 2, (length - 1) / 2)
        kernel = cv2.warpAffine(kernel, cv2.getRotationMatrix2D(middle, angle, 1.0), kernel.shape)
        blurred = cv2.filter2D(color, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
        return np.asarray(blurred, dtype=np.float32)
    return np.asarray(color + rng.normal(size=color.shape) * rng.uniform(0.01, 0.05), np.float32)


def coarse_dropout(color: Float, rng: np.random.Generator) -> Float:
    """Black out one to eight rectangles of up to an eighth of the image's sides."""
    height, width = color.shape[:2]
    dropped = color.copy()
    for _ in range(int(rng.integers(1, 9))):
        h = int(rng.integers(1, max(height // 8, 2)))
        w = int(rng.integers(1, max(width // 8, 2)))
        y, x = int(rng.integers(0, height - h + 1)), int(rng.integers(0, width - w + 1))
        dropped[y : y + h, x : x + w] = 0.0
    return dropped


CHANGES = ((0.1, bright_patches), (0.3, color_jitter), (0.2, blur_or_noise), (0.2, coarse_dropout))
"""Each with the probability that the published code gives it."""


def augment_color(color: npt.NDArray[Any], rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Augment one sRGB picture, (H, W, 3) uint8; everything random is drawn from `rng`."""
    if color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8:
        raise ValueError(f"color must be (H, W, 3) uint8, got {color.shape} {color.dtype}")
    picture = color.astype(np.float32) / 255.0
    for probability, change in CHANGES:
        if rng.random() < probability:
            picture = np.clip(change(picture, rng), 0.0, 1.0)
    return np.asarray(np.round(picture * 255.0), dtype=np.uint8)
