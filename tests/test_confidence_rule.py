import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hadr.confidence import Calibration, reliability
from hadr.confidence_rule import ConfidenceRule, fit_confidence, ordering


def pixels(seed: int, frames: int = 40, each: int = 250):
    """Errors whose spread is known: sigma grows from 5 to 50 mm, and -log(sigma) is the signal.

    A second signal is noise, a third says the same as the first with noise on it.
    """
    rng = np.random.default_rng(seed)
    count = frames * each
    sigma = np.exp(rng.uniform(np.log(0.005), np.log(0.05), count))
    signals = {
        "spread": -np.log(sigma),
        "noise": rng.standard_normal(count),
        "hint": -np.log(sigma) + rng.standard_normal(count),
    }
    return signals, sigma * rng.standard_normal(count), np.repeat(np.arange(frames), each), sigma


def test_it_finds_the_true_probability_of_gaussian_errors() -> None:
    from scipy.special import erf

    signals, error, frame, _ = pixels(0)
    rule, _ = fit_confidence(signals, error, frame)
    fresh, fresh_error, _, sigma = pixels(1)
    said = rule(fresh)
    true = erf(0.02 / (sigma * np.sqrt(2)))
    assert np.abs(said - true).mean() < 0.03
    assert reliability(said, np.abs(fresh_error) < 0.02).expected_error < 0.02


def test_cross_validation_prefers_the_signal_that_knows_and_ranks_noise_last() -> None:
    signals, error, frame, _ = pixels(2)
    rule, options = fit_confidence(signals, error, frame)
    assert "spread" in rule.signals
    assert [o.signals for o in options][-1] == ("noise",)
    assert options[0].signals == rule.signals
    by = {o.signals: o for o in options}
    assert set(by) == {("spread",), ("noise",), ("hint",), ("spread", "noise", "hint")}
    rmse = np.sqrt(np.mean(error**2))
    assert by[("noise",)].rmse_at_90_m == pytest.approx(rmse, rel=0.03), "noise drops by chance"
    assert by[("spread",)].rmse_at_90_m < 0.92 * rmse
    assert by[("spread",)].log_loss < by[("hint",)].log_loss < by[("noise",)].log_loss


def test_a_signal_that_lies_gets_no_weight() -> None:
    signals, error, frame, _ = pixels(3)
    rule, options = fit_confidence(
        {"spread": signals["spread"], "liar": -signals["hint"]}, error, frame
    )
    both = next(o for o in options if len(o.signals) == 2)
    alone = next(o for o in options if o.signals == ("spread",))
    assert both.mean_rmse_m == pytest.approx(alone.mean_rmse_m, rel=1e-3)
    assert min(rule.weights) >= 0


@given(
    st.lists(st.floats(-5, 5), min_size=2, max_size=2),
    st.lists(st.floats(0, 5), min_size=2, max_size=2),
    st.tuples(st.floats(0, 3), st.floats(0, 3)),
)
def test_surer_signals_never_make_it_less_sure(at, step, weights) -> None:
    calibration = Calibration((0.1, 0.4, 0.8), (0.2, 0.5, 0.9))
    rule = ConfidenceRule(("a", "b"), (0.5, -1.0), (2.0, 0.5), weights, calibration)
    low, high = (
        {k: np.array([v]) for k, v in zip("ab", x, strict=True)} for x in (at, np.add(at, step))
    )
    assert rule(low)[0] <= rule(high)[0]
    assert rule(low)[0] >= 0.2
    assert rule(high)[0] <= np.float32(0.9)


def test_a_rule_computed_by_hand() -> None:
    calibration = Calibration((0.0, 1.0), (0.2, 0.8))
    rule = ConfidenceRule(("a", "b"), (1.0, 10.0), (2.0, 5.0), (3.0, 0.5), calibration)
    # 3 * (2 - 1) / 2 + 0.5 * (0 - 10) / 5 = 0.5; logistic(0.5) = 0.62246
    given_signals = {"a": np.array([[2.0]]), "b": np.array([[0.0]])}
    assert rule.score(given_signals)[0, 0] == pytest.approx(0.6224593)
    assert rule(given_signals)[0, 0] == pytest.approx(0.2 + 0.6 * 0.6224593)
    assert rule(given_signals).shape == (1, 1)


def test_a_rule_survives_json() -> None:
    signals, error, frame, _ = pixels(4, frames=8)
    rule, _ = fit_confidence(signals, error, frame)
    record = json.loads(json.dumps({**rule.to_dict(), "fitted_on": "more"}))
    assert ConfidenceRule.from_dict(record) == rule


def test_equal_probabilities_are_ordered_by_their_score() -> None:
    order = ordering(np.array([0.5, 0.5, 0.6]), np.array([0.9, 0.1, 0.2]))
    assert list(np.argsort(order)) == [1, 0, 2]


def test_unusable_input_is_named() -> None:
    signals, error, frame, _ = pixels(5, frames=3, each=10)
    calibration = Calibration((0.5,), (0.5,))
    with pytest.raises(ValueError, match=r"must all be \(N,\), N > 0, got .*'frame': \(29,\)"):
        fit_confidence(signals, error, frame[1:])
    with pytest.raises(ValueError, match="at least 2 frames, got 1"):
        fit_confidence(signals, error, np.zeros_like(frame))
    with pytest.raises(ValueError, match="no signals"):
        fit_confidence({}, error, frame)
    with pytest.raises(ValueError, match="1 values of the signals are not finite"):
        fit_confidence({"a": np.where(np.arange(30) == 3, np.inf, 0.0)}, error, frame)
    with pytest.raises(ValueError, match=r"weights must not be negative .*\(-1.0,\)"):
        ConfidenceRule(("a",), (0.0,), (1.0,), (-1.0,), calibration)
    with pytest.raises(ValueError, match="needs a centre, a scale and a weight, got 2, 1 and 1"):
        ConfidenceRule(("a",), (0.0, 1.0), (1.0,), (1.0,), calibration)
    rule = ConfidenceRule(("spread",), (0.0,), (1.0,), (1.0,), calibration)
    with pytest.raises(ValueError, match="needs the signal 'spread', the network gives network"):
        rule({"network": np.zeros(2)})
