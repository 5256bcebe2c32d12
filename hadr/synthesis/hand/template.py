"""The hand's template: polygonised once, with the weights that bind its skin to the bones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation

from hadr.camera import Array
from hadr.hand import FINGERS, HandShape, Skeleton
from hadr.records.caches import kept
from hadr.synthesis.hand.relief import SkinMap, pose_correctives, skin_map
from hadr.synthesis.hand.signed_distance import (
    FOREARM_LENGTH,
    GIRTH,
    rest_skeleton,
    signed_distance,
)
from hadr.synthesis.hand.surface_nets import surface_nets

#: Bone 0 is palm and forearm; bone 1 + 3 i + j is bone j of finger i (thumb 0 .. little 4).
BONE_COUNT = 16
#: Grids of the templates, metres.
COARSE_STEP, MIDDLE_STEP, FINE_STEP = 0.0038, 0.0027, 0.0013
# Half a difference quotient's width each way, metres.
_NEAR = (0.0008, -0.0008)


@dataclass(frozen=True, eq=False)
class HandTemplate:
    """An adult's right hand at rest.

    Args:
        vertices: Wrist frame, metres, shape (V, 3).
        faces: Vertex indices, counter-clockwise from outside, shape (F, 3).
        weights: Of each bone in each vertex's motion, rows sum to 1, shape (V, 16).
        part: 0..4 thumb to little finger, 5 palm, 6 forearm, shape (V,).
        normals: Unit normals of the smooth surface at rest, shape (V, 3).
        correctives: Of the pose: rise of the skin along the normals where a joint bends by a right
            angle, metres, shape (V, 15); column 3 i + j is joint j of finger i.
        skin: Creases, nails, veins and tones; their height is in the vertices already.
    """

    vertices: Array
    faces: npt.NDArray[np.int64]
    weights: npt.NDArray[np.float32]
    part: npt.NDArray[np.int8]
    normals: npt.NDArray[np.float32]
    correctives: npt.NDArray[np.float32]
    skin: SkinMap


def _hinge(distance: Array, radius: float, reach: float = 1.5) -> Array:
    """How far a joint's bend has come, 0 before the joint to 1 beyond it."""
    # The weight follows the angle under which the skin is seen from the joint, so that skin at
    # `radius` on the inner side stays in order for bends up to 2 atan(reach).
    weight = np.arctan(np.clip(distance / radius, -reach, reach)) / (2 * np.arctan(reach)) + 0.5
    smooth = weight * weight * (3 - 2 * weight)
    return np.asarray(0.7 * weight + 0.3 * smooth)


def _to_segments(points: Array, starts: Array, ends: Array) -> Array:
    """Distance of each point from each segment, shape (V, S)."""
    columns = []
    for a, edge in zip(starts, ends - starts, strict=True):
        fraction = np.clip((points - a) @ edge / (edge @ edge), 0, 1)
        columns.append(np.linalg.norm(points - a - fraction[:, None] * edge, axis=1))
    return np.stack(columns, axis=1)


def bone_weights(points: Array, shape: HandShape) -> Array:
    """Weights of the 16 bones at points of the rest hand, shape (V, 16); rows sum to 1."""
    rest = rest_skeleton(shape)
    fingers = list(FINGERS)
    roots = np.array([rest.joints[1 + FINGERS[f][0]] for f in fingers])
    tips = np.array([rest.joints[1 + FINGERS[f][3]] for f in fingers])
    to_finger = _to_segments(points, roots[1:], tips[1:]) / [GIRTH[f] for f in fingers[1:]]
    closeness = np.exp(-np.clip(to_finger - to_finger.min(1, keepdims=True), 0, 0.1) / 0.0022)
    nearest = closeness / closeness.sum(1, keepdims=True)

    # The thumb moves what lies nearer to its metacarpal than to the palm's.
    carpal = np.array([[0.008, 0.010, 0.0], [0.0, 0.008, 0.0], [-0.010, 0.008, 0.0]])
    to_palm = _to_segments(points, np.vstack([carpal, carpal[-1:]]), roots[1:]).min(1) - 0.011
    to_arm = _to_segments(points, np.array([[0, -0.5, 0]]), np.zeros((1, 3)))[:, 0] - 0.02
    to_palm = np.minimum(np.minimum(to_palm, to_arm), to_finger.min(1) - 0.009)
    to_thumb = _to_segments(points, roots[:1], tips[:1])[:, 0] - 0.012
    thumb = 1 / (1 + np.exp(-np.clip((to_palm - to_thumb) / 0.005, -40, 40)))

    weights = np.zeros((len(points), BONE_COUNT))
    for i, finger in enumerate(fingers):
        frame = rest.frames[1 + FINGERS[finger][0]]
        s = (points - frame[:3, 3]) @ frame[:3, 1]
        l1, l2, _ = shape.lengths[finger]
        girth = GIRTH[finger]
        if finger == "thumb":
            first, radii = thumb * _hinge(s - 0.002, 0.014, 1.6), (0.0110, 0.0095)
        else:
            first = (1 - thumb) * nearest[:, i - 1] * _hinge(s, 0.0112 * girth)
            radii = 0.0086 * girth, 0.0074 * girth
        second, third = _hinge(s - l1, radii[0]), _hinge(s - l1 - l2, radii[1])
        weights[:, 1 + 3 * i] = first * (1 - second)
        weights[:, 2 + 3 * i] = first * second * (1 - third)
        weights[:, 3 + 3 * i] = first * second * third
    weights[:, 0] = np.maximum(1 - weights[:, 1:].sum(1), 0)
    return np.asarray(weights / weights.sum(1, keepdims=True), dtype=float)


