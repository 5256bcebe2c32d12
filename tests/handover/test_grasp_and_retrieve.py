"""The final move: how far it goes, and what it does when it feels something."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from types import SimpleNamespace

import numpy as np
import pytest

from hadr.handover.grasp_and_retrieve import BLOCKED_TIME, DRAW_BACK, Advance, Retrieval
from hadr.handover.grasping.grasps import forward_of
from hadr.handover.grasping.gripper import LARGEST_OPENING
from hadr.handover.guarded_arm import GuardedArm, HaltError
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import PULL_TIME, HandoverConfig

DT = 0.02
PLAIN = HandoverConfig()
FEELING = replace(PLAIN, feel_ahead=0.04, feel_aside=0.02, contact_force=2.0)
WAY = PLAIN.back + PLAIN.forward


@pytest.fixture(autouse=True)
def _close_to_the_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fingers close where they were sent, within 2 mm."""
    monkeypatch.setattr("hadr.handover.stages.ARRIVE_DISTANCE", 0.002)


class Touching(SimulatedUR5):
    """A kinematic arm whose gripper meets a block in front of the starting pose.

    Attributes:
        block: Lower and upper end along the closing axis, and the near face along the approach,
            metres from the pre-grasp; None is nothing.
        other: A second block.
        stiffness: N/m.
    """

    block: tuple[float, float, float] | None = None
    other: tuple[float, float, float] | None = None
    palm: float | None = None
    stiffness = 2000.0

    def tool_wrench(self) -> np.ndarray:
        tool = self.tool_pose()
        local = np.linalg.inv(self.start) @ tool
        x, z = local[0, 3], local[2, 3]
        pushes = []  # place along the closing axis, force against the approach
        for low, high, face in filter(None, (self.block, self.other)):
            for finger in (-0.0475, 0.0475):
                if low < x + finger < high and z > face:
                    pushes.append((finger, self.stiffness * (z - face)))
        if self.palm is not None and z > self.palm:
            pushes.append((0.0, self.stiffness * (z - self.palm)))
        force = sum((-f * tool[:3, 2] for _, f in pushes), np.zeros(3))
        torque = sum(
            (np.cross(at * tool[:3, 0], -f * tool[:3, 2]) for at, f in pushes), np.zeros(3)
        )
        return np.concatenate([force, torque])


def advancing(config: HandoverConfig, **block: object) -> tuple[Touching, Advance, np.ndarray]:
    robot = Touching()
    robot.start = robot.tool_pose()
    for name, value in block.items():
        setattr(robot, name, value)
    away = robot.start[:3, 3] + [0.0, 0.6, 0.3] + np.zeros((21, 3))
    away += 0.01 * np.arange(63).reshape(21, 3) / 63
    watch = SimpleNamespace(
        keypoints=away,
        last=away,
        problem="",
        age=0.1,
        middle=away.mean(axis=0),
    )
    watch.soon = lambda ahead: watch.keypoints  # it rests
    watch.trouble = lambda now: watch.problem
    advance = Advance(GuardedArm(robot, config, watch))
    advance.begin()
    return robot, advance, robot.start


def put_hand(advance: Advance, spot: np.ndarray, aside: np.ndarray) -> None:
    """Put a hand of 2 mm to a spot, whose forearm goes off along a unit vector."""
    watch = advance.arm.watch
    watch.keypoints = watch.last = spot - 1e-4 * np.arange(21)[:, None] * aside
    watch.middle = spot


def step(advance: Advance, start: np.ndarray) -> np.ndarray | None:
    advance.arm.read()
    return advance.step(start, DT)


def final_move(advance: Advance, start: np.ndarray) -> tuple[np.ndarray, list[tuple[str, str]]]:
    """Where the fingers close, seen from the pre-grasp; parts and words up to there, each once."""
    heard = [(advance.part, advance.words)]
    for _ in range(600):
        pose = step(advance, start)
        if heard[-1] != (advance.part, advance.words):
            heard.append((advance.part, advance.words))
        if pose is not None:
            return np.linalg.inv(start) @ pose, heard
    raise AssertionError("the final move does not end")


def draw_back(robot: Touching, advance: Advance, start: np.ndarray) -> np.ndarray:
    """Go on until the gripper draws back; the tool pose there."""
    while advance.part != "draw back":
        step(advance, start)
    return robot.tool_pose()


