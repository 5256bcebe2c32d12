"""After a stop: the arm leaves a hand that it is pressed against, and one that stays too near."""

import re
from dataclasses import replace

import numpy as np
import pytest

from hadr.camera import transform_points
from hadr.handover import ur5
from hadr.handover.grasping.collision import hand_distance
from hadr.handover.guarded_arm import GuardedArm, HaltError
from hadr.handover.observation import HandWatch, Observation
from hadr.handover.recovery import Recovery
from hadr.handover.robot import UNLOCK_AFTER
from hadr.handover.safety import GRASP_DISTANCE
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import ARRIVE_DISTANCE, BACK_OFF, ChosenGrasp, HandoverConfig, Stage
from hadr.handover.workflow import Handover
from hadr.simulation.trials.rehearsal import rehearsed_scene

DT = 0.02
CONFIG = HandoverConfig()
FAR_HAND = rehearsed_scene().keypoints + np.array([0.5, 0.0, 0.3])


class PressedUR5(SimulatedUR5):
    """Feels a hand until it is 15 mm away from where it was pressed, as the physical arm does.

    A person releases it after 5 s; in a protective stop the fingers take no command.
    """

    def __init__(self) -> None:
        super().__init__()
        self.pressed_at = self.tool_pose()[:3, 3]
        self.time, self.halted, self.stops, self.stuck = 0.0, -9.0, 0, False

    def feel(self) -> None:
        self.time += DT
        pressed = float(np.linalg.norm(self.tool_pose()[:3, 3] - self.pressed_at)) < 0.015
        if self.protective_stop and self.time > self.halted + UNLOCK_AFTER:
            self.protective_stop = ""
        elif pressed and self.time > self.halted + UNLOCK_AFTER + 3.0:  # the hand yields meanwhile
            self.protective_stop, self.halted = "10 N on the arm", self.time
            self.stops += 1

    def set_gripper(self, width: float, force: float) -> None:
        if not self.protective_stop and not self.stuck:
            super().set_gripper(width, force)


