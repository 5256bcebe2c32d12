"""Whether a gripper would touch the hand, the object or anything else: distances to boxes.

The gripper is four boxes (`hadr.handover.grasping.gripper`). Whoever
moves straight along the approach axis sweeps a box out of a box, so the whole way from the
pre-grasp to the end is checked at once and exactly. The hand is its skeleton with flesh around it.

Points, keypoints (21, 3) and grasps are written in one frame, metres. `back` is the distance of the
pre-grasp, `forward` how far past the grasp's point the fingertips end.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hadr.hand import BONES, check_keypoints
from hadr.handover.grasping.grasps import BACK, FORWARD, Grasps
from hadr.handover.grasping.gripper import gripper_boxes

Array = NDArray[np.float64]

FLESH = 0.010
"""Thickness of flesh around the bones of the hand, metres."""
NOISE = 3
"""So many points may be met."""


def hand_points(keypoints: Array) -> Array:
    """Points (m, 3) along the hand's twenty bones and across the palm, from keypoints (21, 3)."""
    points = check_keypoints(keypoints)
    bones = [*BONES, (5, 9), (9, 13), (13, 17)]
    start, end = (points[[bone[i] for bone in bones]] for i in (0, 1))
    along = np.linspace(0.0, 1.0, 5)[None, :, None]
    line: Array = (start[:, None] * (1 - along) + end[:, None] * along).reshape(-1, 3)
    return line


def hand_distance(base_from_tool: Array, width: float, keypoints: Array) -> float:
    """Free space between the gripper's surface and the skin, metres; 0 or less where they touch.

    The tool's pose (4, 4) and the keypoints (21, 3) are written in one frame, metres.
    """
    boxes = gripper_boxes(np.array([width]))
    gap = _gaps(np.asarray(base_from_tool)[None], boxes, hand_points(keypoints))
    return float(gap.min()) - FLESH


def way_to_hand(grasps: Grasps, keypoints: Array) -> Array:
    """Smallest free space between gripper and skin on each grasp's way in: metres, shape (n,)."""
    boxes = gripper_boxes(grasps.widths, behind=BACK, ahead=FORWARD)
    gap: Array = _gaps(grasps.poses, boxes, hand_points(keypoints)).min(axis=1, initial=np.inf)
    return gap - FLESH


def free_of_hand(grasps: Grasps, keypoints: Array) -> NDArray[np.bool_]:
    """Which grasps keep 2 cm to the skin on their whole way in, (n,)."""
    free: NDArray[np.bool_] = way_to_hand(grasps, keypoints) >= 0.02
    return free


def free_of_object(grasps: Grasps, points: Array) -> NDArray[np.bool_]:
    """Which grasps get the object between the fingers without running into it on their way.

    Beside the fingers the grasp's own width says what is free; to the bar and the palm 3 mm are
    kept. A few points may be met (noise).
    """
    boxes = gripper_boxes(grasps.widths, behind=BACK, ahead=FORWARD)
    boxes[:, 2:, 0] -= 0.003
    boxes[:, 2:, 1] += 0.003
    return _count_inside(grasps, boxes, points) <= NOISE


def free_of_scene(
    grasps: Grasps, scene_points: Array, object_points: Array, clearance: float = 0.01
) -> NDArray[np.bool_]:
    """Which grasps keep a clearance to everything else that was measured: hand, arm, table.

    Scene points nearer than 8 mm to the object's points are taken for its rim, which a mask never
    cuts exactly; a few may be nearer than the clearance (noise).
    """
    beside = cKDTree(object_points).query(scene_points, distance_upper_bound=0.008)[0]
    boxes = gripper_boxes(grasps.widths, behind=BACK, ahead=FORWARD)
    boxes[:, :, 0] -= clearance
    boxes[:, :, 1] += clearance
    return _count_inside(grasps, boxes, scene_points[np.isinf(beside)]) <= NOISE


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
