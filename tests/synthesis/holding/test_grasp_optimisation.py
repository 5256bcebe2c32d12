import numpy as np

from hadr.hand import HandShape
from hadr.synthesis.holding.contact import check_contact
from hadr.synthesis.holding.grasp_optimisation import GraspOptimisation, hand_skins
from hadr.synthesis.holding.kinds import Placement, finger_plan, pose_from_axis


def test_the_fingers_do_not_reach_what_is_too_far():
    hand = hand_skins(HandShape())
    pose = pose_from_axis([1, 0, 0], [0, 0.1, 0.6], 0.05, [0, 0, 1])
    attempt = GraspOptimisation("0005", hand, Placement(pose, finger_plan("side")))
    angles, cost = attempt.run(np.random.default_rng(0))
    report = check_contact("0005", HandShape(), angles, pose)
    assert report.touching == ()
    assert cost > 100
    assert report.overlap < 0.003
