"""Whether the robot would touch the person, the object or anything else: the one geometry of all.

Planning and guard ask here, and the physics is built of the same bodies. The gripper is four boxes
(`hadr.handover.grasping.gripper`); the links of the arm are capsules (`ur5.link_surfaces`).
Whoever moves straight along the approach axis sweeps a box out of a box, so the whole way from the
pre-grasp to the end is checked at once and exactly. The person is the skeleton of the hand with
flesh around it, and a forearm that goes on straight behind the wrist: how the wrist is bent, 21
keypoints do not say.

Points, keypoints (21, 3) and grasps are written in one frame, metres.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hadr.camera import Array
from hadr.hand import BONES, check_keypoints
from hadr.handover.grasping.grasps import PAPER_WAY, Grasps, Way
from hadr.handover.grasping.gripper import FINGER_HEIGHT, FINGER_LENGTH, gripper_boxes

PALM_LINES = ((1, 5), (5, 9), (9, 13), (13, 17))
"""Keypoints between which the palm's flesh is, besides the bones."""
LINES: tuple[tuple[int, int], ...] = (*BONES, *PALM_LINES)
"""Between which keypoints there is flesh."""


def _flesh(start: int, end: int) -> float:
    if start == 0 or (start, end) in PALM_LINES:
        return 0.013 if start > 1 else 0.016
    thumb, finger = (0.016, 0.013, 0.009), (0.0115, 0.009, 0.0075)
    return (thumb if start < 5 else finger)[(start - 1) % 4]


FLESH: Array = np.array([_flesh(*line) for line in LINES])
"""Thickness of flesh around each of `LINES` in a hand of size 1, metres, (24,)."""
LARGE = 1.25
"""Planning and guard reckon with so many times the flesh: they do not know whose hand it is. Of the
drawn skin of the experiment's 48 hands 95 % lie at most 4 mm outside of that, 99 % at most 7 mm (in
the median of the hands; in the worst one 7 and 11)."""
FOREARM_RADIUS, FOREARM_LENGTH = 0.035, 0.24
"""The person's forearm: radius, and how far it reaches behind the wrist, metres."""
NOISE = 3
"""So many points may be met."""


def hand_points(keypoints: Array) -> Array:
    """Points (m, 3) along the hand's twenty bones and across the palm, from keypoints (21, 3)."""
    points = check_keypoints(keypoints)
    start, end = points[_ENDS[:, 0]], points[_ENDS[:, 1]]
    line: Array = (start[:, None] * (1 - _ALONG) + end[:, None] * _ALONG).reshape(-1, 3)
    return line


_ENDS = np.array(LINES)
_BEHIND = np.linspace(FOREARM_RADIUS, FOREARM_LENGTH, 21)[:, None]
_ALONG = np.linspace(0.0, 1.0, 12)[:, None]  # 8 mm apart at most: skin less than 1 mm too low


def person(keypoints: Array) -> tuple[Array, Array]:
    """Hand and forearm as balls: middles (m, 3) in the keypoints' frame and radii (m,), metres.

    Keypoints all in one place tell no direction and have no forearm.
    """
    hand, back = hand_points(keypoints), keypoints[0] - keypoints[9]
    palm = float(np.linalg.norm(back))
    behind = _BEHIND if palm > 0 else _BEHIND[:0]
    flesh = LARGE * np.repeat(FLESH, len(_ALONG))
    radii = np.concatenate([flesh, np.full(len(behind), FOREARM_RADIUS)])
    return np.concatenate([hand, keypoints[0] + behind * (back / max(palm, 1e-9))]), radii


def hand_distance(
    poses: Array, width: float, keypoints: Array, links: Array | None = None
) -> float:
    """Free space between the robot's surface and the skin, metres; 0 or less where they touch.

    The least of `hand_gaps`.
    """
    return float(hand_gaps(poses, width, keypoints, links).min())


def hand_gaps(poses: Array, width: float, keypoints: Array, links: Array | None = None) -> Array:
    """Free space between the robot's surface and each ball of a `person`, metres, shape (m,).

    Of the gripper, open by a width, at a tool pose (4, 4) or all those on a way (n, 4, 4), and, if
    given, of the arm's capsules (k, 7), see `ur5.link_surfaces`, to a hand's keypoints (21, 3), all
    in one frame. Below 0 a ball is in the robot, so deep. ValueError where one is no number.
    """
    whole, tools = person(keypoints), np.reshape(poses, (-1, 4, 4))
    gap = _gaps(tools, gripper_boxes(np.full(len(tools), width)), whole[0]) - whole[1]
    least: Array = gap.min(axis=0)
    if links is not None:
        least = np.minimum(least, links_gaps(links, whole))
    bad = least[~np.isfinite(least)]
    if len(bad):
        raise ValueError(f"the distance to the hand is no number: {bad[0]}")
    return least


