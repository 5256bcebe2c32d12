"""The three stages: every transition, every way to stop, and the limits on the way."""

import numpy as np
import pytest

from hadr.handover import ur5
from hadr.handover.grasps import forward_of
from hadr.handover.rehearsal import HeldGlass, MovingHand, camera_at, rehearse
from hadr.handover.robot import SimulatedUR5
from hadr.handover.selection import GraspSelection
from hadr.handover.workflow import (
    ChosenGrasp,
    Handover,
    HandoverConfig,
    Observation,
    Stage,
    pose_distance,
)

SCENE = HeldGlass()
CAMERA = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))
DT = 1 / 30
STAGES = [Stage.APPROACH_AND_REACT, Stage.GRASP_AND_RETRIEVE, Stage.FINISHED]


def new_handover(config: HandoverConfig | None = None, seed: int = 0) -> Handover:
    choose = GraspSelection(np.random.default_rng(seed), CAMERA[:3, 3])
    return Handover(SimulatedUR5(), choose, CAMERA, config or HandoverConfig())


def fixed_grasp() -> np.ndarray:
    """A grasp in front of the glass that faces the human."""
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    pose[:3, 3] = SCENE.base_from_glass[:3, 3] + [-0.033, 0, 0.17]
    return pose


def fixed_handover(config: HandoverConfig | None = None) -> Handover:
    chosen = ChosenGrasp(fixed_grasp(), 0.075, 1.0)
    config = config or HandoverConfig()
    return Handover(SimulatedUR5(), lambda p, k, r: chosen, CAMERA, config)


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_runs_through_the_stages_and_keeps_every_limit(seed: int) -> None:
    handover = new_handover(seed=seed)
    moments = rehearse(handover, MovingHand(SCENE, CAMERA, seed=seed))
    assert [t.after for t in handover.transitions] == STAGES
    assert all(t.reason for t in handover.transitions)
    joints = np.array([m.joints for m in moments])
    assert np.abs(np.diff(joints, axis=0)).max() <= 0.25 * ur5.JOINT_SPEED * DT + 1e-9
    assert min(m.outline[2:, 2].min() for m in moments) > 0.03
    assert min(m.to_hand for m in moments) > 0


def test_same_seed_same_handover() -> None:
    first, second = (rehearse(new_handover(), MovingHand(SCENE, CAMERA)) for _ in "ab")
    np.testing.assert_array_equal([m.joints for m in first], [m.joints for m in second])


def test_approach_follows_the_moved_hand() -> None:
    hand = MovingHand(SCENE, CAMERA, seed=2)
    handover = fixed_handover()
    start = forward_of(fixed_grasp(), -0.10)
    for step in range(20):
        handover.step(hand.observe(step * DT), DT)
        if step:
            assert handover.target is not None
            np.testing.assert_allclose(handover.target, hand.motion(step * DT) @ start, atol=1e-9)


@pytest.mark.parametrize(("reading", "travel"), [("past_grasp", 0.15), ("from_pre_grasp", 0.05)])
def test_final_move_travels_as_read(reading: str, travel: float) -> None:
    handover = fixed_handover(HandoverConfig(final_move=reading, retreat=0.1))
    moments = rehearse(handover, MovingHand(SCENE, CAMERA, drift=0.0, turn=0.0))
    waiting = forward_of(fixed_grasp(), -0.10)
    far = max(
        (m.tool[:3, 3] - waiting[:3, 3]) @ waiting[:3, 2]
        for m in moments
        if m.stage is Stage.GRASP_AND_RETRIEVE
    )
    assert far == pytest.approx(travel, abs=1e-6)
    assert handover.stage is Stage.FINISHED


def test_a_hand_lost_for_three_tenths_stops_it_and_shorter_does_not() -> None:
    handover = new_handover()
    moments = rehearse(handover, MovingHand(SCENE, CAMERA, lost_from=0.5))
    last = handover.transitions[-1]
    assert last.after is Stage.STOPPED
    assert last.reason.startswith("no hand seen for 0.3")
    assert last.time == pytest.approx(14 * DT + 0.3)  # seen last in step 14, just before 0.5 s
    still = [m.joints for m in moments if m.time >= 0.5 + DT]
    assert np.abs(np.diff(still, axis=0)).max(initial=0.0) < 1e-9
    handover = new_handover()
    hand = MovingHand(SCENE, CAMERA)
    for step in range(40):
        gap = 10 <= step < 18  # 0.27 s
        seen = Observation(step * DT) if gap else hand.observe(step * DT)
        assert handover.step(seen, DT) is not Stage.STOPPED


