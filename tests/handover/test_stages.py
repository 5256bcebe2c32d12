"""Settings of the workflow: every number is checked, and named with its value."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from hadr.handover.stages import HandoverConfig
from hadr.simulation.trials.trial import ATTEMPT_CONFIG

NUMBERS = [item.name for item in fields(HandoverConfig) if item.type == "float"]


def test_the_numbers_are_found() -> None:
    assert {"back", "largest_drift", "patience"} <= set(NUMBERS)
    assert ATTEMPT_CONFIG.feel_aside == 0.02  # the attempts' settings pass


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("bad", [np.nan, -np.inf, -1e-6, "0.1", None, True])
def test_bad_numbers_are_named(name: str, bad: object) -> None:
    with pytest.raises(ValueError, match=f"{name} must be .*, got '?{bad}"):
        HandoverConfig(**{name: bad})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", NUMBERS)
def test_only_limits_may_be_infinite(name: str) -> None:
    if name == "largest_drift":
        assert getattr(HandoverConfig(**{name: np.inf}), name) == np.inf  # type: ignore[arg-type]
        return
    with pytest.raises(ValueError, match=f"{name} must be a finite number, got inf"):
        HandoverConfig(**{name: np.inf})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["approach_speed", "turn_speed", "advance_speed", "back_speed"])
def test_speeds_are_above_zero(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} must be more than 0, got 0"):
        HandoverConfig(**{name: 0.0})  # type: ignore[arg-type]


def test_counts_and_the_final_move() -> None:
    assert HandoverConfig(corrections=0).corrections == 0
    for name, bad, says in (
        ("corrections", -1, "0 or more, got -1"),
        ("corrections", 1.5, "an integer, got 1.5"),
        ("tries", 0, "1 or more, got 0"),
        ("tries", np.nan, "an integer, got nan"),
        ("final_move", "past", "one of past_grasp, from_pre_grasp, got 'past'"),
    ):
        with pytest.raises(ValueError, match=f"{name} must be {says}"):
            HandoverConfig(**{name: bad})  # type: ignore[arg-type]