def between_pads(pose: Array, width: float, keypoints: Array) -> bool:
    """Whether a bone of a hand (21, 3) is between pads, open by a width at a tool pose; metres."""
    # bare bones, as seen, as flesh and the keypoints' error reach in beside many a glass: of 166
    # recorded closings none had a bone nearer than 7 mm to what the pads sweep
    half = np.array([width, FINGER_HEIGHT, FINGER_LENGTH]) / 2
    box = np.array([-half, half]) - [0, 0, half[2]]
    return bool(_gaps(pose[None], box[None, None], hand_points(keypoints)).min() < 0)


def links_gaps(links: Array, whole: tuple[Array, Array]) -> Array:
    """Free space between capsules (k, 7) of the arm and each ball of a `person`, metres, (m,)."""
    middles, radii = whole
    start, way = links[:, :3], links[:, 3:6] - links[:, :3]
    from_start = middles - start[:, None]  # (k, m, 3)
    along = np.einsum("kmi,ki->km", from_start, way)
    length = np.maximum(np.einsum("ki,ki->k", way, way), 1e-12)[:, None]
    part = np.clip(along / length, 0.0, 1.0)
    squares = np.einsum("kmi,kmi->km", from_start, from_start) + part * (part * length - 2 * along)
    gap: Array = np.sqrt(np.maximum(squares, 0.0)) - links[:, 6:] - radii
    least: Array = gap.min(axis=0)
    return least


def way_to_hand(grasps: Grasps, keypoints: Array, way: Way = PAPER_WAY) -> Array:
    """Smallest free space between gripper and skin on each grasp's way in: metres, shape (n,)."""
    boxes = gripper_boxes(grasps.widths, behind=way.back, ahead=way.last)
    middles, radii = person(keypoints)
    gap: Array = (_gaps(grasps.poses, boxes, middles) - radii).min(axis=1, initial=np.inf)
    return gap


def free_of_hand(grasps: Grasps, keypoints: Array) -> NDArray[np.bool_]:
    """Which grasps keep 2 cm to the skin on their whole way in, (n,)."""
    free: NDArray[np.bool_] = way_to_hand(grasps, keypoints) >= 0.02
    return free


def free_of_object(grasps: Grasps, points: Array, way: Way = PAPER_WAY) -> NDArray[np.bool_]:
    """Which grasps get the object between the fingers without running into it on their way.

    Beside the fingers the grasp's own width counts; to bar and palm 3 mm are kept, noise aside.
    """
    boxes = gripper_boxes(grasps.widths, behind=way.back, ahead=way.forward)
    boxes[:, 2:, 0] -= 0.003
    boxes[:, 2:, 1] += 0.003
    return _count_inside(grasps, boxes, points) <= NOISE


def free_of_scene(
    grasps: Grasps, scene_points: Array, object_points: Array, way: Way = PAPER_WAY
) -> NDArray[np.bool_]:
    """Which grasps keep 1 cm to everything else that was measured: hand, arm, table.

    Scene points nearer than 8 mm to the object's points are taken for its rim, which a mask never
    cuts exactly; a few may be nearer than 1 cm (noise).
    """
    beside = cKDTree(object_points).query(scene_points, distance_upper_bound=0.008)[0]
    boxes = gripper_boxes(grasps.widths, behind=way.back, ahead=way.last)
    boxes[:, :, 0] -= 0.01
    boxes[:, :, 1] += 0.01
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
    """Distance of each point (m, 3) from the boxes (n, k, 2, 3) at poses (n, 4, 4): (n, m).

    Inside of a box it is minus the way to its nearest face.
    """
    turn = poses[:, :3, :3]
    own = np.einsum("nij,ni->nj", turn, poses[:, :3, 3])
    # x, y and z first: sum and maximum over three arrays, not over three numbers of each point
    local = np.ascontiguousarray((points @ turn - own[:, None]).transpose(2, 0, 1))  # (3, n, m)
    nearest = np.full(local.shape[1:], np.inf)
    for low, high in boxes.transpose(1, 2, 3, 0)[..., None]:  # of each part (3, n, 1)
        beyond = np.maximum(low - local, local - high)
        outside = np.sqrt(np.square(np.maximum(beyond, 0.0)).sum(axis=0))
        nearest = np.minimum(nearest, outside + np.minimum(beyond.max(axis=0), 0.0))
    return nearest
