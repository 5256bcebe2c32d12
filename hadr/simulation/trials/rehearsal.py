"""A rehearsal of the handover without physics: a hand that moves, a glass fixed to it, a UR5.

Everything is geometry in the robot's base frame: the human stands beyond the object and faces
the robot. What the camera would restore is taken from the glass itself, the side that it sees.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import transform_points
from hadr.hand import HandShape, forward_kinematics, keypoints_from_skeleton
from hadr.handover.grasping.candidates import FINGER_HEIGHT
from hadr.handover.grasping.collision import FINGER_LENGTH, hand_distance
from hadr.handover.recording import RecordedRobot
from hadr.handover.robot import SimulatedUR5
from hadr.handover.ur5 import Array
from hadr.handover.workflow import Handover, Observation, Stage, pose_distance
from hadr.records.caches import read_only
from hadr.synthesis.glass.objects import bodies, glass_object
from hadr.synthesis.glass.shape import GlassObject

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
        return read_only(points)

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
        noise: Standard deviation of each keypoint coordinate, metres. Never quite 0 in a real
            hand; the workflow takes keypoints that stay bitwise the same for a camera that hangs.
        lost_from: From this time on no hand is found, seconds.
        nan_from: From this time on one keypoint is NaN, seconds.
    """

    scene: HeldGlass
    base_from_camera: Array
    seed: int = 0
    drift: float = 0.04
    turn: float = float(np.deg2rad(12.0))
    calm_after: float = 2.0
    noise: float = 1e-5
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
        return Observation(time, keypoints, transform_points(camera_from_base, self._seen))

    @cached_property
    def _seen(self) -> Array:
        """The side of the glass that the camera sees at time 0, base frame, shape (n, 3)."""
        return self.scene.visible_points(self.base_from_camera[:3, 3])


def width_between(base_from_tool: Array, base_from_glass: Array, glass: GlassObject) -> float:
    """How wide a glass is between the fingers.

    Args:
        base_from_tool: Tool pose, shape (4, 4), metres.
        base_from_glass: Pose of the glass, shape (4, 4), metres.
        glass: Which object.

    Returns:
        Metres along the closing axis; 0 where no part of the glass is between the fingers.
    """
    points = transform_points(
        np.linalg.inv(base_from_tool) @ base_from_glass, bodies(glass)[0].vertices
    )
    inside = (np.abs(points[:, 1]) < FINGER_HEIGHT / 2) & (np.abs(points[:, 0]) < 0.06)
    inside &= (points[:, 2] < 0) & (points[:, 2] > -FINGER_LENGTH)
    return float(np.ptp(points[inside, 0])) if inside.any() else 0.0


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
    handover: Handover,
    hand: MovingHand,
    *,
    dt: float = 1 / 30,
    longest: float = 30.0,
    past_stops: bool = False,
    picture_every: float = 0.0,
    spoil: Callable[[Observation], Observation] | None = None,
) -> list[Moment]:
    """Run the workflow against the moving hand until it finishes, stops or time is up.

    Once the fingers are closed and the arm pulls back, the hand lets go: the glass stays with
    the tool. There is no contact and no force in this; it shows the logic, not the success.

    Args:
        handover: The workflow over a `SimulatedUR5`.
        hand: The moving hand.
        dt: Time between two observations, seconds.
        longest: Give up after this long, seconds.
        past_stops: Go on after a stop, until the workflow has finished or given up.
        picture_every: Time between two pictures, seconds, in whole steps; 0: one every step.
        spoil: What breaks between the camera and the workflow; nothing where left out.

    Returns:
        One moment a step. `to_target` is the distance from the tool to the pre-grasp, NaN before
        there is one; `to_hand` the free space between gripper and skin.

    Raises:
        TypeError: The handover's robot is not a `SimulatedUR5`.
    """
    robot = handover.robot
    if isinstance(robot, RecordedRobot):
        robot = robot.robot
    if not isinstance(robot, SimulatedUR5):
        raise TypeError(f"a rehearsal needs a SimulatedUR5, got {type(robot).__name__}")
    moments: list[Moment] = []
    tool_from_glass = np.eye(4)
    newest = hand.observe(0.0)
    for step in range(round(longest / dt) + 1):
        time = step * dt
        moved = hand.motion(time)
        tool = robot.tool_pose()
        if handover.part not in ("let go", "retreat"):
            tool_from_glass = np.linalg.inv(tool) @ moved @ hand.scene.base_from_glass
        glass = tool @ tool_from_glass
        robot.between_fingers = width_between(tool, glass, hand.scene.glass)
        if time >= newest.time + picture_every - 1e-9:
            newest = hand.observe(time)
        seen = replace(newest, time=time, frame_time=newest.time)
        handover.step(seen if spoil is None else spoil(seen), dt)
        tool = robot.tool_pose()
        if handover.part in ("let go", "retreat"):
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
        halted = handover.stage in (Stage.STOPPED, Stage.GOING_HOME)
        if handover.over or (halted and not past_stops):
            break
    return moments