def test_without_feeling_it_ends_where_the_paper_says() -> None:
    _, advance, start = advancing(PLAIN, palm=0.05)  # what it meets, it does not feel
    end, heard = final_move(advance, start)
    np.testing.assert_allclose(end[:3, 3], [0, 0, WAY], atol=1e-9)
    assert heard == [("advance", "")]


def test_it_goes_on_until_the_palm_is_met_and_says_so() -> None:
    _, advance, start = advancing(FEELING, palm=WAY + 0.022)
    end, heard = final_move(advance, start)
    assert abs(end[2, 3] - WAY - 0.022) < 0.004
    assert heard == [
        ("advance", ""),
        ("feel", "goes on, feeling for the object"),
        ("feel", "the palm met the object: closes here"),
    ]
    assert advance.all_corrections == 0


def test_it_draws_back_before_it_goes_aside() -> None:
    robot, advance, start = advancing(FEELING, block=(0.030, 0.062, 0.11))
    ways, pose = [], None
    while pose is None:
        ways.append((np.linalg.inv(start) @ robot.tool_pose())[[0, 2], 3])
        pose = step(advance, start)
    x, z = np.array(ways).T
    first_aside = int(np.argmax(x > 0.002))
    deepest = z[:first_aside].max()
    drawn = deepest - z[first_aside]
    assert 0.11 < deepest < 0.118  # it did not push through
    assert drawn > DRAW_BACK - 0.012


@pytest.mark.parametrize("side", [-1, 1])
def test_a_finger_on_the_object_sends_the_gripper_to_that_side(side: int) -> None:
    """A block from 0.03 m on one side: free once the gripper has gone 0.02 m towards it."""
    robot, advance, start = advancing(FEELING, block=(*sorted((side * 0.030, side * 0.062)), 0.11))
    end, heard = final_move(advance, start)
    assert end[0, 3] == pytest.approx(side * FEELING.feel_aside, abs=1e-3)
    assert end[2, 3] > WAY
    # left of the line from the base to the tool, seen from above
    left = np.cross([0, 0, 1], [*start[:2, 3], 0.0])
    where = "left" if side * start[:3, 0] @ left > 0 else "right"
    assert [part for part, _ in heard[:3]] == ["advance", "draw back", "advance"]
    assert [heard[0][1], heard[2][1]] == ["", ""]
    assert re.fullmatch(  # the finger's middle lies 47.5 mm beside the tool's
        rf"a finger met the object 4[78] mm to the {where}: "
        r"draws back, goes 20 mm aside \(1 of 3\)",
        heard[1][1],
    )
    assert advance.corrections == 1
    robot.block = None
    advance.begin()
    assert (advance.corrections, advance.all_corrections) == (0, 1)
    assert final_move(advance, start)[1][0] == ("advance", "")


def test_left_right_up_and_outward_are_seen_from_the_base() -> None:
    advance = advancing(FEELING)[1]
    tool = np.eye(4)
    tool[:3, 3] = [0.0, 0.5, 0.3]
    words = []
    for closing in ([-1, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, -1], [0, 1, 0], [0, -1, 0]):
        tool[:3, 0] = closing
        advance.arm.reading = advance.arm.reading._replace(tool=tool)
        words.append(advance._contact(0.04).removeprefix("a finger met the object 40 mm "))
    assert words == ["to the left", "to the right", "up", "down", "outward", "inward"]
    assert advance._contact(-0.04).endswith("outward")


@pytest.mark.parametrize(
    "wrench", [np.full(6, np.nan), np.array([0, 0, 0, np.inf, 0, 0]), np.zeros(3), None]
)
def test_a_sensor_without_a_number_stops_it_and_it_goes_back(wrench: object) -> None:
    robot, advance, start = advancing(FEELING)
    robot.tool_wrench = lambda: wrench
    with pytest.raises(HaltError, match="the sensor at the wrist gives no number") as halt:
        final_move(advance, start)
    assert halt.value.back
    robot, advance, start = advancing(PLAIN)  # who does not feel, does not ask
    robot.tool_wrench = lambda: wrench
    final_move(advance, start)


def test_corrections_end() -> None:
    """A wall on one side that no correction passes: after the last it closes or says so."""
    few = replace(FEELING, corrections=2)
    _, advance, start = advancing(few, block=(0.0, 0.5, 0.145))
    final_move(advance, start)
    assert advance.corrections == 2


