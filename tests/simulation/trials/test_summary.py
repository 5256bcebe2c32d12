"""What attempts come to in a row, and rows of several seeds in one."""

import math
from itertools import count
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from hadr.handover.guarded_arm import too_near
from hadr.handover.safety import withdrawal
from hadr.simulation.trials.summary import condition_row, success_interval

HOLDS = count()


def outcome(object_id: str, verdict: str, **values: Any) -> dict[str, Any]:
    return {
        "trial": {"object_id": object_id, "hold_number": next(HOLDS), "seed": 0},
        "verdict": verdict,
        "transitions": [],
        "motion": "still",
        "decided_at": 6.0,
        "first_grasp_at": 1.0,
        "corrections": 0,
        "torn": False,
        "planning_wall_seconds": 0.1,
        "wall_seconds": 4.0,
        "smallest_distance": 0.04,
        "largest_force": 0.0,
        "forces": {},
        **values,
    }


def test_a_conditions_row_by_hand() -> None:
    outcomes = [
        # 0000: all of two; 0001: one of two, which is not above 0.5; 0004: none of one
        outcome("0000", "success", decided_at=5.0, largest_force=0.0, grasp_off=0.01),
        outcome("0000", "success", decided_at=8.0, smallest_distance=0.01, grasp_off=0.03),
        outcome("0001", "success", decided_at=8.0, planning_wall_seconds=None),
        outcome(
            "0001", "drop", decided_at=9.0, first_grasp_at=4.0, wall_seconds=9.0, grasp_off=0.04
        ),
        outcome("0004", "gave up", decided_at=1.0, first_grasp_at=None, largest_force=2.5),
    ]
    outcomes[0]["forces"] = {"through the glass, Grasp & Retrieve": 3.0}
    outcomes[1]["forces"] = {"through the glass, Grasp & Retrieve": 4.0, "touch, Stopped": 2.5}
    outcomes[0]["motion"], outcomes[3]["motion"] = "turn", "turn"
    row = condition_row("hadr", outcomes)
    assert row["by_motion"] == {outcomes[1]["motion"]: [2, 3], "turn": [1, 2]}
    assert (row["condition"], row["attempts"], row["successes"], row["rate"]) == ("hadr", 5, 3, 0.6)
    assert row["rate_by_object"] == {"0000": 1.0, "0001": 0.5, "0004": 0.0}
    assert row["objects_at_50_percent"] == 1
    assert row["objects_at_80_percent"] == 1
    assert row["objects_at_100_percent"] == 1
    assert row["failures"] == {"drop": 1, "gave up": 1}
    assert row["mean_seconds"] == pytest.approx(7.0)  # of the successes
    assert row["mean_seconds_to_first_grasp"] == pytest.approx((3 * 1.0 + 4.0) / 4)
    assert row["mean_planning_wall_seconds"] == pytest.approx(0.1)
    assert row["mean_wall_seconds"] == pytest.approx(5.0)
    assert row["smallest_hand_distance_m"] == 0.01
    assert row["largest_force_n"] == 2.5
    assert row["largest_forces_n"] == {**outcomes[1]["forces"]}
    assert row["grasp_off"] == {"success": pytest.approx(0.02), "failure": pytest.approx(0.04)}
    names = [f"{o['trial']['object_id']}-{o['trial']['hold_number']}" for o in outcomes]
    assert list(row["verdicts"]) == names
    assert list(row["verdicts"].values()) == ["success"] * 3 + ["drop", "gave up"]
    with pytest.raises(ValueError, match=f"attempt {names[0]} is there twice"):
        condition_row("hadr", [*outcomes, outcomes[0]])


def test_a_row_says_in_which_stages_time_ran_out() -> None:
    changes = [[0.3, "Wait & Observe", "Approach & React", "a grasp"]]
    outcomes = [
        outcome("0000", "time-out"), outcome("0000", "time-out", transitions=changes),
        outcome("0000", "time-out", transitions=changes), outcome("0000", "drop"),
    ]  # fmt: skip
    row = condition_row("raw", outcomes)
    assert row["time_out_in"] == {"Approach & React": 2, "Wait & Observe": 1}


def stopped(*reasons: str) -> list[list[Any]]:
    return [[1.0, "Approach & React", "Stopped", why] for why in reasons]


def test_a_row_says_what_happened_and_what_became_of_it() -> None:
    away = withdrawal(np.ones(3), np.ones(3), np.array([1.0, 0, 0]))
    near = too_near(0.004, 0.005)
    outcomes = [
        outcome("0000", "success"),
        outcome("0000", "success", transitions=stopped(away, near), corrections=2),
        outcome("0000", "drop", transitions=stopped(near, near), torn=True),
        outcome("0000", "time-out", first_grasp_at=None),
        outcome("0000", "time-out", first_grasp_at=3.1, transitions=stopped("no hand seen")),
        outcome("0000", "time-out", transitions=[[1.0, "Stopped", "Wait & Observe", near]]),
    ]
    assert condition_row("raw", outcomes)["incidents"] == {
        "never stopped": [1, 3],
        "no grasp for 3 s": [0, 2],
        "stopped for another reason": [0, 1],
        "the hand was in the way": [1, 2],
        "the hand withdrew": [1, 1],
        "went in again beside": [1, 1],
        "the glass was torn out of the hand": [0, 1],
    }


def test_attempts_of_several_seeds_are_told_apart() -> None:
    first = outcome("0000", "success")
    second = {**first, "trial": {**first["trial"], "seed": 3}}
    name = f"0000-{first['trial']['hold_number']}"
    assert list(condition_row("raw", [first, second])["verdicts"]) == [name, f"{name}-3"]


def test_the_interval_is_wilsons_and_seeds_of_a_hold_that_always_agree_count_once() -> None:
    ten = {f"0000-{hold}": hold < 7 for hold in range(10)}
    wilson = binomtest(7, 10).proportion_ci(0.95, "wilson")
    assert success_interval(ten) == pytest.approx([wilson.low, wilson.high])
    agree = {f"{name}-{seed}": won for name, won in ten.items() for seed in range(1, 5)}
    assert success_interval(agree) == pytest.approx(success_interval(ten))
    # in each hold two of four: nothing depends on the hold, all 40 count
    mixed = {f"0000-{hold}-{seed}": seed < 3 for hold in range(10) for seed in range(1, 5)}
    wilson = binomtest(20, 40).proportion_ci(0.95, "wilson")
    assert success_interval(mixed) == pytest.approx([wilson.low, wilson.high])
    never = {name: False for name in agree}  # which says nothing of how alike seeds are
    assert success_interval(never) == pytest.approx(success_interval(dict.fromkeys(ten, False)))


def test_objects_above_the_papers_marks() -> None:
    won = {"0000": 6, "0001": 5, "0004": 4, "0006": 3}  # of six: 1.0, 0.83, 0.67, 0.5
    row = condition_row(
        "raw",
        [outcome(o, "success" if i < n else "drop") for o, n in won.items() for i in range(6)],
    )
    marks = [row[f"objects_at_{mark}_percent"] for mark in (50, 80, 100)]
    assert marks == [3, 2, 1]


def test_means_without_a_success_are_nan_and_no_outcome_is_refused() -> None:
    row = condition_row("raw", [outcome("0000", "drop")])
    assert math.isnan(row["mean_seconds"])
    with pytest.raises(ValueError, match="no attempt of condition 'raw' to sum up"):
        condition_row("raw", [])
