"""Skinning: the template's skin follows a skeleton by blended dual quaternions.

First the template takes a hand's sizes, still at rest: each bone stretches its skin along and
around itself. Then every bone moves its skin as a rigid body, blended as unit dual quaternions,
so that bent joints keep their girth. The sized template is kept per hand shape.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from hadr.camera import Array
from hadr.hand import FINGERS, HandShape, Skeleton
from hadr.records.caches import kept
from hadr.synthesis.hand.signed_distance import rest_skeleton
from hadr.synthesis.hand.template import BONE_COUNT, COARSE_STEP, hand_template

_MIRROR = np.array([-1.0, 1.0, 1.0])


def bone_frames(skeleton: Skeleton, side: str) -> Array:
    """``wrist_from_bone`` of the 16 bones of a right hand, shape (16, 4, 4).

    A left hand's frames are mirrored to a right hand's first.
    """
    frames = np.empty((BONE_COUNT, 4, 4))
    frames[0] = np.eye(4)
    for i, indices in enumerate(FINGERS.values()):
        for j in range(3):
            frames[1 + 3 * i + j] = skeleton.frames[1 + indices[j]]
    if side == "left":
        frames[1:, 0, :] *= -1.0
    return frames


def _palm_stretch(before: Skeleton, after: Skeleton, girth: float) -> Array:
    """Linear map that carries the knuckles' places at rest to another hand's, shape (3, 3)."""
    roots = [1 + FINGERS[f][0] for f in ("index", "middle", "ring", "little")]
    stretch = np.diag([girth, 1.0, girth])
    flat, *_ = np.linalg.lstsq(before.joints[roots][:, :2], after.joints[roots][:, :2], rcond=None)
    stretch[:2, :2] = flat.T
    return stretch


def sized_template(shape: HandShape, step: float) -> tuple[npt.NDArray[np.float32], Array]:
    """The template at rest in a hand's proportions, as a right hand of scale 1.

    Vertices, shape (V, 3), and ``bone_from_wrist`` of its 16 bones, shape (16, 4, 4).
    """
    sizes = (tuple((f, tuple(v)) for f, v in s.items()) for s in (shape.roots, shape.lengths))
    return _sized(*sizes, tuple(shape.fan.items()), shape.girth, step)


@kept(64)
def _sized(
    roots: Any, lengths: Any, fan: Any, girth: float, step: float
) -> tuple[npt.NDArray[np.float32], Array]:
    template = hand_template(step)
    plain = HandShape("right", 1.0, dict(roots), dict(lengths), dict(fan), girth)
    standard = HandShape()
    before, after = rest_skeleton(standard), rest_skeleton(plain)
    old, new = bone_frames(before, "right"), bone_frames(after, "right")
    moves = np.empty((BONE_COUNT, 4, 4))
    moves[0] = np.eye(4)
    moves[0, :3, :3] = _palm_stretch(before, after, girth)
    for i, finger in enumerate(FINGERS):
        for j in range(3):
            ratio = plain.lengths[finger][j] / standard.lengths[finger][j]
            bone = 1 + 3 * i + j
            moves[bone] = new[bone] @ np.diag([girth, ratio, girth, 1.0]) @ np.linalg.inv(old[bone])
    packed = moves[:, :3].reshape(BONE_COUNT, 12).astype(np.float32)
    rows = (template.weights @ packed).reshape(-1, 3, 4)
    points = template.vertices.astype(np.float32)
    # The palm's stretch ends at the wrist; the forearm only takes the girth.
    arm = np.diag([girth, 1.0, girth]).astype(np.float32) - moves[0, :3, :3].astype(np.float32)
    behind = np.clip((0.03 - points[:, 1]) / 0.06, 0, 1) * template.weights[:, 0]
    rows[:, :, :3] += behind[:, None, None] * arm
    sized = (rows[:, :, :3] @ points[:, :, None])[..., 0] + rows[:, :, 3]
    return sized.astype(np.float32), np.asarray(np.linalg.inv(new), dtype=float)


def _quaternions(rotations: Array) -> Array:
    """Unit quaternions (w, x, y, z) of bone rotations; each on its parent bone's side."""
    q = Rotation.from_matrix(rotations).as_quat()[:, [3, 0, 1, 2]]
    for bone in range(BONE_COUNT):
        parent = 0 if bone == 0 or bone % 3 == 1 else bone - 1
        if q[bone] @ (q[parent] if bone else np.array([1.0, 0, 0, 0])) < 0:
            q[bone] = -q[bone]
    return np.asarray(q, dtype=float)


def dual_quaternions(motions: Array) -> Array:
    """Rigid motions, shape (16, 4, 4), as unit dual quaternions, shape (16, 8)."""
    real = _quaternions(motions[:, :3, :3])
    w, v, t = real[:, :1], real[:, 1:], motions[:, :3, 3]
    dual = 0.5 * np.concatenate([-(t * v).sum(1, keepdims=True), w * t + np.cross(t, v)], axis=1)
    return np.concatenate([real, dual], axis=1)


def blend_motions(
    points: npt.NDArray[np.float32], weights: npt.NDArray[np.float32], motions: Array
) -> npt.NDArray[np.float32]:
    """Move points (V, 3) by their weighted bones' rigid motions, shape (16, 4, 4)."""
    blend = weights @ dual_quaternions(motions).astype(np.float32)
    blend /= np.linalg.norm(blend[:, :4], axis=1, keepdims=True)
    w, v, dw, dv = blend[:, :1], blend[:, 1:4], blend[:, 4:5], blend[:, 5:]
    rotated = points + 2 * np.cross(v, np.cross(v, points) + w * points)
    return np.asarray(rotated + 2 * (w * dv - dw * v + np.cross(v, dv)), dtype=np.float32)


def bends(frames: Array) -> Array:
    """How far each joint is bent toward the palm, radians, shape (15,), column 3 i + j."""
    rotations = frames[:, :3, :3]
    parents = [0 if bone % 3 == 1 else bone - 1 for bone in range(1, BONE_COUNT)]
    forward = np.einsum("bji,bj->bi", rotations[parents], rotations[1:, :, 1])
    return np.asarray(np.arctan2(forward[:, 2], forward[:, 1]), dtype=float)


def posed_vertices(skeleton: Skeleton, shape: HandShape, step: float) -> npt.NDArray[np.float32]:
    """The template's vertices in a pose, wrist frame, metres, shape (V, 3)."""
    sized, bone_from_wrist = sized_template(shape, step)
    posed = bone_frames(skeleton, shape.side)
    posed[:, :3, 3] /= shape.scale
    template = hand_template(step)
    bent = np.sin(np.clip(bends(posed), 0, np.pi) / 2) ** 2 * 2
    rises = template.correctives @ (shape.girth * bent).astype(np.float32)
    vertices = blend_motions(
        sized + template.normals * rises[:, None], template.weights, posed @ bone_from_wrist
    )
    vertices *= np.float32(shape.scale)
    if shape.side == "left":
        vertices *= _MIRROR.astype(np.float32)
    return vertices


def skin_vertices(skeleton: Skeleton, shape: HandShape) -> tuple[Array, npt.NDArray[np.int8]]:
    """Points of the skin in a pose, some 4 mm apart, wrist frame, metres, shape (V, 3).

    Their order is that of every pose; each one's part is 0..4 thumb to little, 5 palm, 6 forearm.
    """
    vertices = posed_vertices(skeleton, shape, COARSE_STEP)
    return vertices.astype(float), hand_template(COARSE_STEP).part