class Watched:
    """An arm beside a hand in pictures ten times a second, never twice the same."""

    def __init__(self, robot: SimulatedUR5, hand: np.ndarray = FAR_HAND) -> None:
        self.arm = GuardedArm(robot, CONFIG, HandWatch(np.eye(4)))
        self.hand, self.steps = hand, 0

    def put(self, free: float, direction: np.ndarray) -> None:
        """Bring the hand so near that its skin is so far from the robot, to one side of it.

        In front its forearm points away; behind the wrist a child's hand reaches down from above.
        """
        beside = GuardedArm(self.arm.robot, CONFIG, HandWatch(np.eye(4)))
        hand = FAR_HAND - FAR_HAND.mean(axis=0)  # its forearm points along +x
        if direction[0] > 0:
            hand, high = hand + beside.reading.tool[:3, 3], 0.5
        else:
            hand = 0.45 * hand @ [[0, 0, 1], [0, 1, 0], [1, 0, 0]]
            hand += ur5.link_surfaces(beside.reading.joints)[6, 3:6] + [0, 0, 0.08]
            high = 0.15
        low = 0.0
        for _ in range(18):  # to 2 micrometres
            middle = (low + high) / 2
            beside.watch.keypoints = hand + middle * direction
            low, high = (low, middle) if beside.free() > free else (middle, high)
        self.hand = hand + high * direction

    def seen(self) -> Observation:
        taken = 0.1 * (self.steps // 5)
        return Observation(self.steps * DT, self.hand + 1e-6 * (self.steps // 5), frame_time=taken)

    def look(self) -> float:
        now = self.steps * DT
        self.arm.watch.look(self.seen(), now)
        self.arm.read()
        self.steps += 1
        return now


def recover(robot: PressedUR5, *, seconds: float) -> tuple[Recovery, float]:
    """From a stop with a protective stop on; the time at which it may go on, or infinity."""
    watched = Watched(robot)
    recovery = Recovery(watched.arm)
    recovery.begin(0.0, back=BACK_OFF, opening=0.085, straight=True)
    for _ in range(round(seconds / DT)):
        robot.feel()
        now = watched.look()
        if watched.arm.reading.protective_stop and recovery.part != "still":
            recovery.begin(now, back=BACK_OFF, opening=0.085, straight=True)
        if recovery.step(now, DT):
            return recovery, now
    return recovery, float("inf")


@pytest.mark.parametrize("stuck", [False, True], ids=["fingers open", "fingers stuck"])
def test_a_pressed_arm_backs_off_after_one_stop(stuck: bool) -> None:
    robot = PressedUR5()
    robot.set_gripper(0.02, 7.0)
    robot._opening = robot._target_opening = 0.02
    robot.stuck = stuck
    start = robot.tool_pose()
    robot.feel()
    assert robot.protective_stop
    recovery, restarted = recover(robot, seconds=12.0)
    assert robot.stops == 1
    # stand 5 s, open 0.65 s at 0.1 m/s (stuck: 1.5 s), back 0.8 s, stand 0.5 s
    assert restarted == pytest.approx(5.0 + (1.5 if stuck else 0.65) + 1.3, abs=0.2)
    moved = start[:3, :3].T @ (robot.tool_pose()[:3, 3] - start[:3, 3])
    np.testing.assert_allclose(moved, [0, 0, -BACK_OFF], atol=0.003)
    assert recovery.trouble == ""
    assert robot.gripper_width() == pytest.approx(0.02 if stuck else 0.085, abs=1e-6)


class HoldingUR5(SimulatedUR5):
    """Its gripper alone holds a glass 5 cm thick; `dead` fingers say no number."""

    def __init__(self) -> None:
        super().__init__()
        self.between_fingers = self._opening = 0.05
        self.set_gripper(0.0, 22.0)
        self.dead = False

    def gripper_width(self) -> float:
        return float("nan") if self.dead else super().gripper_width()

    def finger_force(self) -> float:
        return float("nan") if self.dead else super().finger_force()


def holding(watched: Watched, *, seconds: float, alone: bool = True) -> float:
    """The fingers' width so long after a stop while they hold, metres."""
    robot = watched.arm.robot
    watched.arm.alone, watched.arm.closed = alone, True
    recovery = Recovery(watched.arm)
    recovery.begin(watched.look(), back=BACK_OFF, opening=0.085, straight=False)
    for _ in range(round(seconds / DT)):
        recovery.step(watched.look(), DT)
    return SimulatedUR5.gripper_width(robot)


@pytest.mark.parametrize(("there", "opens"), [("gripper", True), ("forearm", False)])
def test_only_a_hand_at_the_gripper_takes_what_it_holds(there: str, opens: bool) -> None:
    robot = HoldingUR5()
    watched = Watched(robot)
    hand = FAR_HAND - FAR_HAND.mean(axis=0)
    forearm = ur5.link_surfaces(robot.joint_positions())[3]
    at = robot.tool_pose()[:3, 3] if there == "gripper" else forearm[:3]
    away = np.array([1.0, 0, 0]) if there == "gripper" else np.array([-0.4, -0.9, 0.3])
    for distance in np.linspace(0.0, 0.5, 200):
        watched.arm.watch.keypoints = watched.hand = hand + at + distance * away
        if watched.arm.free() > 0.03:
            break
    assert watched.arm.free() < 0.05  # beside the robot, whichever part
    robot.wrench = np.array([0, 5.0, 0, 0, 0, 0])
    assert (holding(watched, seconds=2.0) > 0.08) is opens


@pytest.mark.parametrize(("aside", "opens"), [(0.0, True), (0.12, False)])
def test_a_finger_that_stays_between_the_pads_is_set_free(aside: float, opens: bool) -> None:
    """Nobody pulls; a hand beside the gripper is no reason to open."""
    watched = Watched(HoldingUR5())
    tool = watched.arm.robot.tool_pose()
    watched.hand = FAR_HAND - FAR_HAND[8] + tool[:3, 3] - 0.01 * tool[:3, 2] + aside * tool[:3, 0]
    assert (holding(watched, seconds=2.0) > 0.08) is opens


@pytest.mark.parametrize("alone", [True, False], ids=["alone", "with the hand"])
@pytest.mark.parametrize("camera", ["sees none", "stands"])
def test_fingers_around_a_glass_do_not_open_for_a_pull_where_no_hand_is_seen(
    alone: bool, camera: str
) -> None:
    robot = HoldingUR5()
    watched = Watched(robot)
    watched.hand = FAR_HAND - FAR_HAND.mean(axis=0) + robot.tool_pose()[:3, 3]
    for _ in range(21):
        watched.look()
    if camera == "sees none":
        hide(watched)
    else:
        last, shown = watched.seen(), watched.seen
        watched.seen = lambda: replace(last, time=shown().time)  # type: ignore[method-assign]
    robot.wrench = np.array([0, 5.0, 0, 0, 0, 0])
    assert holding(watched, seconds=2.0, alone=alone) == pytest.approx(0.05)


@pytest.mark.parametrize("held", ["hand", "stuck fingers"])
def test_fingers_that_do_not_open_keep_hand_and_glass_where_they_are(
    held: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Around a glass that a hand pulls at; free ones give it and go."""
    robot = HoldingUR5()
    if held == "stuck fingers":
        monkeypatch.setattr(robot, "_move_fingers", lambda dt: None)
    watched = Watched(robot)
    start = robot.tool_pose()
    watched.put(0.01, start[:3, 2])
    # until the fingers have given it
    robot.tool_wrench = lambda: (  # type: ignore[method-assign]
        np.array([0, 6.0 * (robot.gripper_width() < 0.06), 0, 0, 0, 0])
    )
    arm, told = watched.arm, []
    command = robot.set_gripper
    monkeypatch.setattr(robot, "set_gripper", lambda *words: (told.append(words), command(*words)))
    arm.closed = True
    recovery = Recovery(arm)
    recovery.begin(watched.look(), back=BACK_OFF, opening=0.085, straight=True)
    stop = ""
    for _ in range(200):
        try:
            recovery.step(watched.look(), DT)
        except HaltError as halt:
            stop = str(halt)
            break
    way = np.linalg.norm(robot.tool_pose()[:3, 3] - start[:3, 3])
    if held == "hand":
        assert not arm.around_something
        assert (stop, way) == ("", pytest.approx(BACK_OFF, abs=0.003))
        assert told == [(0.085, 7.0)]
    else:
        assert arm.around_something  # so that nothing takes them for free
        assert (stop, way) == ("the fingers do not open", pytest.approx(0.0, abs=1e-6))
        assert told == [(0.085, 7.0), (0.0, 7.0)]


def backing(watched: Watched, recovery: Recovery, seconds: float) -> list[tuple[str, str, float]]:
    """Part, trouble and the way so far along the approach, metres, in every step."""
    robot, heard = watched.arm.robot, []
    start = robot.tool_pose()
    for _ in range(round(seconds / DT)):
        again = recovery.step(watched.look(), DT)
        way = float((start - robot.tool_pose())[:3, 3] @ start[:3, 2])
        heard.append(("again" if again else recovery.part, recovery.trouble, way))
    return heard


@pytest.mark.parametrize("straight", [True, False])
def test_what_holds_the_gripper_back_is_not_dragged(straight: bool) -> None:
    """A mug hangs at a finger, its hand pulls by 250 N/m; at 5 s it is set free."""
    robot = SimulatedUR5()
    watched = Watched(robot)
    approach, place = robot.tool_pose()[:3, 2], robot.tool_pose()
    if not straight:  # it came along the same line
        place[:3, 3] -= 0.1 * approach
        for _ in range(100):
            robot.servo_to(place, DT)
            watched.look()
        place = robot.tool_pose()
        place[:3, 3] += 0.1 * approach
        for _ in range(100):
            robot.servo_to(place, DT)
            watched.look()
    start = robot.tool_pose()
    free = False

    def hang() -> np.ndarray:
        way = (start - robot.tool_pose())[:3, 3]
        return np.concatenate([np.zeros(3) if free else 250.0 * way, np.zeros(3)])

    robot.tool_wrench = hang  # type: ignore[method-assign]
    recovery = Recovery(watched.arm)
    recovery.begin(watched.look(), back=BACK_OFF, opening=0.085, straight=straight)
    heard = backing(watched, recovery, 5.0)
    assert max(way for *_, way in heard) < 0.02  # 3 N are 12 mm
    assert heard[-1][0] == "clear"  # where patience ends
    assert re.fullmatch(r"something holds the gripper back with [34]\.\d N", heard[-1][1])
    assert "again" not in {part for part, *_ in heard}
    free = True
    assert backing(watched, recovery, 1.0)[-1][:2] == ("again", "")


def test_going_home_it_drags_nothing_either() -> None:
    robot = SimulatedUR5()
    handover = Handover(robot, lambda *_: None, np.eye(4), HandoverConfig(patience=0.1))
    away = robot.tool_pose()
    away[:3, 3] -= 0.1 * away[:3, 2]
    for _ in range(100):
        robot.servo_to(away, DT)
    start, watched = robot.tool_pose(), Watched(robot)
    robot.tool_wrench = (
        lambda: np.append(  # type: ignore[method-assign]
            250.0 * (start - robot.tool_pose())[:3, 3], np.zeros(3)
        )
    )
    while not handover.over:
        watched.look()
        handover.step(watched.seen(), DT)
    assert np.linalg.norm((robot.tool_pose() - start)[:3, 3]) < 0.02
    assert "home not reached" in handover.transitions[-1].reason


def hide(watched: Watched) -> None:
    """Let the pictures show no hand from now on."""
    shown = watched.seen
    watched.seen = lambda: replace(shown(), keypoints=None)  # type: ignore[method-assign]


def test_fingers_that_say_no_number_do_not_drop_what_they_hold() -> None:
    robot = HoldingUR5()
    watched = Watched(robot)
    hide(watched)
    robot.dead = True
    assert holding(watched, seconds=2.0) == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("gap", "opens", "seen"),
    [(0.010, False, True), (0.010, False, False), (0.060, True, True), (0.060, True, False)],
)
def test_empty_fingers_do_not_open_into_a_hand_beside_them(
    gap: float, opens: bool, seen: bool
) -> None:
    robot = SimulatedUR5()
    robot._opening = robot._target_opening = 0.005
    watched = Watched(robot)
    tool, hand = robot.tool_pose(), FAR_HAND - FAR_HAND.mean(axis=0)
    for distance in np.linspace(0.0, 0.5, 1000):
        watched.hand = hand + tool[:3, 3] + distance * tool[:3, 0]
        if hand_distance(tool, 0.005, watched.hand) > gap:
            break
    recovery = Recovery(watched.arm)
    recovery.begin(watched.look(), back=BACK_OFF, opening=0.085, straight=True)
    if not seen:
        hide(watched)
    least = np.inf
    for _ in range(80):
        now = watched.look()
        least = min(least, watched.arm.free(hand=watched.hand))
        recovery.step(now, DT)
    assert least > 0
    assert (robot.gripper_width() > 0.08) is opens


def test_the_way_home_leaves_room_to_a_hand_that_it_passes() -> None:
    robot = SimulatedUR5()
    home = robot.tool_pose()
    away = home.copy()
    away[:3, 3] -= 0.1 * home[:3, 2]
    for _ in range(120):
        robot.servo_to(away, DT)
    watched = Watched(robot)
    arm = watched.arm
    arm.home = home
    watched.put(0.06, home[:3, 2])
    hand = watched.hand
    for distance in np.linspace(0, 0.2, 400):
        watched.hand = hand + distance * home[:3, 2]
        if arm.free(home, hand=watched.hand) > 0.001:
            break
    way = (arm.homeward(watched.look(), DT) for _ in range(600))
    with pytest.raises(HaltError, match="at least 5 mm are needed"):
        any(way)
    assert arm.free(hand=watched.hand) > GRASP_DISTANCE


def test_without_contact_it_waits_for_the_fingers() -> None:
    robot = SimulatedUR5()
    robot._opening = robot._target_opening = 0.02
    start = robot.tool_pose()[:3, 3]
    watched = Watched(robot)
    recovery = Recovery(watched.arm)
    recovery.begin(0.0, back=BACK_OFF, opening=0.085, straight=True)
    while recovery.part != "back":
        now = watched.look()
        recovery.step(now, DT)
        assert np.linalg.norm(robot.tool_pose()[:3, 3] - start) < 1e-9
        assert now < 3.0
    assert robot.gripper_width() > 0.083


@pytest.mark.parametrize("follows", [False, True], ids=["hand stays", "hand follows"])
def test_it_leaves_a_hand_that_is_too_near(follows: bool) -> None:
    watched = Watched(SimulatedUR5())
    arm, start = watched.arm, watched.arm.reading.tool
    approach = start[:3, 2]
    watched.put(0.004, approach)
    recovery = Recovery(watched.arm)
    recovery.begin(0.0, back=0.0, opening=None, straight=True)
    frees, ways = [], []
    restarted = np.inf
    for step in range(round(10.0 / DT)):
        if follows and recovery.part == "clear":
            watched.put(0.004, approach)
        now = watched.look()
        frees.append(arm.free())
        ways.append(float((start[:3, 3] - arm.reading.tool[:3, 3]) @ approach))
        if recovery.step(now, DT):
            restarted = step * DT
            break
    assert min(frees) > 0.003
    assert max(ways[: round(1.45 / DT)]) < 1e-9  # stands 0.5 s, and 1 s beside the hand
    if follows:  # three times, then it waits
        assert ways[-1] == pytest.approx(3 * BACK_OFF, abs=0.01)
        assert restarted == np.inf
    else:  # 0.5 s, 1 s, 8 cm at 0.1 m/s, 0.5 s
        assert ways[-1] == pytest.approx(BACK_OFF, abs=0.003)
        assert restarted == pytest.approx(2.8, abs=0.15)


@pytest.mark.parametrize("back", [0.0, BACK_OFF], ids=["from a hand that stays", "after a stop"])
def test_it_does_not_back_into_a_hand_behind_it(back: float) -> None:
    robot = SimulatedUR5()
    watched = Watched(robot)
    start = robot.tool_pose()
    watched.put(0.008, -start[:3, 2])
    recovery = Recovery(watched.arm)
    recovery.begin(0.0, back=back, opening=None, straight=True)
    for _ in range(150):
        now = watched.look()
        assert not recovery.step(now, DT)
    assert np.linalg.norm(robot.tool_pose()[:3, 3] - start[:3, 3]) < 1e-9
    assert recovery.trouble == "hand 8 mm from the gripper"


def with_a_hand_in_front(metres: float) -> tuple[GuardedArm, float, np.ndarray, np.ndarray]:
    """An arm that sees a hand, the time, and tool poses (4, 4) 5 cm off that hand and toward it."""
    watched = Watched(SimulatedUR5())
    tool = watched.arm.reading.tool
    watched.put(metres, tool[:3, 2])
    off, into = tool.copy(), tool.copy()
    off[:3, 3] -= 0.05 * tool[:3, 2]
    into[:3, 3] += 0.05 * tool[:3, 2]
    return watched.arm, watched.look(), off, into


def test_a_way_back_toward_a_hand_is_as_slow_as_a_way_in() -> None:
    arm, now, off, into = with_a_hand_in_front(0.066)
    assert arm.leaving(*arm.ahead(off), speed=0.25, now=now) == 1.0
    toward = arm.leaving(*arm.ahead(into), speed=0.25, now=now)
    assert toward == arm.allowed(arm.ahead(into), GRASP_DISTANCE, 0.25) < 0.8


def test_a_way_off_the_hand_remembers_where_it_was_last_seen() -> None:
    arm, now, off, into = with_a_hand_in_front(0.008)
    assert arm.leaving(*arm.ahead(off), speed=0.1, now=now) == 1.0
    arm.watch.keypoints, arm.watch.problem = None, "no hand in the picture"
    assert arm.leaving(*arm.ahead(off), speed=0.1, now=now) == 0.5
    with pytest.raises(HaltError, match=r"the hand was last seen -\d+ mm from the gripper's path"):
        arm.leaving(*arm.ahead(into), speed=0.1, now=now)


def test_no_part_of_a_hand_gets_deeper_because_another_comes_free() -> None:
    """A thumb is deep in the palm, the way back brings a fingertip from behind into it."""
    watched = Watched(SimulatedUR5())
    arm, tool = watched.arm, watched.arm.reading.tool
    in_tool = np.tile([0.0, 0.0, -0.065], (21, 1)) + 1e-4 * np.arange(21)[:, None] * [0.0, 1.0, 0.0]
    back = tool @ np.block([[np.eye(3), np.array([[0.0], [0.0], [-0.05]])], [0, 0, 0, 1]])
    arm.watch.last = arm.watch.keypoints = transform_points(tool, in_tool)
    assert arm.free(back) > arm.free()
    assert not arm.nearer(back)
    in_tool[8] = [0.065, 0.0, -0.12]  # beside the palm, where the bar's ends pass
    arm.watch.last = arm.watch.keypoints = transform_points(tool, in_tool)
    assert arm.free(back) > arm.free()
    assert arm.nearer(back)


@pytest.mark.parametrize(("side", "leaves"), [(1.0, True), (-1.0, False)])
def test_the_way_home_begins_beside_a_hand_that_touches(side: float, leaves: bool) -> None:
    """It goes where the hand is not, and stays where the hand is in its way."""
    robot = SimulatedUR5()
    home = robot.tool_pose()

    def nothing(*_: object) -> ChosenGrasp | None:
        return None

    handover = Handover(robot, nothing, np.eye(4), HandoverConfig(patience=0.1))
    away = home.copy()
    away[:3, 3] -= 0.1 * home[:3, 2]
    for _ in range(100):
        robot.servo_to(away, DT)
    watched = Watched(robot)
    arm = watched.arm
    assert np.linalg.norm(arm.reading.tool[:3, 3] - away[:3, 3]) < 1e-3
    # home lies ahead: a hand behind the gripper is left, one before it is not run into
    watched.put(-0.002, -side * home[:3, 2])
    frees = []
    for _ in range(round(8.0 / DT)):
        watched.look()
        handover.step(watched.seen(), DT)
        arm.read()
        frees.append(arm.free())
        if handover.over:
            break
    assert handover.stage is Stage.GAVE_UP
    assert min(frees) > -0.007
    last = handover.transitions[-1].reason
    if leaves:
        assert last == "at home without the object"
        assert np.linalg.norm(robot.tool_pose()[:3, 3] - home[:3, 3]) < ARRIVE_DISTANCE
    else:
        assert last.startswith("stands where it is: hand ")
        assert np.linalg.norm(robot.tool_pose()[:3, 3] - away[:3, 3]) < 0.01