def _axes(step: float) -> tuple[Array, Array, Array]:
    """Grid lines: even around the hand, ever wider along the forearm."""
    y, at, wide = [], -0.02, step
    while at > -FOREARM_LENGTH - 0.028:  # a whole cell beyond the forearm's end
        wide = min(wide * 1.07, max(4 * step, 0.009))
        at -= wide
        y.append(at)
    across, deep = np.arange(-0.076, 0.118, step), np.arange(-0.052, 0.088, step)
    return across, np.concatenate([y[::-1], np.arange(-0.02, 0.222, step)]), deep


def _sampled(
    axes: tuple[Array, Array, Array], rest: Skeleton, shape: HandShape
) -> npt.NDArray[np.float32]:
    """The signed distance on a grid: every third sample, and all of those near the skin."""

    def places(rows: tuple[npt.NDArray[np.int64], ...]) -> npt.NDArray[np.float32]:
        return np.stack([a[i] for a, i in zip(axes, rows, strict=True)], axis=-1).astype(np.float32)

    size = tuple(len(a) for a in axes)
    sparse = [np.unique(np.append(np.arange(0, n, 3), n - 1)) for n in size]
    rough = signed_distance(places(tuple(np.meshgrid(*sparse, indexing="ij"))), rest, shape)
    below = [np.minimum(np.arange(n) // 3, len(s) - 1) for n, s in zip(size, sparse, strict=True)]
    near = np.abs(rough) < 3.2 * (axes[0][1] - axes[0][0]) + 0.003
    near |= np.abs(rough) < 0.012 * (axes[1][sparse[1]] < -0.03)[None, :, None]
    near = binary_dilation(near)
    values = rough[np.ix_(*below)]
    rows = np.nonzero(near[np.ix_(*below)])
    values[rows] = signed_distance(places(rows), rest, shape)
    return np.asarray(values, dtype=np.float32)


def _onto_surface(
    points: Array, rest: Skeleton, shape: HandShape, farthest: float
) -> tuple[Array, Array]:
    """Points moved onto the field's zero level by one Newton step, and its unit normals there."""
    around = np.concatenate([points[None], *(points[None] + s * np.eye(3)[:, None] for s in _NEAR)])
    values = signed_distance(around.astype(np.float32), rest, shape).astype(float)
    slope = (values[1:4] - values[4:7]).T / (_NEAR[0] - _NEAR[1])
    squared = np.maximum(np.square(slope).sum(1), 0.05)
    move = np.clip(values[0] / np.sqrt(squared), -farthest, farthest)
    normals = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-9)
    return points - normals * move[:, None], normals


@kept(4)
def hand_template(step: float = COARSE_STEP) -> HandTemplate:
    """Polygonise the hand at rest on a grid of some metres, once per resolution."""
    shape = HandShape()
    rest = rest_skeleton(shape)
    axes = _axes(step)
    values = _sampled(axes, rest, shape)
    rough, faces = surface_nets(values, axes)
    smooth, normals = _onto_surface(rough, rest, shape, 0.4 * step)
    skin = skin_map(smooth, normals, shape)
    vertices = smooth + normals * skin.height[:, None]
    weights = bone_weights(smooth, shape)
    by_part = np.column_stack([weights[:, 1 + 3 * i : 4 + 3 * i].sum(1) for i in range(5)])
    part = np.where(by_part.max(1) > 0.5, by_part.argmax(1), np.where(vertices[:, 1] < 0, 6, 5))
    correctives = pose_correctives(smooth, normals, shape).astype(np.float32)
    bound = weights.astype(np.float32), part.astype(np.int8), normals.astype(np.float32)
    return HandTemplate(vertices, faces, *bound, correctives, skin)
