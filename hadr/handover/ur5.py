"""The UR5's geometry: forward kinematics, all closed-form inverse solutions, limits.

Two base frames and two tool frames are in use for this arm, and mixing them up is the usual
mistake. Everything here is written in the Denavit-Hartenberg (DH) frames, `dh_base` and `flange`;
`BASE_LINK_FROM_DH_BASE` and `FLANGE_FROM_EE_LINK` lead to the names of the ROS description.
"""

import math
from itertools import product

import cv2
import numpy as np

from hadr.camera import Array
from hadr.handover.poses import check_pose
from hadr.handover.robot import UnreachableError

DH_A: Array = np.array([0.0, -0.425, -0.39225, 0.0, 0.0, 0.0])
"""Link lengths a_i in metres."""
DH_D: Array = np.array([0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823])
"""Link offsets d_i in metres."""
DH_ALPHA: Array = np.array([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0])
"""Link twists alpha_i in radians."""

JOINT_LOWER: Array = np.array([-2, -2, -1, -2, -2, -2]) * np.pi
JOINT_UPPER: Array = -JOINT_LOWER
"""Joint limits in radians: one turn each way, half a turn for the elbow."""
JOINT_SPEED: float = np.pi
"""Largest joint speed in radians per second (180 degrees per second)."""
REACH: float = 0.85
"""Working radius in metres, measured from the shoulder's centre to the flange."""

