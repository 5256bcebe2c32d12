"""From light to a colour picture: exposure, vignetting, blur, shot and read noise, eight bits."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Light = npt.NDArray[np.floating]
Picture = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class ColorCamera:
    """How a camera turns light into a picture.

    Args:
        brightness: Mean that automatic exposure aims at, of a picture's light where 1 is white.
        exposures: Least and greatest factor on the light that it chooses.
        vignetting: Fraction of light that is lost in the image's corners.
        blur: Standard deviation of the lens's blur, pixels.
        full_well: Electrons at a radiance of 1; their number is random (shot noise).
        read_noise: Standard deviation of the electronics' noise, electrons.
    """

    brightness: float = 0.36
    exposures: tuple[float, float] = (0.6, 2.2)
    vignetting: float = 0.10
    blur: float = 0.35
    full_well: float = 14000.0
    read_noise: float = 10.0


def film(light: Light) -> Light:
    """Roll bright light off smoothly instead of clipping it: linear to 0.6, then toward 1."""
    knee = 0.6
    over = np.maximum(light - knee, 0.0)
    return np.asarray(np.minimum(light, knee) + (1 - knee) * (1 - np.exp(-over / (1 - knee))))


def exposure(light: Light, camera: ColorCamera) -> float:
    """The factor on the light that automatic exposure chooses; few pixels may become white."""
    mean = float(np.minimum(light, 1.0).mean())
    bright = float(np.percentile(light, 96))
    factor = min(camera.brightness / max(mean, 1e-6), 0.85 / max(bright, 1e-6))
    return float(np.clip(factor, *camera.exposures))


def develop(light: Light, rng: np.random.Generator, camera: ColorCamera) -> Picture:
    """Expose a camera to linear RGB radiance (H, W, 3): sRGB with its noise, (H, W, 3) uint8."""
    height, width = light.shape[:2]
    image = np.maximum(np.asarray(light, dtype=np.float32), 0.0)
    image *= exposure(image, camera)
    if camera.blur > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), camera.blur))
    y = (np.arange(height, dtype=np.float32) + 0.5 - height / 2)[:, None]
    x = np.arange(width, dtype=np.float32) + 0.5 - width / 2
    corner = (x**2 + y**2) / ((width**2 + height**2) / 4)
    image *= (1 - camera.vignetting * corner)[..., None]
    electrons = image * camera.full_well
    spread = np.sqrt(electrons + camera.read_noise**2)
    noisy = electrons + spread * rng.standard_normal(image.shape, dtype=np.float32)
    shown = film(np.maximum(noisy / camera.full_well, 0.0)) ** (1 / 2.2)
    return np.asarray(np.clip(np.rint(shown * 255), 0, 255), dtype=np.uint8)
