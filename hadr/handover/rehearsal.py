"""A rehearsal of the handover without physics: a hand that moves, a glass fixed to it, a UR5.

Everything is geometry in the robot's base frame: the human stands beyond the object and faces
the robot. What the camera would restore is taken from the glass itself, the side that it sees.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import transform_points
from hadr.hand import HandShape, forward_kinematics, keypoints_from_skeleton
from hadr.handover.collision import hand_distance
from hadr.handover.robot import SimulatedUR5
from hadr.handover.ur5 import Array
from hadr.handover.workflow import Handover, Observation, Stage, pose_distance
from hadr.synthesis.objects import GlassObject, bodies, glass_object

HOLDING_ANGLES: Array = np.deg2rad(
    [-22, -15, -10, 31, 0, 53, 103, 12, 0, 59, 110, 25, 0, 50, 103, 28, 0, 60, 100, 45]
)
"""Joint angles in radians, shape (20,), of a hand closed around a stem."""


def camera_at(position: Array, look_at: Array) -> Array:
    """Place a camera so that it looks at a point with the image upright.

    Args:
        position: Shape (3,), metres, in the base frame (z up).
        look_at: Shape (3,), metres.

    Returns:
        base_from_camera, shape (4, 4); x right, y down, z forward.
    """
    forward = np.asarray(look_at, dtype=np.float64) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose


@dataclass(frozen=True)
class HeldGlass:
    """A hand and the glass in it, at rest, in the base frame.

    Attributes:
        glass: Which object.
        base_from_wrist: The hand's pose; x (the thumb's side) up, y toward the robot.
        axis_at: Where the glass's axis passes the palm, y and z in the wrist frame, metres.
        held_at: Height on the glass, metres, that lies beside the wrist.
        angles: The hand's joint angles, shape (20,), radians.
    """

    glass: GlassObject = field(default_factory=lambda: glass_object("0004"))
    base_from_wrist: Array = field(
        default_factory=lambda: np.array(
            [[0, -1, 0, 0.65], [0, 0, -1, 0.03], [1, 0, 0, 0.27], [0, 0, 0, 1]], dtype=np.float64
        )
    )
    axis_at: tuple[float, float] = (0.0865, 0.030)
    held_at: float = 0.065
    angles: Array = field(default_factory=lambda: HOLDING_ANGLES.copy())

    @cached_property
    def keypoints(self) -> Array:
        """The hand in the base frame, shape (21, 3), metres."""
        joints = forward_kinematics(self.angles, HandShape()).joints
        points: Array = transform_points(self.base_from_wrist, keypoints_from_skeleton(joints))
        return points

    @property
    def base_from_glass(self) -> Array:
        """Pose of the glass, whose own z axis is its axis and z = 0 its foot, shape (4, 4)."""
        wrist_from_glass = np.array(
            [
                [0, 0, 1, -self.held_at],
                [1, 0, 0, self.axis_at[0]],
                [0, 1, 0, self.axis_at[1]],
                [0, 0, 0, 1],
            ],
            dtype=np.float64,
        )
        return self.base_from_wrist @ wrist_from_glass

    def visible_points(self, viewpoint: Array, spacing: float = 0.004) -> Array:
        """Points of the glass's outside that face the camera and are not in the hand.

        Args:
            viewpoint: Where the camera stands in the base frame, shape (3,), metres.
            spacing: Thins the points to about one a cube of this size, metres.

        Returns:
            Shape (n, 3), metres, base frame: what a perfect restoration would give.
        """
        surface = bodies(self.glass)[0].moved(self.base_from_glass)
        points, normals = surface.vertices, surface.normals
        facing = ((viewpoint - points) * normals).sum(axis=1) > 0
        axis = self.base_from_glass
        outside = ((points - axis[:3, 3]) @ axis[:3, :3])[:, :2]
        turned = normals @ axis[:3, :3]
        outward = (outside * turned[:, :2]).sum(axis=1) >= 0  # not the inner wall
        hand = self.keypoints
        nearest = np.linalg.norm(points[:, None] - hand[None], axis=2).min(axis=1)
        kept: Array = points[facing & outward & (nearest > 0.015)]
        _, first = np.unique(np.floor(kept / spacing), axis=0, return_index=True)
        thinned: Array = kept[np.sort(first)]
        return thinned


@dataclass(frozen=True)
class MovingHand:
    """A hand that drifts and turns smoothly about where it started, seen by a camera.

    Attributes:
        scene: Hand and glass at rest.
        base_from_camera: Where the camera stands, shape (4, 4), metres.
        seed: Chooses the movement.
        drift: Largest displacement along each axis, metres.
        turn: Largest rotation about each axis, radians.
        calm_after: The movement dies down over about this long, seconds: people who hand
            something over come to rest. Infinity keeps the hand moving.
        noise: Standard deviation of each keypoint coordinate, metres.
        lost_from: From this time on no hand is found, seconds.
        nan_from: From this time on one keypoint is NaN, seconds.
    """

    scene: HeldGlass
    base_from_camera: Array
    seed: int = 0
    drift: float = 0.04
    turn: float = float(np.deg2rad(12.0))
    calm_after: float = 2.0
    noise: float = 0.0
    lost_from: float = np.inf
    nan_from: float = np.inf

    def motion(self, time: float) -> Array:
        """How hand and glass have moved since time 0: base_now_from_base_then, shape (4, 4)."""
        periods, signs = self._rhythm
        moved_for = time
        if np.isfinite(self.calm_after):
            moved_for = self.calm_after * np.tanh(time / self.calm_after)
        swing = signs * np.sin(2 * np.pi * moved_for / periods) * [[self.drift], [self.turn]]
        wrist = self.scene.base_from_wrist[:3, 3]
        moved = np.eye(4)
        moved[:3, :3] = Rotation.from_rotvec(swing[1]).as_matrix()
        moved[:3, 3] = wrist + swing[0] - moved[:3, :3] @ wrist
        return moved

    @cached_property
    def _rhythm(self) -> tuple[Array, Array]:
        """Periods in seconds and signs of the six swings, each of shape (2, 3)."""
        rng = np.random.default_rng(self.seed)
        return rng.uniform(3.0, 6.0, size=(2, 3)), rng.choice([-1.0, 1.0], size=(2, 3))

    def observe(self, time: float) -> Observation:
        """What perception says at a time in seconds, in the camera frame."""
        if time >= self.lost_from:
            return Observation(time)
        camera_from_base = np.linalg.inv(self.base_from_camera) @ self.motion(time)
        keypoints = transform_points(camera_from_base, self.scene.keypoints)
        if self.noise > 0:
            rng = np.random.default_rng((self.seed, round(time * 1e6)))
            keypoints = keypoints + rng.normal(0.0, self.noise, keypoints.shape)
        if time >= self.nan_from:
            keypoints[8] = np.nan
        points = None
        if time == 0.0:  # the workflow needs the object only to choose a grasp
            seen = self.scene.visible_points(self.base_from_camera[:3, 3])
            points = transform_points(camera_from_base, seen)
        return Observation(time, keypoints, points)


@dataclass(frozen=True)
class Moment:
    """One recorded step of a rehearsal, base frame, metres, radians, seconds."""

    time: float
    stage: Stage
    joints: Array
    outline: Array
    tool: Array
    opening: float
    keypoints: Array
    glass: Array
    to_target: float
    to_hand: float


def rehearse(
    handover: Handover, hand: MovingHand, *, dt: float = 1 / 30, longest: float = 30.0
) -> list[Moment]:
    """Run the workflow against the moving hand until it finishes, stops or time is up.

    Once the fingers are closed and the arm pulls back, the hand lets go: the glass stays with
    the tool. There is no contact and no force in this; it shows the logic, not the success.

    Args:
        handover: The workflow over a `SimulatedUR5`.
        hand: The moving hand.
        dt: Time between two observations, seconds.
        longest: Give up after this long, seconds.

    Returns:
        One moment a step. `to_target` is the distance from the tool to the pre-grasp, NaN before
        there is one; `to_hand` the free space between gripper and skin.

    Raises:
        TypeError: The handover's robot is not a `SimulatedUR5`.
    """
    robot = handover.robot
    if not isinstance(robot, SimulatedUR5):
        raise TypeError(f"a rehearsal needs a SimulatedUR5, got {type(robot).__name__}")
    moments: list[Moment] = []
    tool_from_glass: Array | None = None
    for step in range(round(longest / dt) + 1):
        time = step * dt
        handover.step(hand.observe(time), dt)
        tool = robot.tool_pose()
        moved = hand.motion(time)
        glass = moved @ hand.scene.base_from_glass
        if handover.part == "retreat":
            if tool_from_glass is None:
                tool_from_glass = np.linalg.inv(tool) @ glass
            glass = tool @ tool_from_glass
        keypoints = transform_points(moved, hand.scene.keypoints)
        to_target = np.nan
        if handover.target is not None:
            to_target = pose_distance(tool, handover.target)[0]
        moments.append(
            Moment(
                time=time,
                stage=handover.stage,
                joints=robot.joint_positions(),
                outline=robot.outline(),
                tool=tool,
                opening=robot.gripper_width(),
                keypoints=keypoints,
                glass=glass,
                to_target=to_target,
                to_hand=hand_distance(tool, robot.gripper_width(), keypoints),
            )
        )
        if handover.over:
            break
    return moments