BASE_LINK_FROM_DH_BASE: Array = np.diag([-1.0, -1.0, 1.0, 1.0])
"""ROS `base_link` is the DH base turned by half a turn about the vertical."""
FLANGE_FROM_EE_LINK: Array = np.array(
    [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""ROS `ee_link`, whose x axis points out of the flange, seen from the DH flange frame."""

SHOULDER_OFFSET = 0.13585
ELBOW_OFFSET = -0.1197
"""How far the upper arm stands beside the shoulder's plane, and the forearm beside the upper arm,
metres; from the ROS description. The DH table folds both into d_4."""


def check_joints(joints: Array) -> Array:
    """Six joint angles (..., 6) as float64; ValueError for another shape, NaN or infinity."""
    angles = np.asarray(joints, dtype=np.float64)
    if angles.shape[-1:] != (6,):
        raise ValueError(f"joints must be six angles in radians, got shape {angles.shape}")
    if not np.isfinite(angles).all():
        raise ValueError(f"joints must be finite, got {angles}")
    return angles


def _dh_parts() -> tuple[Array, Array, Array]:
    """What of the DH transforms, (6, 4, 4) each, is fixed, goes with cosine, and with sine."""
    fixed, by_cosine, by_sine = np.zeros((3, 6, 4, 4))
    for i, (alpha, a, d) in enumerate(zip(DH_ALPHA.tolist(), DH_A, DH_D, strict=True)):
        c, s = math.cos(alpha), math.sin(alpha)
        fixed[i, 2:] = [0, s, c, d], [0, 0, 0, 1]
        by_cosine[i, :2] = [1, 0, 0, a], [0, c, -s, 0]
        by_sine[i, :2] = [0, -c, s, 0], [1, 0, 0, a]
    return fixed, by_cosine, by_sine


_FIXED, _BY_COSINE, _BY_SINE = _dh_parts()


def link_transform(index: int, angle: float) -> Array:
    """The DH transform (4, 4) of joint 0 to 5 at an angle in radians.

    Rotate by the angle about z, shift d along z, shift a along x, twist by alpha.
    """
    turned = math.cos(angle) * _BY_COSINE[index] + math.sin(angle) * _BY_SINE[index]
    return np.asarray(_FIXED[index] + turned)


def joint_frames(joints: Array) -> Array:
    """Poses (..., 7, 4, 4), metres, base to flange in `dh_base`; joint angles (..., 6), radians."""
    angles = check_joints(joints)
    flat = angles.ravel().tolist()  # numpy's sine may round otherwise than that of math
    turns = np.array([*map(math.cos, flat), *map(math.sin, flat)]).reshape(2, *angles.shape, 1, 1)
    moves = _FIXED + turns[0] * _BY_COSINE + turns[1] * _BY_SINE
    frames = np.empty((7, *angles.shape[:-1], 4, 4))
    frames[0] = np.eye(4)
    for i in range(6):
        np.matmul(frames[i], moves[..., i, :, :], out=frames[i + 1])
    return np.moveaxis(frames, 0, -3)


def forward_kinematics(joints: Array) -> Array:
    """The flange's pose (4, 4), metres, in `dh_base`, for joint angles (6,) in radians."""
    flange: Array = joint_frames(joints)[-1]
    return flange


def ros_forward_kinematics(joints: Array) -> Array:
    """The same pose under ROS' names: base_link_from_ee_link."""
    return BASE_LINK_FROM_DH_BASE @ forward_kinematics(joints) @ FLANGE_FROM_EE_LINK


def singularity(joints: Array) -> float:
    """Smallest singular value of the flange's Jacobian at joint angles (6,): 0 where singular.

    Metres and radians a radian.
    """
    return float(np.linalg.svd(_jacobian(joint_frames(joints)), compute_uv=False)[-1])


def _jacobian(frames: Array) -> Array:
    """How the flange moves and turns by each of the six joints, (..., 6, 6), of `joint_frames`."""
    axes, way = frames[..., :6, :3, 2], frames[..., 6:, :3, 3] - frames[..., :6, :3, 3]
    on, back = [1, 2, 0], [2, 0, 1]  # several times as quick as np.cross
    moved = axes[..., on] * way[..., back] - axes[..., back] * way[..., on]
    return np.concatenate([moved, axes], axis=-1)


def joints_toward(joints: Array, motion: Array) -> Array:
    """About the joint angles once the tool has moved by a rigid motion (..., 4, 4), `base_link`.

    From joint angles (6,), radians, for each motion: (..., 6). Three steps of damped least squares:
    within a millimetre after 10 cm; for what is far out of reach just some finite angles. Never
    another of the solutions.
    """
    frames = joint_frames(joints)
    goal = BASE_LINK_FROM_DH_BASE @ motion @ BASE_LINK_FROM_DH_BASE @ frames[6]
    for step in range(3):
        frames = joint_frames(joints) if step else frames
        flange = frames[..., 6, :, :]
        off = goal[..., :3, :3] @ flange[..., :3, :3].swapaxes(-1, -2)
        turn = np.array([cv2.Rodrigues(one)[0][:, 0] for one in off.reshape(-1, 3, 3)])
        way = goal[..., :3, 3] - flange[..., :3, 3]
        missing = np.concatenate([way, turn.reshape(way.shape)], axis=-1)
        jacobian = _jacobian(frames)  # a row for each joint
        damped = jacobian.swapaxes(-1, -2) @ jacobian + _DAMPING * np.eye(6)
        joints = joints + (jacobian @ np.linalg.solve(damped, missing[..., None]))[..., 0]
    return joints


def link_outline(joints: Array) -> Array:
    """Points (..., 9, 3) along the arm's real links from the base's foot to the flange, `dh_base`.

    Metres, for joint angles (..., 6) in radians. Upper arm and forearm stand beside the shoulder's
    plane, into which the DH frames put all links. A picture or a check against the table wants
    them where they are.
    """
    frames = joint_frames(joints)
    origin, sideways = frames[..., :3, 3], frames[..., 1:2, :3, 2]
    upper, fore = sideways * SHOULDER_OFFSET, sideways * (SHOULDER_OFFSET + ELBOW_OFFSET)
    arm = origin[..., 1:3, :] + upper, origin[..., 2:4, :] + fore
    return np.concatenate([origin[..., :2, :], *arm, origin[..., 4:, :]], axis=-2)


LINK_RADII: tuple[float, ...] = (0.060, 0.054, 0.045, 0.040, 0.040, 0.038)
"""Radius of each moving link, shoulder to third wrist, metres: capsules along `link_outline`."""
LINK_LINES: tuple[tuple[int, int, int], ...] = (
    *((0, 0, 1), (0, 1, 2), (1, 2, 3), (2, 3, 4), (2, 4, 5)),
    *((3, 5, 6), (4, 6, 7), (5, 7, 8)),
)
"""Each capsule's link, and the two points of the outline between which it runs."""


_DAMPING = 1e-4


_LINKS, _FIRST, _LAST = np.array(LINK_LINES).T
_RADII = np.array(LINK_RADII)[_LINKS][:, None]


def link_capsules(joints: Array) -> Array:
    """The moving links at joint angles (..., 6): rows of start, end, radius, (..., 8, 7), metres.

    In `dh_base`. The first begins 4 cm above the base's foot; the last one's cap is around the
    gripper's root.
    """
    points = link_outline(joints)
    radii = np.broadcast_to(_RADII, (*points.shape[:-2], *_RADII.shape))
    rows: Array = np.concatenate([points[..., _FIRST, :], points[..., _LAST, :], radii], axis=-1)
    rows[..., 0, 2] += 0.04
    return rows


def link_surfaces(joints: Array) -> Array:
    """All moving links, which a person may meet: `link_capsules`, but in `base_link`."""
    return link_capsules(joints) * [-1.0, -1.0, 1.0, -1.0, -1.0, 1.0, 1.0]


def inverse_kinematics(dh_base_from_flange: Array, free_angle: float = 0.0) -> Array:
    """All joint angles that bring the flange to a pose.

    The shoulder can stand left or right, the wrist be flipped or not, the elbow up or down: up to
    eight solutions. Where the wrist's fifth angle is 0 or pi, the fourth and the sixth axis are
    parallel and only their sum or difference counts; then the sixth angle is set to `free_angle`.

    Args:
        dh_base_from_flange: Target pose, shape (4, 4), metres.
        free_angle: Sixth joint angle in radians at that singularity.

    Returns:
        Distinct solutions, shape (n, 6) with n from 1 to 8, angles in (-pi, pi] radians.

    Raises:
        UnreachableError: The target is too near to the base's axis or too far away.
        ValueError: The target is no rigid transform.
    """
    target = check_pose(dh_base_from_flange, "dh_base_from_flange")
    rotation = target[:3, :3]
    wrist = target[:3, 3] - DH_D[5] * rotation[:, 2]
    distance = float(np.hypot(wrist[0], wrist[1]))
    if distance < DH_D[3] - 1e-9:
        raise UnreachableError(
            f"the wrist would stand {distance:.3f} m from the base's axis, inside the cylinder of "
            f"{DH_D[3]:.3f} m that the arm's sideways offset leaves unreachable"
        )
    bearing = np.arctan2(wrist[1], wrist[0]) + np.pi / 2
    swing = np.arccos(min(1.0, DH_D[3] / distance))
    solutions: list[Array] = []
    stretches: list[float] = []
    for shoulder, flip in product((1.0, -1.0), (1.0, -1.0)):
        q1 = bearing + shoulder * swing
        # the base's sideways axis, written in the flange frame: (sin q5 cos q6, -sin q5 sin q6, .)
        sideways = np.array([np.sin(q1), -np.cos(q1), 0.0]) @ rotation
        sine = float(np.hypot(sideways[0], sideways[1]))
        q5 = flip * np.arctan2(sine, sideways[2])
        sixth = [np.arctan2(-flip * sideways[1], flip * sideways[0])]
        if sine < 1e-8:  # only q4 and q6 together count: the free angle, or the nearest that works
            q5 = 0.0 if sideways[2] > 0 else np.pi
            sixth = [free_angle + np.deg2rad(5.0 * k * s) for k in range(37) for s in (1, -1)]
        for q6 in sixth:
            found, stretch = _planar_solutions(target, float(q1), float(q5), float(q6))
            stretches.append(stretch)
            solutions.extend(found)
            if found:
                break
    if not solutions:
        raise UnreachableError(
            f"the wrist would have to be {min(stretches):.3f} m from the shoulder; upper arm and "
            f"forearm reach from {abs(DH_A[1] - DH_A[2]):.3f} to {-DH_A[1] - DH_A[2]:.3f} m"
        )
    return distinct_solutions(np.stack(solutions))


def _planar_solutions(target: Array, q1: float, q5: float, q6: float) -> tuple[list[Array], float]:
    """Joint vectors for given first, fifth and sixth angles, and shoulder to wrist 1 in metres."""
    wrist_part = link_transform(4, q5) @ link_transform(5, q6)
    arm = np.linalg.inv(link_transform(0, q1)) @ target @ np.linalg.inv(wrist_part)
    # wrist 1 in the plane of upper arm and forearm; d_4 lies along this frame's minus y
    x, y = (arm @ np.array([0.0, -DH_D[3], 0.0, 1.0]))[:2]
    stretch = float(np.hypot(x, y))
    cosine = (stretch**2 - DH_A[1] ** 2 - DH_A[2] ** 2) / (2 * DH_A[1] * DH_A[2])
    if abs(cosine) > 1 + 1e-9:
        return [], stretch
    solutions = []
    for elbow in (1.0, -1.0):
        q3 = elbow * np.arccos(np.clip(cosine, -1.0, 1.0))
        q2 = np.angle((x + 1j * y) / (DH_A[1] + DH_A[2] * np.exp(1j * q3)))
        total = np.arctan2(arm[1, 0], arm[0, 0])
        solutions.append(np.array([q1, q2, q3, total - q2 - q3, q5, q6]))
    return solutions, stretch


def wrap_angle(angle: Array) -> Array:
    """Angles in radians, any shape, brought into (-pi, pi]."""
    wrapped: Array = -((np.pi - np.asarray(angle, dtype=np.float64)) % (2 * np.pi) - np.pi)
    return wrapped


def distinct_solutions(joints: Array) -> Array:
    """Of joint vectors (n, 6) that differ by whole turns only, keep the first, in (-pi, pi]."""
    rows, kept = wrap_angle(joints), list[int]()
    alike = np.abs(wrap_angle(rows[:, None] - rows)).max(axis=2) < 1e-5
    for row in range(len(rows)):
        if not alike[row, kept].any():
            kept.append(row)
    return rows[kept]


def nearest_turns(joints: Array, current: Array) -> Array:
    """Add whole turns so that each joint is as near as its limits allow to where it is now, (6,).

    The joint angles (n, 6) lie in (-pi, pi], radians; so do those of the same poses that come back,
    but for whole turns.
    """
    turns = 2 * np.pi * np.arange(-2, 3)[:, None, None]
    choices = joints[None] + turns  # (5, n, 6)
    allowed = (choices >= JOINT_LOWER - 1e-12) & (choices <= JOINT_UPPER + 1e-12)
    distance = np.where(allowed, np.abs(choices - current), np.inf)
    best = distance.argmin(axis=0)[None]
    nearest: Array = np.take_along_axis(choices, best, axis=0)[0]
    return np.clip(nearest, JOINT_LOWER, JOINT_UPPER)