def test_an_object_wider_than_the_opening_stops_it() -> None:
    _, advance, start = advancing(FEELING, block=(-0.2, 0.2, 0.10))
    with pytest.raises(HaltError, match=r"met the object \d+ mm before the end .* does not fit"):
        final_move(advance, start)


def test_a_gripper_that_would_leave_its_reach_does_not_go_on() -> None:
    robot, advance, start = advancing(FEELING)
    robot.reachable = lambda pose: False
    end = final_move(advance, start)[0]
    assert end[2, 3] == pytest.approx(WAY, abs=2e-3)


@pytest.mark.parametrize(("free", "goes"), [(0.0, 0.0), (0.02, 0.02), (np.inf, 0.04)])
def test_it_feels_only_as_far_as_the_way_was_found_free(free: float, goes: float) -> None:
    _, advance, start = advancing(FEELING)
    advance.begin(free)
    end = final_move(advance, start)[0]
    assert end[2, 3] == pytest.approx(WAY + goes, abs=0.003)


def test_beside_the_hand_it_does_not_go_on() -> None:
    """The hand stands where the fingers would come only by feeling ahead."""
    _, advance, start = advancing(FEELING)
    ahead = forward_of(start, WAY + 0.045)
    put_hand(advance, ahead[:3, 3] + 0.0475 * ahead[:3, 0], ahead[:3, 2])
    end = final_move(advance, start)[0]
    way = end[2, 3] - WAY
    assert 0.009 < way < 0.021  # 2 cm of flesh and 5 mm to spare leave 2 cm


@pytest.mark.parametrize("leaves", [True, False])
def test_a_hand_farther_on_its_way_is_waited_for_and_then_halts_it(leaves: bool) -> None:
    robot, advance, start = advancing(PLAIN)
    away = advance.arm.watch.keypoints
    end = forward_of(start, WAY)
    put_hand(advance, end[:3, 3] + 0.0475 * end[:3, 0], end[:3, 2])
    for _ in range(round(BLOCKED_TIME / DT)):
        assert step(advance, start) is None
        assert "waits: hand" in advance.arm.caution
    assert advance.travelled == 0
    assert np.linalg.norm(robot.tool_pose()[:3, 3] - start[:3, 3]) < 1e-6
    if leaves:
        advance.arm.watch.keypoints = away
        advance.arm.watch.middle = away.mean(axis=0)
        assert final_move(advance, start)[0][2, 3] == pytest.approx(0.15, abs=2e-3)
    else:
        with pytest.raises(HaltError, match=r"hand .* mm from the gripper's path"):
            step(advance, start)


def test_where_the_side_changes_it_goes_half_as_far() -> None:
    """Free only between 5 and 15 mm to the right; 20 mm, the first step, is too far."""
    robot, advance, start = advancing(
        FEELING, block=(0.030, 0.0525, 0.11), other=(-0.0325, -0.020, 0.11)
    )
    heard = final_move(advance, start)[1]
    steps = [word for part, word in heard if part == "draw back"]
    assert ["20 mm aside" in steps[0], "10 mm aside" in steps[1], len(steps)] == [True, True, 2]
    x = (np.linalg.inv(start) @ robot.tool_pose())[0, 3]
    assert x == pytest.approx(0.010, abs=1e-3)


def test_between_two_obstacles_that_leave_no_room_it_stops() -> None:
    _, advance, start = advancing(FEELING, block=(0.030, 0.060, 0.10), other=(-0.040, -0.020, 0.10))
    with pytest.raises(HaltError, match="does not fit between the fingers"):
        final_move(advance, start)
    assert advance.corrections == 2  # 20 mm to one side, 10 mm back; 5 mm is not tried


