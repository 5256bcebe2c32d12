"""What happens to light where glass begins or ends: Snell's law and Fresnel's equations."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Refractive index of the glass.
GLASS_INDEX = 1.50


def refract(direction: Array, normal: Array, ratio: Array) -> tuple[Array, Array]:
    """Bend unit directions at an interface by Snell's law.

    Args:
        direction: Unit directions of travel, shape (N, 3).
        normal: Unit normals against the direction of travel, shape (N, 3).
        ratio: Refractive index before the interface over that behind it, shape (N,).

    Returns:
        Bent unit directions (N, 3), not meaningful where all light is reflected, and the
        reflectance (N,): unpolarised Fresnel, 1 at total internal reflection.
    """
    cos_in = np.clip(-(direction * normal).sum(-1), 0.0, 1.0)
    sin2_out = ratio**2 * (1.0 - cos_in**2)
    total = sin2_out >= 1.0
    cos_out = np.sqrt(np.maximum(1.0 - sin2_out, 0.0))
    bent = ratio[:, None] * direction + (ratio * cos_in - cos_out)[:, None] * normal
    bent /= np.maximum(np.linalg.norm(bent, axis=-1, keepdims=True), 1e-12)
    across = (ratio * cos_in - cos_out) / np.maximum(ratio * cos_in + cos_out, 1e-12)
    along = (cos_in - ratio * cos_out) / np.maximum(cos_in + ratio * cos_out, 1e-12)
    return bent, np.where(total, 1.0, 0.5 * (across**2 + along**2))


def reflect(direction: Array, normal: Array) -> Array:
    """Mirror unit directions (N, 3) at unit normals (N, 3)."""
    return np.asarray(direction - 2.0 * (direction * normal).sum(-1, keepdims=True) * normal)
