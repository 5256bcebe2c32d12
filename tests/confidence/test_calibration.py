import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hadr.confidence.calibration import (
    FLOOR_M,
    Calibration,
    ConfidenceRule,
    fit_calibration,
    fit_confidence,
    learned_range,
    reliability,
    signal_of,
    sparsification,
    within_learned,
)


def test_calibration_by_hand() -> None:
    """Four bins with shares 0, 1, 0, 1: the middle two are pooled to one half."""
    score = np.array([0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.85, 0.95])
    error = np.repeat([0.3, 0.0, 0.3, 0.0], 2)
    found = fit_calibration(score, error, bins=4, frames=7)
    assert (found.pixels, found.frames, found.tolerance_m) == (8, 7, 0.02)
    np.testing.assert_allclose(found.scores, (0.1, 0.4, 0.9))
    np.testing.assert_allclose(found.probabilities, (0, 0.5, 1))
    assert found(0.25) == pytest.approx(0.25)
    assert found(0.0) == 0
    assert found(1.0) == 1


def test_equal_scores_share_a_bin() -> None:
    found = fit_calibration(np.full(100, 0.7), np.where(np.arange(100) < 30, 0.0, 1.0), bins=20)
    np.testing.assert_allclose(found.scores, (0.7,))
    np.testing.assert_allclose(found.probabilities, (0.3,))
    np.testing.assert_allclose(found(np.array([0.0, 0.7, 1.0])), 0.3)


pixels = st.lists(st.tuples(st.floats(0, 1), st.floats(-1, 1)), min_size=1, max_size=200)


@given(pixels, st.integers(1, 30))
def test_a_calibration_never_falls(drawn, bins) -> None:
    score, error = np.array(drawn).T
    found = fit_calibration(score, error, bins=bins)
    said = found(np.linspace(0, 1, 101))
    assert (np.diff(said) >= 0).all()
    assert said.min() >= 0
    assert said.max() <= 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(scores=(0.5, 0.5)), "scores must rise"),
        (dict(probabilities=(0.6, 0.4)), "probabilities must not fall"),
        (dict(probabilities=(0.6, 1.4)), r"must lie in 0\.\.1, got \(0.6, 1.4\)"),
        (dict(probabilities=(0.6,)), "as many probabilities as scores, got 1 and 2"),
        (dict(tolerance_m=0.0), "tolerance_m must be positive metres, got 0"),
        (dict(scores=(0.5, float("nan"))), "scores must rise"),
    ],
)
def test_impossible_calibrations(change, message) -> None:
    with pytest.raises(ValueError, match=message):
        Calibration(**{"scores": (0.2, 0.8), "probabilities": (0.1, 0.9)} | change)


@pytest.mark.parametrize(
    ("signal", "error", "message"),
    [
        ([], [], "a signal and an error a pixel, got 0 and 0"),
        ([0.5], [0.1, 0.2], "got 1 and 2"),
        ([np.inf], [0.1], "finite signals and errors"),
        ([0.5], [np.nan], "finite signals and errors"),
    ],
)
def test_unusable_pixels(signal, error, message) -> None:
    with pytest.raises(ValueError, match=message):
        fit_confidence(np.array(signal), np.array(error))


def test_expected_calibration_error_by_hand() -> None:
    """Bin 0.2..0.3: says 0.25, true 1 of 4. Bin 0.8..0.9: says 0.85, true 1 of 2. And a 1."""
    confidence = np.array([0.25, 0.25, 0.25, 0.25, 0.8, 0.9 - 1e-9, 1.0])
    right = np.array([1, 0, 0, 0, 1, 0, 1], bool)
    found = reliability(confidence, right)
    np.testing.assert_array_equal(found.count, [0, 0, 4, 0, 0, 0, 0, 0, 2, 1])
    np.testing.assert_allclose(found.true[[2, 8, 9]], [0.25, 0.5, 1])
    np.testing.assert_allclose(found.said[[2, 8, 9]], [0.25, 0.85, 1])
    assert np.isnan(found.said[0])
    assert found.expected_error == pytest.approx((4 * 0 + 2 * 0.35 + 1 * 0) / 7)


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match=r"dropped must lie in \[0, 1\), got \[1.0\]"):
        sparsification(np.ones(3), np.ones(3), (1.0,))
    with pytest.raises(ValueError, match="got 3 and 2"):
        sparsification(np.ones(3), np.ones(2))
    with pytest.raises(ValueError, match=r"confidence must lie in 0\.\.1, got -0.1 to 0.5"):
        reliability(np.array([-0.1, 0.5]), np.array([True, False]))
    with pytest.raises(ValueError, match="got 2 and 1"):
        reliability(np.array([0.1, 0.5]), np.array([True]))


