"""The judge of the random faults sees what is unsafe: one that finds nothing is none."""

from dataclasses import replace

import numpy as np
import pytest

from hadr.camera import transform_points
from hadr.handover import ur5
from hadr.handover.observation import Observation
from hadr.handover.simulated_ur5 import HOME_JOINTS, SimulatedUR5
from hadr.handover.stages import Stage
from hadr.simulation.trials.rehearsal import Moment


@pytest.fixture
def judge(load_benchmark):
    return load_benchmark("handover/random_faults")


def moments(joints: np.ndarray, skin_at: np.ndarray) -> list[Moment]:
    """An arm with open fingers that goes through joint angles (n, 6); the hand lies at a point."""
    arm, hand = SimulatedUR5(), np.eye(4)
    hand[:3, 3] = skin_at
    return [
        Moment(
            k / 30, angles, 0.085, hand, np.eye(4), "hand", 0.0, 0.1,
            stage=Stage.APPROACH_AND_REACT, tool=arm.tool_pose_at(angles), outline=np.zeros((9, 3)),
            keypoints=np.zeros((21, 3)), to_target=0.1,
        )
        for k, angles in enumerate(joints)
    ]  # fmt: skip


FAR = np.array([3.0, 0.0, 0.0])
SKIN = np.random.default_rng(0).uniform(-0.01, 0.01, (50, 3))


def test_a_slow_arm_far_from_anybody_is_safe(judge) -> None:
    turning = HOME_JOINTS + 0.001 * np.arange(20)[:, None] * [1, 0, 0, 0, 0, 0]
    assert judge.unsafe(moments(turning, FAR), [True] * 20, SKIN) == {}


def test_an_arm_that_jumps_or_speeds_is_found(judge) -> None:
    jump = np.where(np.arange(20) < 10, 0.0, 0.02 * (np.arange(20) - 9))  # 0.6 rad/s at once
    found = judge.unsafe(moments(HOME_JOINTS + jump[:, None] * [0, 0, 0, 0, 0, 1], FAR), [], SKIN)
    assert found == {"joint acceleration, rad/s2": pytest.approx(18.0)}
    speed = 0.025 * np.arange(20)[:, None] * [1, 0, 0, 0, 0, 0]  # 0.36 m from the axis: 0.27 m/s
    assert set(judge.unsafe(moments(HOME_JOINTS + speed, FAR), [], SKIN)) == {"tool speed, m/s"}


def test_a_joint_too_fast_or_too_far_and_an_arm_in_the_table_are_found(judge) -> None:
    wrist = np.arange(20)[:, None] * [0, 0, 0, 0, 0, 1.0]  # the tool's point lies on its axis
    found = judge.unsafe(moments(HOME_JOINTS + 0.03 * wrist, FAR), [], SKIN)
    assert found == {"joint speed, rad/s": pytest.approx(0.9)}
    for joint, limit in ((2, np.pi), (5, 2 * np.pi)):  # the elbow turns half as far
        around = HOME_JOINTS + 0 * wrist
        around[:, joint] = 1.01 * limit
        found = judge.unsafe(moments(around, FAR), [], SKIN)
        assert found["joint angle, of its limit"] == pytest.approx(1.01)
    for low in ("tool", "link"):
        still = moments(HOME_JOINTS + 0 * wrist, FAR)
        for m in still:
            if low == "tool":
                m.tool[2, 3] = -0.01
            else:
                m.outline[4, 2] = -0.01
        found = judge.unsafe(still, [], SKIN)
        assert found == {f"{low} below the table, m": pytest.approx(0.01)}


@pytest.mark.parametrize("holder", ["gripper", "hand"])
def test_fingers_open_with_what_they_alone_hold_only_at_a_hand(judge, holder) -> None:
    def opened(skin_at: np.ndarray) -> dict[str, float]:
        still = moments(np.tile(HOME_JOINTS, (4, 1)), skin_at)
        return judge.unsafe(
            [
                replace(m, holder=holder, gripper_width=0.03 + 0.005 * k)
                for k, m in enumerate(still)
            ],
            [], SKIN,
        )  # fmt: skip

    tool = SimulatedUR5().tool_pose_at(HOME_JOINTS)
    ahead = [transform_points(tool, np.array([[0.0, 0.0, z]]))[0] for z in (0.04, 0.10)]
    assert opened(ahead[0]) == {}
    found = opened(ahead[1])
    if holder == "gripper":
        assert 0.08 < found["opened with no hand there, m"] < 0.11
        assert set(opened(FAR)) == set(found)
        outline = ur5.link_outline(HOME_JOINTS)[4:6].mean(axis=0)  # in the forearm
        beside_it = transform_points(ur5.BASE_LINK_FROM_DH_BASE, outline[None])[0] + [0, 0, 0.08]
        assert set(opened(beside_it)) == set(found)
    else:
        assert found == {}


