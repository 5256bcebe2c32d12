"""The hand: skeleton, 21 keypoints, wrist frame, the two hand features, the 2.5D-to-3D lift.

Wrist frame: origin at the wrist, y toward the middle finger's knuckle (MCP), z out of the palm,
x = y cross z. On a right hand x points to the thumb's side, on a left hand away from it.

The paper's skeleton has 22 points: the usual 21 and a virtual point, its number 2, which we place
inside the palm as the common root of the four fingers (the ledger's row on the 22-point
skeleton). The keypoints leave it out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from hadr.camera import BoolArray, FloatArray, Intrinsics, unproject, valid_depth

if TYPE_CHECKING:
    import torch

Side = Literal["right", "left"]

_FINGER_JOINTS = {
    "thumb": ("cmc", "mcp", "ip", "tip"),
    **dict.fromkeys(("index", "middle", "ring", "little"), ("mcp", "pip", "dip", "tip")),
}
#: Names of the 21 keypoints, in the order that detectors use (wrist, then thumb to little finger).
KEYPOINT_NAMES: tuple[str, ...] = (
    "wrist",
    *(f"{finger}_{joint}" for finger, joints in _FINGER_JOINTS.items() for joint in joints),
)
#: Names of the skeleton's 22 joints; the second one, ``palm``, is virtual.
SKELETON_NAMES: tuple[str, ...] = (KEYPOINT_NAMES[0], "palm", *KEYPOINT_NAMES[1:])
#: Keypoint indices of each finger, root to tip.
FINGERS: dict[str, tuple[int, int, int, int]] = {
    finger: (4 * i + 1, 4 * i + 2, 4 * i + 3, 4 * i + 4) for i, finger in enumerate(_FINGER_JOINTS)
}
#: The 20 bones between keypoints, as (parent, child).
BONES: tuple[tuple[int, int], ...] = tuple(
    bone for joints in FINGERS.values() for bone in pairwise((0, *joints))
)
#: Parent of each of the 22 joints; the wrist has none (-1). Four fingers hang on the virtual palm.
SKELETON_PARENTS: tuple[int, ...] = (
    *(-1, 0),
    *(parent for i in range(5) for parent in (min(i, 1), 4 * i + 2, 4 * i + 3, 4 * i + 4)),
)
#: Names of the twenty joint angles of a hand, four per finger, radians.
ANGLE_NAMES: tuple[str, ...] = (
    "thumb_cmc_spread",
    "thumb_cmc_stretch",
    "thumb_mcp_stretch",
    "thumb_ip_stretch",
    *(
        f"{finger}_{angle}"
        for finger in ("index", "middle", "ring", "little")
        for angle in ("mcp_spread", "mcp_stretch", "pip_stretch", "dip_stretch")
    ),
)
#: Lowest and highest angle of each joint, radians, shape (20, 2): usual active ranges of adults.
ANGLE_LIMITS: npt.NDArray[np.float64] = np.deg2rad(
    [(-30, 40), (-25, 50), (-10, 60), (-15, 80)] + [(-20, 20), (-20, 90), (0, 110), (0, 80)] * 4
)


@dataclass(frozen=True)
class HandShape:
    """Sizes of a hand in the wrist frame, metres, for a right hand with straight fingers.

    Args:
        side: Which hand; a left hand is the mirror image in x.
        scale: Factor on every length; 1 is an adult's hand of 0.19 m.
        roots: Position of each finger's first joint.
        lengths: Lengths of each finger's three bones beyond that joint.
        fan: Angle of each straight finger to y, radians, positive toward the thumb.
        girth: Factor on the thickness of fingers, palm and forearm; the skeleton is the same.

    Raises:
        ValueError: The side is neither ``right`` nor ``left``, the scale is not in (0.3, 3), or
            the girth is not in (0.5, 2).
    """

    side: Side = "right"
    scale: float = 1.0
    roots: Mapping[str, tuple[float, float, float]] = field(
        default_factory=lambda: {
            "thumb": (0.022, 0.022, 0.012),
            "index": (0.024, 0.088, 0.0),
            "middle": (0.0, 0.090, 0.0),
            "ring": (-0.019, 0.084, 0.0),
            "little": (-0.036, 0.074, 0.0),
        }
    )
    lengths: Mapping[str, tuple[float, float, float]] = field(
        default_factory=lambda: {
            "thumb": (0.044, 0.034, 0.027),
            "index": (0.044, 0.026, 0.022),
            "middle": (0.048, 0.030, 0.023),
            "ring": (0.044, 0.028, 0.023),
            "little": (0.035, 0.021, 0.020),
        }
    )
    fan: Mapping[str, float] = field(
        default_factory=lambda: {"index": 0.06, "middle": 0.0, "ring": -0.07, "little": -0.16}
    )
    girth: float = 1.0

    def __post_init__(self) -> None:
        if self.side not in ("right", "left"):
            raise ValueError(f"side must be 'right' or 'left', got {self.side!r}")
        if not 0.3 < self.scale < 3:
            raise ValueError(f"scale must lie in (0.3, 3), 1 being an adult, got {self.scale}")
        if not 0.5 < self.girth < 2:
            raise ValueError(f"girth must lie in (0.5, 2), 1 being usual, got {self.girth}")


@dataclass(frozen=True)
class Skeleton:
    """A posed hand in the wrist frame.

    Args:
        joints: The 22 joints, metres, shape (22, 3), in the order of ``SKELETON_NAMES``.
        frames: ``wrist_from_joint``, shape (22, 4, 4); y points along the bone that leaves the
            joint, z to the palm's side. On a left hand they are mirrored and so left-handed.
    """

    joints: npt.NDArray[np.float64]
    frames: npt.NDArray[np.float64]


# The thumb leaves its root sideways and slightly out of the palm; y along it, z to its pulp.
_THUMB_Y = np.array([0.68, 0.62, 0.39]) / np.linalg.norm([0.68, 0.62, 0.39])
_THUMB_Z = np.array([-0.62, 0.15, 0.77]) - np.dot([-0.62, 0.15, 0.77], _THUMB_Y) * _THUMB_Y
_THUMB_Z /= np.linalg.norm(_THUMB_Z)
_THUMB_ROOT = np.stack([np.cross(_THUMB_Y, _THUMB_Z), _THUMB_Y, _THUMB_Z], axis=1)


def forward_kinematics(angles: npt.ArrayLike, shape: HandShape | None = None) -> Skeleton:
    """Pose the 22-joint skeleton by its joint angles.

    A spread turns a finger sideways (positive toward the thumb), a stretch bends it to the palm.

    Args:
        angles: The twenty angles in the order of ``ANGLE_NAMES``, radians, shape (20,).
        shape: Sizes and side of the hand; an adult's right hand where it is left out.

    Raises:
        ValueError: There are not twenty finite angles.
    """
    shape = shape or HandShape()
    q = np.asarray(angles, dtype=float)
    if q.shape != (20,) or not np.isfinite(q).all():
        raise ValueError(f"angles must be 20 finite radians, got shape {q.shape}: {q!r}")
    frames = np.tile(np.eye(4), (22, 1, 1))
    frames[1, :3, 3] = (0.0, 0.03, 0.0)
    for i, finger in enumerate(_FINGER_JOINTS):
        spread, *stretches = q[4 * i : 4 * i + 4]
        if finger == "thumb":
            turn = _THUMB_ROOT @ Rotation.from_euler("z", -spread).as_matrix()
        else:
            turn = Rotation.from_euler("z", -(shape.fan[finger] + spread)).as_matrix()
        position = np.array(shape.roots[finger])
        for joint in range(4):
            if joint < 3:
                turn = turn @ Rotation.from_euler("x", stretches[joint]).as_matrix()
            frame = frames[2 + 4 * i + joint]
            frame[:3, :3], frame[:3, 3] = turn, position
            if joint < 3:
                position = position + shape.lengths[finger][joint] * turn[:, 1]
    frames[:, :3, 3] *= shape.scale
    if shape.side == "left":
        frames[:, 0, :] *= -1.0
    return Skeleton(joints=frames[:, :3, 3].copy(), frames=frames)


def keypoints_from_skeleton(joints: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Drop the virtual palm point: skeleton joints, which must be (22, 3), to keypoints (21, 3)."""
    joints = np.asarray(joints, dtype=float)
    if joints.shape != (22, 3):
        raise ValueError(f"a skeleton has 22 joints, shape (22, 3); got {joints.shape}")
    return np.delete(joints, 1, axis=0)


