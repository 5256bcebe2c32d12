"""Whether a gripper would touch the hand, the object or anything else: distances to boxes.

The gripper is four boxes: two fingers, the bar that carries them and the palm behind it. Whoever
moves straight along the approach axis sweeps a box out of a box, so the whole way from the
pre-grasp to the end is checked at once and exactly. The hand is its skeleton with flesh around it.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hadr.hand import BONES, check_keypoints
from hadr.handover.dimensions import (
    BAR_LENGTH,
    FINGER_HEIGHT,
    FINGER_LENGTH,
    FINGER_WIDTH,
    PALM_SIZE,
    STEM_LENGTH,
)
from hadr.handover.grasping.grasps import Grasps

Array = NDArray[np.float64]

FLESH = 0.010
"""Thickness of flesh around the bones of the hand, metres."""


def fork(width: float) -> Array:
    """The gripper's centre lines, for pictures.

    Args:
        width: Opening between the fingers, metres.

    Returns:
        Four segments in the tool frame (x closing, z approach, origin between the fingertips),
        shape (4, 2, 3), metres: left finger, right finger, bar, stem.
    """
    x, back = width / 2 + FINGER_WIDTH / 2, -FINGER_LENGTH
    ends = [
        [(-x, 0, 0), (-x, 0, back)],
        [(x, 0, 0), (x, 0, back)],
        [(-x, 0, back), (x, 0, back)],
        [(0, 0, back), (0, 0, back - STEM_LENGTH)],
    ]
    return np.array(ends, dtype=np.float64)


def fork_points(base_from_tool: Array, width: float, spacing: int = 9) -> Array:
    """Points along the fork's four lines at a tool pose (4, 4): (4 * spacing, 3), metres."""
    along = np.linspace(0.0, 1.0, spacing)[None, :, None]
    segments = fork(width)
    points = (segments[:, None, 0] * (1 - along) + segments[:, None, 1] * along).reshape(-1, 3)
    return points @ base_from_tool[:3, :3].T + base_from_tool[:3, 3]


def gripper_boxes(widths: Array, *, behind: float = 0.0, ahead: float = 0.0) -> Array:
    """The gripper's body, or what it sweeps along its approach axis.

    Args:
        widths: Openings, shape (n,), metres.
        behind: The way begins this far behind the tool pose, metres.
        ahead: It ends this far past the tool pose, metres.

    Returns:
        Lower and upper corners in the tool frame (x closing, y height, z approach), shape
        (n, 4, 2, 3), metres: left finger, right finger, bar, palm.
    """
    inner = np.asarray(widths, dtype=np.float64) / 2
    outer, one = inner + FINGER_WIDTH, np.ones(len(inner))
    tall, wide, thick = FINGER_HEIGHT / 2, PALM_SIZE[0] / 2, PALM_SIZE[1] / 2
    bar, palm = -FINGER_LENGTH - BAR_LENGTH, -FINGER_LENGTH - PALM_SIZE[2]
    rows = [
        (-outer, -inner, tall, -FINGER_LENGTH, 0.0),
        (inner, outer, tall, -FINGER_LENGTH, 0.0),
        (-outer, outer, tall, bar, -FINGER_LENGTH),
        (-wide * one, wide * one, thick, palm, -FINGER_LENGTH),
    ]
    boxes = np.empty((len(inner), 4, 2, 3))
    for i, (low, high, half, back, front) in enumerate(rows):
        boxes[:, i, 0, 0], boxes[:, i, 1, 0] = low, high
        boxes[:, i, :, 1] = -half, half
        boxes[:, i, :, 2] = back - behind, front + ahead
    return boxes


def hand_points(keypoints: Array, spacing: int = 5) -> Array:
    """Points along the hand's twenty bones and across the palm.

    Args:
        keypoints: Shape (21, 3), metres.
        spacing: Points on each bone.

    Returns:
        Shape (m, 3), metres, in the keypoints' frame.
    """
    points = check_keypoints(keypoints)
    bones = [*BONES, (5, 9), (9, 13), (13, 17)]
    start, end = (points[[bone[i] for bone in bones]] for i in (0, 1))
    along = np.linspace(0.0, 1.0, spacing)[None, :, None]
    line: Array = (start[:, None] * (1 - along) + end[:, None] * along).reshape(-1, 3)
    return line


def hand_distance(base_from_tool: Array, width: float, keypoints: Array) -> float:
    """Free space between gripper and hand.

    Args:
        base_from_tool: Tool pose, shape (4, 4), metres.
        width: Opening, metres.
        keypoints: Hand in the same frame, shape (21, 3), metres.

    Returns:
        Metres between the gripper's surface and the skin; 0 or negative where they touch.
    """
    boxes = gripper_boxes(np.array([width]))
    gap = _gaps(np.asarray(base_from_tool)[None], boxes, hand_points(keypoints))
    return float(gap.min()) - FLESH


def way_to_hand(grasps: Grasps, keypoints: Array, *, back: float, forward: float) -> Array:
    """Smallest free space between gripper and skin on each grasp's way in.

    Args:
        grasps: Candidates.
        keypoints: Hand in the grasps' frame, shape (21, 3), metres.
        back: Distance of the pre-grasp, metres.
        forward: How far past the grasp's point the fingertips end, metres.

    Returns:
        Metres, shape (n,); 0 or negative where they touch.
    """
    boxes = gripper_boxes(grasps.widths, behind=back, ahead=forward)
    gap: Array = _gaps(grasps.poses, boxes, hand_points(keypoints)).min(axis=1, initial=np.inf)
    return gap - FLESH