def test_nan_stops_it_and_it_stays_stopped() -> None:
    handover = new_handover()
    hand = MovingHand(SCENE, CAMERA, nan_from=0.3)
    rehearse(handover, hand)
    assert handover.stage is Stage.STOPPED
    assert "index_tip" in handover.transitions[-1].reason
    joints = handover.robot.joint_positions()
    handover.step(MovingHand(SCENE, CAMERA).observe(0.4), DT)
    handover.robot.servo_to(forward_of(handover.robot.tool_pose(), 0.05), DT)
    np.testing.assert_array_equal(handover.robot.joint_positions(), joints)


def test_twenty_keypoints_stop_it() -> None:
    handover = new_handover()
    handover.step(Observation(0.0, SCENE.keypoints[:20]), DT)
    assert handover.stage is Stage.STOPPED
    assert "(20, 3)" in handover.transitions[-1].reason


def test_out_of_reach_and_timeout_stop_it() -> None:
    handover = new_handover()
    rehearse(handover, MovingHand(SCENE, CAMERA, drift=0.4, calm_after=np.inf))
    assert handover.stage is Stage.STOPPED
    assert "reach" in handover.transitions[-1].reason
    handover = new_handover(HandoverConfig(approach_timeout=0.2))
    rehearse(handover, MovingHand(SCENE, CAMERA))
    assert handover.transitions[-1].reason == "pre-grasp not reached within 0.2 s"


def test_another_holding_pose_is_observed_again() -> None:
    handover = fixed_handover()
    hand = MovingHand(SCENE, CAMERA)
    handover.step(hand.observe(0.0), DT)
    seen = hand.observe(DT)
    assert seen.keypoints is not None
    opened = seen.keypoints.copy()
    opened[5:] = opened[0] + 2.0 * (opened[5:] - opened[0])
    assert handover.step(Observation(DT, opened), DT) is Stage.WAIT_AND_OBSERVE
    assert "mm from a rigid motion" in handover.transitions[-1].reason


def test_gripper_near_the_hand_stops_the_approach() -> None:
    handover = fixed_handover(HandoverConfig(smallest_hand_distance=0.5))
    rehearse(handover, MovingHand(SCENE, CAMERA))
    assert handover.stage is Stage.STOPPED
    assert "from the hand during the approach" in handover.transitions[-1].reason


def test_a_restless_hand_is_not_grasped_at_once() -> None:
    restless = MovingHand(SCENE, CAMERA, drift=0.03, calm_after=np.inf)
    times = []
    for drift in (np.inf, 0.005):
        handover = fixed_handover(HandoverConfig(largest_drift=drift))
        rehearse(handover, restless)
        times.append(next(t.time for t in handover.transitions if t.after is STAGES[1]))
    assert times[0] < times[1]


def test_waits_without_a_hand_or_points() -> None:
    handover = new_handover()
    joints = handover.robot.joint_positions()
    for step in range(30):
        assert handover.step(Observation(step * DT), DT) is Stage.WAIT_AND_OBSERVE
    np.testing.assert_allclose(handover.robot.joint_positions(), joints, atol=1e-9)


def test_camera_pose_is_checked() -> None:
    with pytest.raises(ValueError, match="base_from_camera must hold a proper rotation"):
        Handover(SimulatedUR5(), lambda p, k, r: None, np.diag([1.0, 1, -1, 1]))


def test_pose_distance_by_hand() -> None:
    first, second = np.eye(4), np.eye(4)
    second[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    second[:3, 3] = [0.03, 0.04, 0]
    distance, angle = pose_distance(first, second)
    assert distance == pytest.approx(0.05)
    assert angle == pytest.approx(np.pi / 2)


def test_visible_points_lie_on_the_glass_and_face_the_camera() -> None:
    points = SCENE.visible_points(CAMERA[:3, 3])
    local = (points - SCENE.base_from_glass[:3, 3]) @ SCENE.base_from_glass[:3, :3]
    radius = np.hypot(local[:, 0], local[:, 1])
    expected = np.array([SCENE.glass.outer_radius(float(z)) for z in local[:, 2]])
    side = (local[:, 2] > 0.1) & (local[:, 2] < 0.19)
    np.testing.assert_allclose(radius[side], expected[side], atol=2e-3)
    away = points - CAMERA[:3, 3]
    outward = (points - SCENE.base_from_glass[:3, 3]) * [1, 1, 0]
    assert ((away * outward).sum(axis=1)[side] < 0.01).all()