def test_an_arm_that_goes_into_the_skin_is_found_and_a_hand_that_comes_is_not(judge) -> None:
    turning = HOME_JOINTS + 0.004 * np.arange(20)[:, None] * [1, 0, 0, 0, 0, 0]
    tool = SimulatedUR5().tool_pose_at(turning[-1])
    finger = transform_points(tool, np.array([[0.0475, 0.0, -0.03]]))[0]
    run = moments(turning, finger)
    found = judge.unsafe(run, [], SKIN)
    assert 0.002 < found["into the skin, m"] <= 0.005  # half of a finger
    creeps = np.linspace(turning[0], turning[-1], 150)  # 0.2 mm a step
    assert set(judge.unsafe(moments(creeps, finger), [], SKIN)) == {"into the skin, m"}
    stands = [replace(m, joints=turning[-1], tool=tool) for m in run]
    comes = [
        replace(m, base_from_wrist=m.base_from_wrist + np.eye(4, k=3) * (19 - k) / 100)
        for k, m in enumerate(stands)
    ]
    assert judge.unsafe(comes, [], SKIN) == {}


@pytest.mark.parametrize("widths", [(0.085, 0.02), (0.02, 0.085)])
def test_fingers_that_move_into_the_skin_are_found(judge, widths) -> None:
    still = moments(np.tile(HOME_JOINTS, (14, 1)), FAR)
    tool, away = still[0].tool, 0.03 if widths[1] == 0.02 else 0.05  # between the fingers, beside
    hand = np.eye(4)
    hand[:3, 3] = transform_points(tool, np.array([[away, 0.0, -0.03]]))[0]
    moved = [
        replace(m, gripper_width=width, base_from_wrist=hand)
        for m, width in zip(still, np.linspace(*widths, 14), strict=True)
    ]
    assert "into the skin, m" in judge.unsafe(moved, [], SKIN / 4)


def test_who_cannot_see_the_hand_may_not_go_toward_it(judge) -> None:
    turning = HOME_JOINTS + 0.004 * np.arange(40)[:, None] * [1, 0, 0, 0, 0, 0]
    tool = SimulatedUR5().tool_pose_at(turning[-1])
    beside = transform_points(tool, np.array([[0.0475, 0.0, -0.03]]))[0]
    way = (tool[:3, 3] - SimulatedUR5().tool_pose_at(turning[-2])[:3, 3]) / 0.0015
    beside += 0.03 * way
    run = moments(turning, beside)
    assert "toward a hand unseen, m" in judge.unsafe(run, [True] * 40, SKIN)
    assert judge.unsafe(run, [False] * 40, SKIN) == {}
    far = moments(turning, beside + 0.15 * way)
    assert "toward a hand unseen, m" in judge.unsafe(far, [True] * 40, SKIN)


def test_what_came_before_a_driver_s_error_is_judged(judge, monkeypatch) -> None:
    judged = []
    monkeypatch.setattr(judge, "unsafe", lambda moments, *_: judged.append(len(moments)) or {})
    fails = judge.Fault("driver fails", 3.0, 30.0, 1.0, np.array([1.0, 0, 0]))
    monkeypatch.setattr(judge, "faults_of", lambda _: [fails])
    row = judge.run(9)
    assert row["raised"]
    assert judged[0] > 60  # it fails after seconds
    assert row["unsafe"] == {}
    monkeypatch.setattr(judge.BrokenUR5, "stop", lambda _: None)
    assert judge.run(9)["unsafe"] == {"not stopped after the driver's error": 1.0}


def test_a_fault_needs_only_what_it_changes(judge) -> None:
    axis = np.array([1.0, 0, 0])
    seen = Observation(1.0, np.ones((21, 3)), None)
    jumped = judge.seen(judge.Fault("clock jumps", 0, 9, 1.0, axis), seen, [seen], None)
    assert jumped.time == pytest.approx(101.0)
    gone = judge.seen(judge.Fault("no hand", 0, 9, 1.0, axis), seen, [seen], None)
    assert gone.keypoints is None
    for kind in judge.PERCEPTION:
        judge.seen(judge.Fault(kind, 0, 9, 0.5, axis), gone, [seen], np.random.default_rng(0))