def check_keypoints(keypoints: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the keypoints as (21, 3) floats, or say what is wrong with them.

    Raises:
        ValueError: Another shape, a NaN or an infinite value (its keypoint is named).
    """
    points = np.asarray(keypoints, dtype=float)
    if points.shape != (21, 3):
        raise ValueError(f"a hand has 21 keypoints, shape (21, 3) in metres; got {points.shape}")
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        names = ", ".join(KEYPOINT_NAMES[i] for i in np.flatnonzero(bad))
        raise ValueError(f"keypoints must be finite; not so: {names}")
    return points


def wrist_axes(keypoints: torch.Tensor) -> torch.Tensor:
    """Rotation of the wrist frame from keypoints (B, 21, 3) alone, the side taken as right.

    On a left hand z points out of the back of the hand; the frame turns with the hand all the same.

    Returns:
        ``frame_from_wrist`` rotations, shape (B, 3, 3), columns x, y, z; zeros where the knuckles
        and the wrist lie on one line, so that the rotation is undefined.
    """
    import torch

    wrist = keypoints[:, 0]
    index, middle, little = (keypoints[:, FINGERS[f][0]] for f in ("index", "middle", "little"))
    y = torch.nn.functional.normalize(middle - wrist, dim=-1)
    normal = torch.linalg.cross(index - wrist, little - wrist)
    z = normal - (normal * y).sum(-1, keepdim=True) * y
    z = torch.nn.functional.normalize(z, dim=-1)
    return torch.stack([torch.linalg.cross(y, z), y, z], dim=-1)  # (B, 3, 3)


def absolute_hand_feature(keypoints: torch.Tensor, *, wrist_rotation: bool = True) -> torch.Tensor:
    """The holding pose itself, F_hand^abs, (B, 63): keypoints in the wrist frame, metres.

    Those of the camera frame, metres, (B, 21, 3), are turned into it, as the paper describes: the
    feature does not change when the camera moves or turns. Without `wrist_rotation` only the wrist
    is subtracted, as the published code does: it changes when the camera turns. Source: paper,
    section III-B; the ledger's row on the wrist frame.
    """
    centred = keypoints - keypoints[:, :1]  # (B, 21, 3)
    if wrist_rotation:
        centred = centred @ wrist_axes(keypoints)
    return centred.flatten(1)


def relative_hand_feature(keypoints: torch.Tensor, centers: torch.Tensor) -> torch.Tensor:
    """Where the hand is seen from a voxel, F_hand^rel: keypoints minus the voxel's centre.

    From keypoints (P, 21, 3) or (1, 21, 3) and centres (P, 3), camera frame, to (P, 63), all
    metres. Source: paper, section III-B.
    """
    return (keypoints - centers[:, None]).flatten(1)


def lift_keypoints(
    uv: npt.ArrayLike, relative_depth: npt.ArrayLike, wrist_depth: float, camera: Intrinsics
) -> npt.NDArray[np.float64]:
    """Lift 2.5D keypoints to 3D by the wrist's depth, as the paper's real system does.

    From pixels (21, 2), depths relative to the wrist's, metres, (21,), the wrist's z-depth, and the
    intrinsics of that image, to the camera frame, metres, (21, 3). ValueError where a shape
    differs, the wrist's depth is not positive and finite, or a keypoint would lie behind the
    camera.
    """
    pixels, relative = np.asarray(uv, dtype=float), np.asarray(relative_depth, dtype=float)
    if pixels.shape != (21, 2):
        raise ValueError(f"uv must have shape (21, 2) in pixels, got {pixels.shape}")
    if relative.shape != (21,):
        raise ValueError(f"relative_depth must have shape (21,) in metres, got {relative.shape}")
    if not np.isfinite(wrist_depth) or wrist_depth <= 0:
        raise ValueError(f"wrist_depth must be positive metres, got {wrist_depth}")
    z = wrist_depth + relative
    if (z <= 0).any():
        worst = int(np.argmin(z))
        raise ValueError(f"keypoint {KEYPOINT_NAMES[worst]} lies behind the camera: {z[worst]} m")
    return check_keypoints(unproject(pixels, z, camera))


def wrist_depth_at(
    depth: FloatArray,
    uv_wrist: npt.ArrayLike,
    hand_mask: BoolArray | None = None,
    *,
    window: int = 9,
) -> float:
    """Measure the depth, metres, at the wrist: the median of the valid depth around its pixel.

    Of depth (H, W), metres, in a square of `window` pixels around (u, v) those of the hand mask
    count, (H, W), if there is one; where none is valid, it is the median over the whole mask. The
    camera sees the skin, a few centimetres in front of the joint; no correction is made. ValueError
    where there is no valid depth at all, or the pixel is not two finite numbers.
    """
    pixel = np.asarray(uv_wrist, dtype=float)
    if pixel.shape != (2,) or not np.isfinite(pixel).all():
        raise ValueError(f"uv_wrist must be a finite pixel (u, v), got {pixel.tolist()}")
    u, v = (round(float(c)) for c in pixel)
    usable = valid_depth(depth)
    if hand_mask is not None:
        usable = usable & hand_mask
    half = window // 2
    rows = slice(max(v - half, 0), max(v + half + 1, 0))
    columns = slice(max(u - half, 0), max(u + half + 1, 0))
    near = depth[rows, columns][usable[rows, columns]]
    if near.size == 0 and hand_mask is not None:
        near = depth[usable]
    if near.size == 0:
        raise ValueError(f"no valid depth around the wrist's pixel ({u}, {v})")
    return float(np.median(near))
