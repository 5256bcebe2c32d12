"""Whether a gripper would touch the hand or run into the object: distances to a fork.

The gripper is two fingers, 1 cm wide and 6 cm long, the bar between them and the stem behind. The
hand is its skeleton with flesh around it.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hadr.hand import BONES, check_keypoints
from hadr.handover.grasps import Grasps, forward_of

Array = NDArray[np.float64]

FINGER_WIDTH = 0.01
"""Width of a finger along the closing axis, metres."""
FINGER_LENGTH = 0.06
"""Length of a finger along the approach axis, metres."""
STEM_LENGTH = 0.06
"""Length of the gripper's body behind the bar, metres."""
FLESH = 0.010
"""Thickness of flesh around the bones of the hand, metres."""


def fork(width: float) -> Array:
    """The gripper's centre lines, for pictures and for distances.

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
    """Points along the fork at a tool pose.

    Args:
        base_from_tool: Tool pose in any frame, shape (4, 4), metres.
        width: Opening, metres.
        spacing: Points on each of the four segments.

    Returns:
        Shape (4 * spacing, 3), metres, in the pose's frame.
    """
    along = np.linspace(0.0, 1.0, spacing)[None, :, None]
    segments = fork(width)
    points = (segments[:, None, 0] * (1 - along) + segments[:, None, 1] * along).reshape(-1, 3)
    return points @ base_from_tool[:3, :3].T + base_from_tool[:3, 3]


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
    tree = cKDTree(hand_points(keypoints))
    nearest = float(tree.query(fork_points(base_from_tool, width))[0].min())
    return nearest - FLESH - FINGER_WIDTH / 2


def free_of_hand(
    grasps: Grasps, keypoints: Array, *, forward: float = 0.05, clearance: float = 0.02
) -> NDArray[np.bool_]:
    """Which grasps keep off the hand, on their whole way in from the pre-grasp.

    Args:
        grasps: Candidates.
        keypoints: Hand in the grasps' frame, shape (21, 3), metres.
        forward: How far past the grasp's point the fingertips end, metres.
        clearance: Free space to keep to the skin, metres.

    Returns:
        True where the grasp keeps its distance, shape (n,).
    """
    tree = cKDTree(hand_points(keypoints))
    needed = clearance + FLESH + FINGER_WIDTH / 2
    free = np.ones(len(grasps), dtype=bool)
    for row, (pose, width) in enumerate(zip(grasps.poses, grasps.widths, strict=True)):
        for shift in np.linspace(-0.10, forward, 4):
            fork_now = fork_points(forward_of(pose, float(shift)), float(width))
            if tree.query(fork_now)[0].min() < needed:
                free[row] = False
                break
    return free


def free_of_object(
    grasps: Grasps, points: Array, *, forward: float = 0.05, allowed: int = 3
) -> NDArray[np.bool_]:
    """Which grasps have the object between the fingers and not inside a finger or the bar.

    Args:
        grasps: Candidates.
        points: Object's points in the grasps' frame, shape (n, 3), metres.
        forward: How far past the grasp's point the fingertips end, metres.
        allowed: How many points may lie inside the gripper's body (noise).

    Returns:
        True where no more points than that are inside, shape (n,).
    """
    free = np.ones(len(grasps), dtype=bool)
    poses = forward_of(grasps.poses, forward)
    for row, (pose, width) in enumerate(zip(poses, grasps.widths, strict=True)):
        x, y, z = ((points - pose[:3, 3]) @ pose[:3, :3]).T
        slab = np.abs(y) < 0.01
        finger = (np.abs(x) > width / 2) & (np.abs(x) < width / 2 + FINGER_WIDTH)
        finger &= (z > -FINGER_LENGTH) & (z < 0)
        bar = (np.abs(x) < width / 2 + FINGER_WIDTH) & (z > -FINGER_LENGTH - 0.02)
        bar &= z < -FINGER_LENGTH
        free[row] = int((slab & (finger | bar)).sum()) <= allowed
    return free