def test_sparsification_by_hand() -> None:
    """Squared errors 1, 4, 9, 16; the confidence knows the worst and mixes the others up."""
    error = np.array([1.0, -2.0, 3.0, -4.0])
    confidence = np.array([0.5, 0.9, 0.6, 0.1])
    found = sparsification(confidence, error, (0.0, 0.25, 0.5, 0.75))
    np.testing.assert_allclose(found.rmse_m**2, [30 / 4, 14 / 3, 13 / 2, 4])
    np.testing.assert_allclose(found.oracle_rmse_m**2, [30 / 4, 14 / 3, 5 / 2, 1])
    assert found.random_rmse_m**2 == pytest.approx(7.5)


def test_a_constant_confidence_gains_nothing_in_any_order() -> None:
    error = np.arange(100.0)
    found = sparsification(np.full(100, 0.4), error)
    np.testing.assert_allclose(found.rmse_m, found.random_rmse_m)


@given(pixels, st.integers(0, 9))
def test_no_confidence_beats_the_oracle(drawn, tenths) -> None:
    confidence, error = np.array(drawn).T
    found = sparsification(confidence, error, (0.0, tenths / 10))
    assert (found.rmse_m >= found.oracle_rmse_m - 1e-9).all()
    assert found.rmse_m[0] == pytest.approx(found.random_rmse_m)
    shuffled = np.random.default_rng(0).permutation(len(error))
    again = sparsification(confidence[shuffled], error[shuffled], (0.0, tenths / 10))
    np.testing.assert_allclose(found.rmse_m, again.rmse_m, rtol=1e-9)


def test_learned_range_leaves_unknown_depth_out() -> None:
    near, far = learned_range(np.array([0.0, 0.5, np.nan, 0.9, 0.0]))
    assert (near, far) == pytest.approx((0.48, 0.92))
    with pytest.raises(ValueError, match="no depth of any object"):
        learned_range(np.zeros(4))


def spreads(seed: int, count: int = 10_000):
    """Gaussian errors of known spread, 5 to 50 mm; and what a network would say of them."""
    rng = np.random.default_rng(seed)
    sigma = np.exp(rng.uniform(np.log(0.005), np.log(0.05), count))
    return -np.log(sigma), sigma * rng.standard_normal(count), sigma


def test_a_spread_becomes_the_true_probability_of_gaussian_errors() -> None:
    from scipy.special import erf

    signal, error, _ = spreads(0)
    rule = fit_confidence(signal, error)
    fresh, fresh_error, sigma = spreads(1)
    said = rule(fresh)
    assert np.abs(said - erf(0.02 / (sigma * np.sqrt(2)))).mean() < 0.03
    assert reliability(said, np.abs(fresh_error) < 0.02).expected_error < 0.02


def test_a_rule_computed_by_hand() -> None:
    rule = ConfidenceRule(1.0, 2.0, Calibration((0.0, 1.0), (0.2, 0.8)))
    # (2 - 1) / 2 = 0.5; logistic(0.5) = 0.62246
    assert rule.score(np.array([[2.0]]))[0, 0] == pytest.approx(0.6224593)
    assert rule(np.array([[2.0]]))[0, 0] == pytest.approx(0.2 + 0.6 * 0.6224593)
    flat = ConfidenceRule(0.0, 1.0, Calibration((0.5,), (0.5,)))
    assert list(np.argsort(flat.ordering(np.array([3.0, -3.0, 1.0])))) == [1, 2, 0]


def test_a_rule_survives_json_and_a_wrong_one_is_named() -> None:
    rule = fit_confidence(*spreads(4, 200)[:2], frames=8)
    record = json.loads(json.dumps({**rule.to_dict(), "fitted_on": "more"}))
    assert ConfidenceRule.from_dict(record) == rule
    with pytest.raises(ValueError, match=r"confidence: center: must be a number, got \[1.0, 2.0\]"):
        ConfidenceRule.from_dict(record | {"center": [1.0, 2.0]})
    with pytest.raises(ValueError, match="confidence: scale: must be a number, got nan"):
        ConfidenceRule.from_dict(record | {"scale": math.nan})


def test_what_a_network_says_of_its_answer() -> None:
    restored = torch.tensor([[[True, True, False]]])
    output = SimpleNamespace(restored=restored, spread=torch.tensor([[[0.019, 0.1, 0.0]]]))
    width = signal_of(output)[0, 0]
    assert width[0] == pytest.approx(-np.log(0.019 + FLOOR_M), rel=1e-5)
    assert width[1] < width[0]
    assert width[2] == 0


def test_answers_that_were_never_learned_are_not_restored() -> None:
    depth = torch.tensor([[[0.5, 0.85, 0.0]]])
    output = SimpleNamespace(depth=depth, restored=depth > 0)
    assert within_learned(output, None)[0, 0].tolist() == [True, True, False]
    assert within_learned(output, (0.45, 0.8))[0, 0].tolist() == [True, False, False]
    assert within_learned(output, (0.55, 0.9))[0, 0].tolist() == [False, True, False]
    output.clamped = torch.tensor([[[False, True, True]]])
    assert within_learned(output, None)[0, 0].tolist() == [True, False, False]
