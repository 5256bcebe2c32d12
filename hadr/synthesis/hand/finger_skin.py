"""The skin of one finger for many angle sets at once: what the search for contact moves about.

Linear-blend skinning of a right hand's coarse skin: one matrix product for all angle sets. The
final check looks at the skin of :func:`hadr.synthesis.hand.skinning.skin_vertices` itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.hand import FINGERS, HandShape, forward_kinematics
from hadr.records.caches import kept
from hadr.synthesis.glass.surfaces import vertex_normals
from hadr.synthesis.hand.skinning import sized_template
from hadr.synthesis.hand.template import COARSE_STEP, hand_template

Floats = npt.NDArray[np.float32]


def _rotation(axis: int, angle: Array) -> Array:
    """Rotation matrices about x (0) or z (2), shape (N, 3, 3)."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.zeros((len(angle), 3, 3))
    rotation[:, axis, axis] = 1.0
    rotation[:, u, u] = rotation[:, v, v] = np.cos(angle)
    rotation[:, v, u] = np.sin(angle)
    rotation[:, u, v] = -rotation[:, v, u]
    return rotation


@kept(1)
def skin_normals() -> Array:
    """Unit normals of the coarse skin at rest, shape (V, 3)."""
    template = hand_template(COARSE_STEP)
    return vertex_normals(template.vertices, template.faces)


@dataclass(frozen=True, eq=False)
class FingerSkin:
    """One finger's skin, ready to be posed.

    Args:
        rows: Which of the hand's coarse skin vertices these are, shape (V,).
        bone: The bone that each follows most: 0, 1, 2 from the root, shape (V,).
        pad: Whether it faces the palm's side, shape (V,).
        tip_pad: Whether it lies on the pad of the last bone, shape (V,).
        root: ``wrist_from_root`` of the straight finger, scale 1, shape (4, 4).
        lengths: Lengths of the three bones, scale 1.
        scale: Factor on all of them.
        bone_from_wrist: Of the three bones at rest, shape (3, 4, 4).
        packed: Weights times homogeneous points, shape (V, 16).
        girth: Radius of the finger around its three bones, metres, shape (3,).
    """

    rows: npt.NDArray[np.int64]
    bone: npt.NDArray[np.int64]
    pad: npt.NDArray[np.bool_]
    tip_pad: npt.NDArray[np.bool_]
    root: Array
    lengths: tuple[float, float, float]
    scale: float
    bone_from_wrist: Array
    packed: Floats
    girth: Array

    def bones(self, angles: Array) -> tuple[Array, Array]:
        """Frames of the three bones, (N, 3, 4, 4), and the four joints, (N, 4, 3); scale 1."""
        count = len(angles)
        rotation = self.root[:3, :3] @ _rotation(2, -angles[:, 0])
        at = np.broadcast_to(self.root[:3, 3], (count, 3))
        frames = np.zeros((count, 3, 4, 4))
        frames[..., 3, 3] = 1.0
        joints = [at]
        for bone in range(3):
            rotation = rotation @ _rotation(0, angles[:, 1 + bone])
            frames[:, bone, :3, :3], frames[:, bone, :3, 3] = rotation, at
            at = at + self.lengths[bone] * rotation[:, :, 1]
            joints.append(at)
        return frames, np.stack(joints, axis=1)

    def pose(
        self,
        angles: Array,
        object_from_wrist: Array,
        chosen: npt.NDArray[np.int64] | slice = slice(None),
    ) -> tuple[Floats, Array]:
        """Chosen points of the skin for angle sets (N, 4), radians, in the object's frame.

        Metres, shape (V, N, 3); and the joints (N, 4, 3) in the wrist frame.
        """
        frames, joints = self.bones(angles)
        palm = np.broadcast_to(np.eye(4), (len(angles), 1, 4, 4))
        motions = np.concatenate([palm, frames @ self.bone_from_wrist], axis=1)
        rotation = object_from_wrist[:3, :3] * self.scale
        moved = rotation @ motions[:, :, :3]
        matrix = moved.transpose(1, 3, 0, 2).reshape(16, -1).astype(np.float32)
        points = self.packed[chosen] @ matrix
        points = points.reshape(len(points), len(angles), 3)
        points += object_from_wrist[:3, 3].astype(np.float32)
        return points, joints * self.scale


def finger_skin(finger: str, shape: HandShape) -> FingerSkin:
    """The skin of a finger, ``thumb`` to ``little``, as a right hand's whatever the hand's side."""
    plain = replace(shape, side="right", scale=1.0)
    number = list(FINGERS).index(finger)
    template = hand_template(COARSE_STEP)
    sized, bone_from_wrist = sized_template(shape, COARSE_STEP)
    rows = np.flatnonzero(template.part == number)
    first = 1 + 3 * number
    weights = template.weights[rows][:, [0, first, first + 1, first + 2]]
    weights = weights / weights.sum(1, keepdims=True)
    points = np.concatenate([sized[rows], np.ones((len(rows), 1), np.float32)], axis=1)
    packed = (weights[:, :, None] * points[:, None, :]).reshape(len(rows), 16).astype(np.float32)
    bone = weights[:, 1:].argmax(1)
    rest = forward_kinematics(np.zeros(20), plain)
    local_rest = bone_from_wrist[first : first + 3]
    own = np.einsum("vij,vj->vi", local_rest[bone], points)
    normals = np.einsum("vij,vj->vi", local_rest[bone][:, :3, :3], skin_normals()[rows])
    pad = normals[:, 2] > 0.55
    tip = (bone == 2) & (own[:, 1] > 0.30 * plain.lengths[finger][2])
    tip_pad = tip & (normals[:, 2] > 0.25)
    middle = np.array(plain.lengths[finger])[bone] / 2
    around, away = np.abs(own[:, 1] - middle) < 0.012, np.linalg.norm(own[:, [0, 2]], axis=1)
    girth = np.array([np.median(away[around & (bone == b)]) for b in range(3)])
    sizes = plain.lengths[finger], shape.scale
    root = rest.frames[1 + FINGERS[finger][0]]
    girth = girth * shape.scale
    return FingerSkin(rows, bone, pad, tip_pad, root, *sizes, local_rest, packed, girth)