def free_of_hand(
    grasps: Grasps,
    keypoints: Array,
    *,
    back: float = 0.10,
    forward: float = 0.05,
    clearance: float = 0.02,
) -> NDArray[np.bool_]:
    """Which grasps keep off the hand, on their whole way in from the pre-grasp.

    Args:
        grasps: Candidates.
        keypoints: Hand in the grasps' frame, shape (21, 3), metres.
        back: Distance of the pre-grasp, metres.
        forward: How far past the grasp's point the fingertips end, metres.
        clearance: Free space to keep to the skin, metres.

    Returns:
        True where the grasp keeps its distance, shape (n,).
    """
    free: NDArray[np.bool_] = (
        way_to_hand(grasps, keypoints, back=back, forward=forward) >= clearance
    )
    return free


def free_of_object(
    grasps: Grasps,
    points: Array,
    *,
    back: float = 0.10,
    forward: float = 0.05,
    clearance: float = 0.003,
    allowed: int = 3,
) -> NDArray[np.bool_]:
    """Which grasps get the object between the fingers without running into it on their way.

    Args:
        grasps: Candidates.
        points: Object's points in the grasps' frame, shape (n, 3), metres.
        back: Distance of the pre-grasp, metres.
        forward: How far past the grasp's point the fingertips end, metres.
        clearance: Free space to keep to the bar and the palm, metres; beside the fingers the
            grasp's own width says what is free.
        allowed: How many points may be met (noise).

    Returns:
        True where no more points than that are met, shape (n,).
    """
    boxes = gripper_boxes(grasps.widths, behind=back, ahead=forward)
    boxes[:, 2:, 0] -= clearance
    boxes[:, 2:, 1] += clearance
    return _count_inside(grasps, boxes, points) <= allowed


def free_of_scene(
    grasps: Grasps,
    scene_points: Array,
    object_points: Array,
    *,
    back: float = 0.10,
    forward: float = 0.05,
    clearance: float = 0.01,
    allowed: int = 3,
) -> NDArray[np.bool_]:
    """Which grasps keep off everything else that was measured: hand, arm, table.

    Args:
        grasps: Candidates.
        scene_points: Measured points without the object, in the grasps' frame, (m, 3), metres.
        object_points: The object's points, (n, 3), metres. Scene points nearer to them than 8 mm
            are taken for the object's rim, which a mask never cuts exactly.
        back: Distance of the pre-grasp, metres.
        forward: How far past the grasp's point the fingertips end, metres.
        clearance: Free space to keep, metres.
        allowed: How many points may be nearer (noise).

    Returns:
        True where no more points than that are nearer, shape (n,).
    """
    beside = cKDTree(object_points).query(scene_points, distance_upper_bound=0.008)[0]
    boxes = gripper_boxes(grasps.widths, behind=back, ahead=forward)
    boxes[:, :, 0] -= clearance
    boxes[:, :, 1] += clearance
    return _count_inside(grasps, boxes, scene_points[np.isinf(beside)]) <= allowed


def _count_inside(grasps: Grasps, boxes: Array, points: Array) -> NDArray[np.int64]:
    """How many points (m, 3) lie inside the boxes (n, k, 2, 3) of each grasp: (n,)."""
    poses, middle = grasps.poses, points.mean(axis=0) if len(points) else np.zeros(3)
    near = (points - middle).T.astype(np.float32)
    turn = poses[:, :3, :3].transpose(2, 0, 1).astype(np.float32)  # (3, n, 3)
    own = np.einsum("ani,ni->an", turn, (poses[:, :3, 3] - middle).astype(np.float32))
    local = [turn[i] @ near - own[i][:, None] for i in range(3)]  # x, y, z, each (n, m)
    limits = boxes.astype(np.float32)
    inside = np.zeros(local[0].shape, dtype=bool)
    for part in range(boxes.shape[1]):
        within = np.ones_like(inside)
        for i, value in enumerate(local):
            within &= (value >= limits[:, part, :1, i]) & (value <= limits[:, part, 1:, i])
        inside |= within
    count: NDArray[np.int64] = inside.sum(axis=1)
    return count


def _gaps(poses: Array, boxes: Array, points: Array) -> Array:
    """Distance of each point (m, 3) from the boxes (n, k, 2, 3) at poses (n, 4, 4): (n, m)."""
    turn = poses[:, :3, :3]
    own = np.einsum("nij,ni->nj", turn, poses[:, :3, 3])
    local = points @ turn - own[:, None]  # (n, m, 3)
    nearest = np.full(local.shape[:2], np.inf)
    for i in range(boxes.shape[1]):
        low, high = boxes[:, i, :1], boxes[:, i, 1:]
        beyond = np.maximum(np.maximum(low - local, local - high), 0.0)
        nearest = np.minimum(nearest, np.einsum("nmi,nmi->nm", beyond, beyond))
    gaps: Array = np.sqrt(nearest)
    return gaps
