"""A rehearsal of the handover without physics: a hand that moves, a glass fixed to it, a UR5.

Everything is geometry in the robot's base frame: the human stands beyond the object and faces
the robot. What the camera would restore is taken from the glass itself, the side that it sees.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hadr.camera import Array, transform_points
from hadr.hand import HandShape
from hadr.handover.grasping.collision import hand_distance
from hadr.handover.grasping.gripper import FINGER_HEIGHT, FINGER_LENGTH
from hadr.handover.logs.run_log import RecordedRobot
from hadr.handover.observation import Observation
from hadr.handover.poses import camera_at, pose_distance
from hadr.handover.robot import UNLOCK_AFTER
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import Stage
from hadr.handover.workflow import Handover
from hadr.simulation.world.hand_motions import calmed, turned_about
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState
from hadr.synthesis.glass.objects import bodies
from hadr.synthesis.glass.shape import GlassObject
from hadr.synthesis.hand.mesh import SKIN_TONES
from hadr.synthesis.holding.hold import Hold

REHEARSAL_CAMERA: Array = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))
"""base_from_camera of a camera beside the rehearsed scene, shape (4, 4), metres."""
_GRIPPED = ("let go", "retreat", "carry")
HOLDING_ANGLES: Array = np.deg2rad(
    [-22, -15, -10, 31, 0, 53, 103, 12, 0, 59, 110, 25, 0, 50, 103, 28, 0, 60, 100, 45]
)
"""Joint angles in radians, shape (20,), of a hand closed around a stem."""


def rehearsed_scene() -> HeldScene:
    """A hand around a champagne flute, at rest; nothing is known of where the skin touches."""
    base_from_wrist = [[0, -1, 0, 0.65], [0, 0, -1, 0.03], [1, 0, 0, 0.27], [0, 0, 0, 1]]
    # the glass's axis passes the palm along the wrist's x, its stem 6.5 cm up beside the wrist
    wrist_from_glass = [[0, 0, 1, -0.065], [1, 0, 0, 0.0865], [0, 1, 0, 0.030], [0, 0, 0, 1]]
    wrist, glass = (np.array(p, dtype=np.float64) for p in (base_from_wrist, wrist_from_glass))
    angles = HOLDING_ANGLES.copy()
    hold = Hold("0004-rehearsal", "0004", "stem", HandShape(), angles, glass, {})
    return HeldScene(hold, wrist, np.asarray(SKIN_TONES[1]))


def rehearsed_grasp() -> Array:
    """A tool pose (4, 4), base frame, before the flute of `rehearsed_scene`, facing the human."""
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    pose[:3, 3] = rehearsed_scene().base_from_object[:3, 3] + [-0.033, 0, 0.17]
    return pose


def visible_points(scene: HeldScene, viewpoint: Array) -> Array:
    """What a perfect restoration would give: points (n, 3) of the glass's outside, base frame.

    They face a camera that stands at the viewpoint (3,) and are not in the hand; about one in a
    cube of 4 mm.
    """
    axis = scene.base_from_object
    surface = scene.glass()[0].moved(axis)
    points, normals = surface.vertices, surface.normals
    facing = ((viewpoint - points) * normals).sum(axis=1) > 0
    outside = ((points - axis[:3, 3]) @ axis[:3, :3])[:, :2]
    turned = normals @ axis[:3, :3]
    outward = (outside * turned[:, :2]).sum(axis=1) >= 0  # not the inner wall
    nearest = np.linalg.norm(points[:, None] - scene.keypoints[None], axis=2).min(axis=1)
    kept: Array = points[facing & outward & (nearest > 0.015)]
    _, first = np.unique(np.floor(kept / 0.004), axis=0, return_index=True)
    thinned: Array = kept[np.sort(first)]
    return thinned


@dataclass(frozen=True)
class MovingHand:
    """A hand that drifts and turns smoothly about where it started, seen by a camera.

    Attributes:
        scene: Hand and glass, as they were at time 0.
        base_from_camera: Where the camera stands, shape (4, 4), metres.
        seed: Chooses the movement.
        drift: Largest displacement along each axis, metres.
        turn: Largest rotation about each axis, radians.
        calm_after: The movement dies down over about this long, seconds: people who hand
            something over come to rest. Infinity keeps the hand moving.
        noise: Standard deviation of each keypoint coordinate, metres. Never quite 0 in a real
            hand; the workflow takes keypoints that stay bitwise the same for a camera that hangs.
    """

    scene: HeldScene
    base_from_camera: Array
    seed: int = 0
    drift: float = 0.04
    turn: float = float(np.deg2rad(12.0))
    calm_after: float = 2.0
    noise: float = 1e-5

    def moved(self, time: float) -> Array:
        """How hand and glass have moved since time 0: base_now_from_base_start, shape (4, 4)."""
        periods, signs = self._rhythm
        lasted = calmed(time, self.calm_after)
        swing = signs * np.sin(2 * np.pi * lasted / periods) * [[self.drift], [self.turn]]
        return turned_about(self.scene.base_from_wrist[:3, 3], *swing)

    @cached_property
    def _rhythm(self) -> tuple[Array, Array]:
        """Periods in seconds and signs of the six swings, each of shape (2, 3)."""
        rng = np.random.default_rng(self.seed)
        return rng.uniform(3.0, 6.0, size=(2, 3)), rng.choice([-1.0, 1.0], size=(2, 3))

    def observe(self, time: float) -> Observation:
        """What perception says at a time in seconds, in the camera frame."""
        camera_from_base = np.linalg.inv(self.base_from_camera) @ self.moved(time)
        keypoints = transform_points(camera_from_base, self.scene.keypoints)
        if self.noise > 0:
            rng = np.random.default_rng((self.seed, round(time * 1e6)))
            keypoints = keypoints + rng.normal(0.0, self.noise, keypoints.shape)
        return Observation(time, keypoints, transform_points(camera_from_base, self._seen))

    @cached_property
    def _seen(self) -> Array:
        """The side of the glass that the camera sees at time 0, base frame, shape (n, 3)."""
        return visible_points(self.scene, self.base_from_camera[:3, 3])


def width_between(base_from_tool: Array, base_from_glass: Array, glass: GlassObject) -> float:
    """How wide a glass is between the fingers, metres along the closing axis; 0: not there.

    The tool pose and that of the glass, (4, 4), are in the base frame, metres.
    """
    tool_from_glass = np.linalg.inv(base_from_tool) @ base_from_glass
    points = transform_points(tool_from_glass, bodies(glass)[0].vertices)
    inside = (np.abs(points[:, 1]) < FINGER_HEIGHT / 2) & (np.abs(points[:, 0]) < 0.06)
    inside &= (points[:, 2] < 0) & (points[:, 2] > -FINGER_LENGTH)
    return float(np.ptp(points[inside, 0])) if inside.any() else 0.0


@dataclass(frozen=True)
class Moment(WorldState):
    """One recorded step of a rehearsal: the state of its world, and what the workflow did.

    Tool pose (4, 4), points along the arm's links (9, 3) and keypoints (21, 3) are in the base
    frame; `to_target` is the tool's way to the pre-grasp, NaN before there is one; metres.
    """

    stage: Stage
    tool: Array
    outline: Array
    keypoints: Array
    to_target: float


def rehearse(
    handover: Handover,
    hand: MovingHand,
    *,
    dt: float = 1 / 30,
    longest: float = 30.0,
    past_stops: bool = False,
    picture_every: float = 0.0,
    spoil: Callable[[Observation], Observation] | None = None,
    moments: list[Moment] | None = None,
) -> list[Moment]:
    """Run the workflow against the moving hand until it finishes, stops or time is up.

    Once the fingers are closed and the arm pulls back, the hand lets go: the glass stays with
    the tool, as long as the fingers press. There is no contact and no force in this; it shows the
    logic, not the success. A protective stop is released as soon as a person may.

    Args:
        handover: The workflow over a `SimulatedUR5`; TypeError for another robot.
        hand: The moving hand.
        dt: Time between two observations, seconds.
        longest: Give up after this long, seconds.
        past_stops: Go on after a stop, until the workflow has finished or given up.
        picture_every: Time between two pictures, seconds, in whole steps; 0: one every step.
        spoil: What breaks between the camera and the workflow.
        moments: A list to append to, for who wants those before an exception, too.

    Returns:
        One moment a step, without forces. The gripper holds the object once that is no longer
        where the hand would have it.
    """
    robot = handover.robot
    if isinstance(robot, RecordedRobot):
        robot = robot.robot
    if not isinstance(robot, SimulatedUR5):
        raise TypeError(f"a rehearsal needs a SimulatedUR5, got {type(robot).__name__}")
    moments = [] if moments is None else moments
    tool_from_glass, gripped, unlocked = np.eye(4), False, 0.0
    newest = hand.observe(0.0)
    for step in range(round(longest / dt) + 1):
        time = step * dt
        moved = hand.moved(time)
        tool = robot.tool_pose()
        if not robot.protective_stop:
            unlocked = time
        elif time - unlocked >= UNLOCK_AFTER:  # a person has looked and released it
            robot.protective_stop = ""
        gripped = handover.part in _GRIPPED or (gripped and robot.finger_force() > 0)
        if not gripped:
            tool_from_glass = np.linalg.inv(tool) @ moved @ hand.scene.base_from_object
        glass = tool @ tool_from_glass
        robot.between_fingers = width_between(tool, glass, hand.scene.item)
        if time >= newest.time + picture_every - 1e-9:
            newest = hand.observe(time)
        seen = replace(newest, time=time, frame_time=newest.time)
        handover.step(seen if spoil is None else spoil(seen), dt)
        tool = robot.tool_pose()
        if handover.part in _GRIPPED:
            glass = tool @ tool_from_glass
        keypoints = transform_points(moved, hand.scene.keypoints)
        to_target = np.nan
        if handover.target is not None:
            to_target = pose_distance(tool, handover.target)[0]
        taken = not np.allclose(glass, moved @ hand.scene.base_from_object, atol=1e-6)
        moments.append(
            Moment(
                time=time,
                joints=robot.joint_positions(),
                gripper_width=robot.gripper_width(),
                base_from_wrist=moved @ hand.scene.base_from_wrist,
                base_from_object=glass,
                holder="gripper" if taken else "hand",
                hand_force=0.0,
                hand_distance=max(0.0, hand_distance(tool, robot.gripper_width(), keypoints)),
                stage=handover.stage,
                tool=tool,
                outline=robot.outline(),
                keypoints=keypoints,
                to_target=to_target,
            )
        )
        halted = handover.stage in (Stage.STOPPED, Stage.GOING_HOME)
        if handover.over or (halted and not past_stops):
            break
    return moments
