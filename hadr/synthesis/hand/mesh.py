"""A closed hand with its forearm, skinned around the skeleton of :mod:`hadr.hand`.

The shape (:mod:`hadr.synthesis.hand.signed_distance`) is polygonised once, at rest; the skin then
follows each pose (:mod:`hadr.synthesis.hand.skinning`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.hand import HandShape, Skeleton
from hadr.synthesis.glass.surfaces import Surface, vertex_normals
from hadr.synthesis.hand.relief import SkinMap
from hadr.synthesis.hand.skinning import posed_vertices
from hadr.synthesis.hand.template import COARSE_STEP, FINE_STEP, MIDDLE_STEP, hand_template

#: Skin tones, linear RGB reflectance, light to dark.
SKIN_TONES: tuple[tuple[float, float, float], ...] = (
    (0.70, 0.475, 0.365),
    (0.63, 0.405, 0.295),
    (0.55, 0.335, 0.23),
    (0.46, 0.26, 0.17),
    (0.31, 0.17, 0.105),
    (0.19, 0.10, 0.065),
)


@dataclass(frozen=True)
class HandMesh:
    """The skinned hand.

    Args:
        surface: Closed surface in the skeleton's frame (the wrist frame).
        albedo: Linear RGB reflectance per vertex, shape (V, 3).
        gloss: Fraction of mirror-like reflection per vertex, shape (V,): the nails shine.
    """

    surface: Surface
    albedo: Array
    gloss: Array


def paint(skin: SkinMap, tone: npt.ArrayLike) -> tuple[Array, Array]:
    """Reflectance (linear RGB, (V, 3)) and gloss (V,) of skin and nails; the tone is the back's."""
    base = np.asarray(tone, dtype=float)
    fair = np.array([0.80, 0.53, 0.42])
    darkness = float(np.clip(1 - base.mean() / 0.56, 0, 1))
    inner = base + (0.10 + 0.38 * darkness) * (fair * [0.92, 0.80, 0.76] - base)

    def mixed(color: Array, other: Array, weight: Array) -> Array:
        return color + weight[:, None] * (other - color)

    color = mixed(np.tile(base, (len(skin.palm), 1)), inner, skin.palm)
    color *= 1 + (0.045 + 0.02 * darkness) * skin.mottle[:, None]
    color *= 1 + skin.red[:, None] * (np.array([1.03, 0.80, 0.78]) - 1)
    color *= 1 + skin.vein[:, None] * (1 - darkness) * (np.array([0.86, 0.95, 1.0]) - 1)
    depth = np.array([0.74, 0.58, 0.55]) * (1 - 0.15 * darkness)
    color *= 1 + skin.crease[:, None] * (depth - 1)
    bed = base + (0.40 + 0.10 * darkness) * (np.array([0.80, 0.50, 0.43]) - base)
    plate = mixed(np.tile(bed, (len(color), 1)), np.array([0.84, 0.72, 0.62]), 0.5 * skin.moon)
    color = mixed(color, plate, skin.nail)
    gloss = 0.25 + 0.06 * skin.palm - 0.10 * skin.crease + 0.75 * skin.nail
    return np.clip(color, 0.01, 0.95), np.clip(gloss, 0.05, 1.0)


def hand_mesh(
    skeleton: Skeleton,
    shape: HandShape | None = None,
    *,
    tone: npt.ArrayLike = SKIN_TONES[1],
    step: float = FINE_STEP,
) -> HandMesh:
    """Skin a posed skeleton: a closed hand with its forearm, wrist frame, metres.

    Args:
        skeleton: The pose.
        shape: The sizes that posed it; an adult's right hand where it is left out.
        tone: Linear RGB reflectance of the skin, shape (3,).
        step: Coarsest distance of vertices, 1 to 10 mm: 1.3 shows creases, 3.8 checks contact.
    """
    if not 0.001 <= step <= 0.010:
        raise ValueError(f"step must lie between 0.001 and 0.010 metres, got {step}")
    level = next((s for s in (COARSE_STEP, MIDDLE_STEP) if step >= s), FINE_STEP)
    shape = shape or HandShape()
    vertices = posed_vertices(skeleton, shape, level).astype(float)
    template = hand_template(level)
    faces = template.faces[:, ::-1] if shape.side == "left" else template.faces
    surface = Surface(vertices, faces, vertex_normals(vertices, faces))
    albedo, gloss = paint(template.skin, tone)
    return HandMesh(surface, albedo, gloss)