@pytest.mark.parametrize("when", ["on the way", "at the end", "drawing back"])
def test_while_no_hand_is_known_it_stands(when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, advance, start = advancing(FEELING, block=(0.030, 0.062, 0.11))
    if when == "at the end":
        robot.block = None
        advance.arm.config = PLAIN
        # so that it does not end yet
        monkeypatch.setattr("hadr.handover.stages.ARRIVE_DISTANCE", 0.0)
    reached = {
        "on the way": lambda: advance.travelled > 0.05,
        "at the end": lambda: advance.travelled >= WAY,
        "drawing back": lambda: advance.part == "draw back",
    }
    while not reached[when]():
        assert step(advance, start) is None
    monkeypatch.setattr("hadr.handover.stages.ARRIVE_DISTANCE", 0.05)
    advance.arm.watch.keypoints, advance.arm.watch.problem = None, "no hand in the picture"
    held, way = robot.tool_pose(), advance.travelled
    for _ in range(20):
        assert step(advance, start) is None
        assert advance.arm.caution == "no hand in the picture"
    assert advance.travelled == way
    assert np.linalg.norm(robot.tool_pose()[:3, 3] - held[:3, 3]) < 2e-3


def test_a_hand_behind_the_gripper_stops_the_drawing_back() -> None:
    robot, advance, start = advancing(FEELING, block=(0.030, 0.062, 0.11))
    tool = draw_back(robot, advance, start)
    spot = tool[:3, 3] + 0.052 * tool[:3, 0] - 0.095 * tool[:3, 2]  # 15 mm behind the bar
    put_hand(advance, spot, tool[:3, 0])
    with pytest.raises(HaltError, match=r"hand .* mm from the gripper's path"):
        step(advance, start)
    assert np.linalg.norm(robot.tool_pose()[:3, 3] - tool[:3, 3]) < 2e-3


def test_a_hand_in_front_lets_it_draw_back() -> None:
    """Nearer to the hand than it may go on, but on the way away from it."""
    robot, advance, start = advancing(FEELING, block=(0.030, 0.062, 0.11))
    tool = draw_back(robot, advance, start)
    put_hand(advance, tool[:3, 3] + 0.0475 * tool[:3, 0] + 0.016 * tool[:3, 2], tool[:3, 2])
    for _ in range(12):
        step(advance, start)
    assert (tool[:3, 3] - robot.tool_pose()[:3, 3]) @ tool[:3, 2] > 0.005


@pytest.mark.parametrize("moved", [0.0, 0.03])
def test_the_tool_is_no_faster_than_the_hand_beside_it_allows(
    moved: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the pre-grasp has moved with the hand, and the tool has to catch up."""
    robot, advance, start = advancing(PLAIN)
    side = start[:3, 0]
    spot = forward_of(start, 0.05)[:3, 3] + (0.0525 + 0.020 + 0.011) * side
    put_hand(advance, spot, side)
    allowed: list[float] = []
    ask = GuardedArm.allowed

    def heard(
        arm: GuardedArm, near: list[np.ndarray], least: float, speed: float, **words: float
    ) -> float:
        factor = ask(arm, near, least, speed, **words)
        allowed.append(factor * speed)
        return factor

    monkeypatch.setattr(GuardedArm, "allowed", heard)
    aside = forward_of(start, -moved)
    aside[:3, 3] += moved * start[:3, 1]
    places = [robot.tool_pose()[:3, 3]]
    for number in range(90):
        step(advance, aside if number > 60 else start)
        places.append(robot.tool_pose()[:3, 3])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / DT
    assert min(allowed) < 0.06 < 0.1 == PLAIN.advance_speed  # the hand is what slows it
    assert (speeds <= 1.02 * np.array(allowed) + 1e-6).all()


def closing(
    robot: Touching, advance: Advance, start: np.ndarray, disturb: Callable[[], None] | None = None
) -> Retrieval:
    """Close the fingers, up to the part that follows; they are disturbed once on their way."""
    retrieval, now = Retrieval(advance.arm), 0.0
    retrieval.begin(now, start)
    while retrieval.part == "close":
        assert now < 3.0, "the fingers close for ever"
        if disturb is not None and now > 0.1:
            disturb()
        advance.arm.read()
        retrieval.step(now, DT)
        now += DT
    return retrieval


def told_to(robot: Touching) -> list[float]:
    """The widths that the gripper is told from now on, metres."""
    told: list[float] = []
    command = robot.set_gripper

    def note(width: float, force: float) -> None:
        told.append(width)
        command(width, force)

    robot.set_gripper = note  # type: ignore[method-assign]
    return told


def test_fingers_that_are_stuck_hold_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, advance, start = advancing(PLAIN)
    monkeypatch.setattr(robot, "_move_fingers", lambda dt: None)
    with pytest.raises(HaltError, match="apart and press on nothing"):
        closing(robot, advance, start)


@pytest.mark.parametrize("over", [0.0, 4e-4], ids=["", "measured as wider than they open"])
def test_fingers_do_not_close_around_a_hand_in_the_palm(
    over: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its 20 mm of flesh reach from beside the palm 21 mm into it, its forearm points away."""
    robot, advance, start = advancing(PLAIN)
    monkeypatch.setattr(robot, "gripper_width", lambda: LARGEST_OPENING + over)
    advance.arm.read()
    robot.between_fingers = 0.06
    put_hand(advance, start[:3, 3] + start[:3, :3] @ [0.0, 0.031, -0.1], start[:3, 1])
    told = told_to(robot)
    with pytest.raises(HaltError, match="hand 21 mm within the gripper"):
        closing(robot, advance, start)
    assert told == [LARGEST_OPENING]  # nothing has told them to close


BETWEEN = [(0.0, 0.0, -0.012), (0.012, 0.006, -0.025), (-0.01, -0.006, -0.02)]
"""Places between the open pads, metres from the tool along closing, height and approach."""


@pytest.mark.parametrize("place", BETWEEN)
@pytest.mark.parametrize("late", [False, True], ids=["before", "while they close"])
def test_fingers_do_not_close_on_a_finger_between_the_pads(
    place: tuple[float, float, float], late: bool
) -> None:
    """What comes in the fingers' way is soft: they press on it as on a glass."""
    robot, advance, start = advancing(PLAIN)
    robot.between_fingers = 0.016
    told, opening = told_to(robot), robot.gripper_width()

    def come() -> None:
        put_hand(advance, start[:3, 3] + start[:3, :3] @ place, start[:3, 1])

    if not late:
        come()
    assert advance.arm.beside(advance.arm.watch.keypoints) > 0  # it touches nothing
    with pytest.raises(HaltError, match="a finger between the gripper's pads") as halt:
        closing(robot, advance, start, come)
    assert halt.value.back
    assert told == ([0.0, opening] if late else [opening])  # they go on until told otherwise
    assert robot.gripper_width() > 0.06


@pytest.mark.parametrize(
    "place", [(0.02, 0.014, -0.03), (0.0, -0.014, -0.05), (0.0, 0.0, 0.004), (0.064, 0.0, -0.03)]
)
def test_fingers_close_beside_a_finger_that_is_not_between_the_pads(
    place: tuple[float, float, float],
) -> None:
    """Its bone is above, below, before or outside of them, nearer than its flesh is thick."""
    robot, advance, start = advancing(PLAIN)
    robot.between_fingers = 0.05
    away = start[:3, 1] if abs(place[1]) > 0 else start[:3, 2]
    away = start[:3, 0] if place[0] > 0.05 else np.sign(place[1] or 1) * away
    put_hand(advance, start[:3, 3] + start[:3, :3] @ place, away)
    assert closing(robot, advance, start).part == "let go"


@pytest.mark.parametrize("between", [0.0, 0.06], ids=["on the way", "around the glass"])
def test_beside_an_unseen_hand_the_fingers_stop_to_close(between: float) -> None:
    """They open again, unless they are around something: it could be dropped."""
    robot, advance, start = advancing(PLAIN)
    robot.between_fingers = between
    told, opening = told_to(robot), robot.gripper_width()

    def lose() -> None:
        if between == 0.0 or robot.finger_force() > 0:
            advance.arm.watch.keypoints = None
            advance.arm.watch.problem = "the camera stopped"

    with pytest.raises(HaltError, match="the camera stopped") as halt:
        closing(robot, advance, start, lose)
    assert halt.value.back
    assert told == ([0.0, opening] if between == 0.0 else [0.0])
    assert robot.gripper_width() > 0.05


def test_a_finger_between_pads_that_have_closed_is_waited_for_and_stops_it() -> None:
    """The pictures that show it are late; no glass is dropped for one of them that errs."""
    robot, advance, start = advancing(PLAIN)
    robot.between_fingers = 0.016
    retrieval, heard = closing(robot, advance, start), []
    assert retrieval.part == "let go"
    put_hand(advance, start[:3, 3] + start[:3, :3] @ BETWEEN[0], start[:3, 1])
    told, began = told_to(robot), retrieval._since

    def wait() -> None:
        for number in range(200):
            advance.arm.read()
            retrieval.step(began + number * DT, DT)
            heard.append(advance.arm.caution)

    with pytest.raises(HaltError, match="a finger between the gripper's pads") as halt:
        wait()
    assert halt.value.back
    assert set(heard) == {"a finger between the gripper's pads"}
    assert len(heard) == pytest.approx(PULL_TIME / DT, abs=3)
    assert retrieval.part == "let go"
    assert told == []


def drawn_back(force: np.ndarray) -> tuple[float, list[str], str]:
    """How far a gripper comes out by itself while a force (3,), tool frame, is on it, metres.

    And what it says, and the stop's reason where there is one.
    """
    robot, advance, start = advancing(FEELING, block=(0.030, 0.062, 0.11))
    tool, heard, stop = draw_back(robot, advance, start), [], ""
    wrench = np.concatenate([tool[:3, :3] @ force, np.zeros(3)])
    robot.tool_wrench = lambda: wrench  # type: ignore[method-assign]
    for _ in range(150):
        try:
            step(advance, start)
        except HaltError as halt:
            stop = str(halt) + ", back" * halt.back
            break
        heard.append(advance.arm.caution)
        if advance.part != "draw back":
            break
    return (tool - robot.tool_pose())[:3, 3] @ tool[:3, 2], heard, stop


@pytest.mark.parametrize("force", [[0.0, 0.0, 6.0], [12.0, 0.0, -3.0], [0.0, 12.0, 0.0]])
def test_a_gripper_that_hangs_at_what_it_draws_back_from_waits_and_stops(
    force: list[float],
) -> None:
    way, heard, stop = drawn_back(np.array(force))
    assert way < 0.005
    words = "something holds the gripper back with 6.0 N"
    assert set(heard) == {words}
    assert len(heard) == pytest.approx(PULL_TIME / DT, abs=2)
    assert stop == f"{words}, back"


def test_noise_about_the_limit_does_not_let_a_hooked_gripper_stand_for_good() -> None:
    """6 N across are the limit: once it is passed, a tenth less is no end of the pull."""
    robot, advance, start = advancing(FEELING, block=(0.030, 0.062, 0.11))
    tool, noise = draw_back(robot, advance, start), cycle([0.1, -0.1])
    robot.tool_wrench = lambda: np.append((6.0 + next(noise)) * tool[:3, 0], np.zeros(3))  # type: ignore[method-assign]
    with pytest.raises(HaltError, match="something holds the gripper back"):
        final_move(advance, start)
    assert np.linalg.norm((robot.tool_pose() - tool)[:3, 3]) < 0.005


@pytest.mark.parametrize("part", ["advance", "feel"])
@pytest.mark.parametrize(
    ("force", "stands"), [([7.0, 0, 0], True), ([0, 0, 3.5], True), ([5.0, 0, 0], False)]
)
def test_on_its_way_in_it_pulls_at_nobody_from_the_side_either(
    part: str, force: list[float], stands: bool
) -> None:
    """Half of what is across counts, and all that pulls the gripper on."""
    robot, advance, start = advancing(FEELING)
    while advance.part != part or advance.travelled < 0.05:
        assert step(advance, start) is None
    tool = robot.tool_pose()
    robot.tool_wrench = lambda: np.append(tool[:3, :3] @ force, np.zeros(3))  # type: ignore[method-assign]
    if not stands:
        assert final_move(advance, start)[0][2, 3] > WAY
        return
    steps = round(PULL_TIME / DT) - 1
    assert [step(advance, start) for _ in range(steps)] == steps * [None]
    assert advance.arm.caution == "something holds the gripper back with 3.5 N"
    assert np.linalg.norm((robot.tool_pose() - tool)[:3, 3]) < 0.005
    with pytest.raises(HaltError, match="something holds the gripper back") as halt:
        [step(advance, start) for _ in range(3)]
    assert halt.value.back


@pytest.mark.parametrize("force", [[0.0, 0.0, 2.5], [0.0, 0.0, -6.0], [5.0, 0.0, -5.0]])
def test_a_light_pull_and_what_it_presses_on_let_it_draw_back(force: list[float]) -> None:
    way, heard, stop = drawn_back(np.array(force))
    assert way > 0.02
    assert not any(heard)
    assert stop == ""


def test_a_thin_stem_that_both_fingers_press_is_held() -> None:
    robot, advance, start = advancing(PLAIN)
    robot.between_fingers = 0.002
    retrieval, now = closing(robot, advance, start), 1.0
    assert retrieval.part == "let go"
    robot.between_fingers = 0.0
    for _ in range(10):
        robot.servo_to(start, DT)
    advance.arm.read()
    with pytest.raises(HaltError, match="slipped out of the fingers"):
        retrieval.step(now, DT)
