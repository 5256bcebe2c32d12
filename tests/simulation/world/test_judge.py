import numpy as np
import pytest

from hadr.simulation.world.judge import GOAL, Judge
from hadr.simulation.world.state import WorldState


def state(time, at=(0.62, 0.0, 0.3), holder="hand", force=0.0, distance=0.05):
    """The world with the foot of an object that is 0.2 m tall at a place."""
    pose = np.eye(4)
    pose[:3, 3] = at
    return WorldState(time, np.zeros(6), 0.05, np.eye(4), pose, holder, force, distance)


def at_goal(time, off=0.0, holder="gripper", **more):
    """The middle is off metres beside the goal, so the foot is 0.1 m lower."""
    return state(time, np.add(GOAL, [off, 0.0, -0.1]), holder, **more)


def judged(*states, height=0.2):
    judge = Judge(height)
    for each in states:
        judge.look(each)
    return judge


def test_an_object_held_at_the_goal_for_a_tenth_of_a_second_is_a_success():
    judge = judged(state(0.0), at_goal(5.0), at_goal(5.05), at_goal(5.1))
    assert (judge.verdict, judge.decided_at) == ("success", 5.1)
    assert judged(at_goal(5.0), at_goal(5.05)).verdict == ""


def test_the_middle_counts_and_the_radius_is_15_cm():
    assert judged(at_goal(5.0, 0.149), at_goal(5.2, 0.149)).verdict == "success"
    assert judged(at_goal(5.0, 0.151), at_goal(5.2, 0.151)).verdict == ""
    foot_at_goal = [state(t, GOAL, "gripper") for t in (5.0, 5.2)]
    assert judged(*foot_at_goal, height=0.2).verdict == "success"  # its middle is 10 cm off
    assert judged(*foot_at_goal, height=0.4).verdict == ""  # and here 20 cm


@pytest.mark.parametrize("holder", ["hand", "both", "nobody"])
def test_only_the_fingers_alone_count(holder):
    assert judged(at_goal(5.0, holder=holder), at_goal(5.2, holder=holder)).verdict != "success"


def test_an_interruption_starts_the_tenth_of_a_second_again():
    states = [at_goal(5.0), at_goal(5.08), at_goal(5.09, 0.3), at_goal(5.12), at_goal(5.2)]
    assert judged(*states).verdict == ""
    assert judged(*states, at_goal(5.22)).verdict == "success"


def test_any_force_on_the_hand_is_human_contact():
    judge = judged(state(1.0), state(1.02, force=0.01), at_goal(2.0), at_goal(2.2))
    assert (judge.verdict, judge.decided_at) == ("human contact", 1.02)


def test_an_object_that_nobody_holds_is_dropped_once_it_has_fallen():
    def at(time, height, holder="nobody"):
        return state(time, (0.62, 0.0, height), holder)

    leans = [at(1.0, 0.3, "gripper"), *(at(1.02 + 0.1 * k, 0.251) for k in range(5))]
    judge = judged(at(0.0, 0.5, "hand"), *leans)  # lowered by who held it
    assert judge.verdict == ""
    assert judge.look(at(1.6, 0.249)) == "drop"
    assert judged(*leans, at(1.6, 0.251, "gripper"), at(1.7, 0.202)).verdict == ""


def test_after_13_seconds_time_is_out():
    assert judged(state(13.0)).verdict == ""
    assert judged(state(13.02)).verdict == "time-out"


def test_the_first_verdict_stays_and_forces_are_still_counted():
    judge = judged(at_goal(5.0), at_goal(5.1), state(5.2, force=30.0, distance=0.0))
    judge.give_up(6.0)
    assert judge.verdict == "success"
    assert judge.largest_force == 30.0
    assert judge.smallest_distance == 0.05


def test_giving_up_is_a_verdict_of_its_own():
    judge = judged(state(1.0))
    judge.give_up(2.0)
    assert (judge.verdict, judge.decided_at) == ("gave up", 2.0)
