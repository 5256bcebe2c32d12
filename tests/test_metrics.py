import json
import math
import re
from dataclasses import make_dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hadr import metrics
from hadr.frame_io import read_depth
from hadr.metrics import (
    DepthMetrics,
    best_in_bold,
    depth_errors,
    format_table,
    frame_metrics,
    mean_over_frames,
    pooled,
)

#: Truth 1 m everywhere; predictions off by 0, 4, -20 and 30 cm.
TRUTH = np.ones((2, 2))
PREDICTED = np.array([[1.0, 1.04], [0.8, 1.3]])
EVERYWHERE = np.ones((2, 2), dtype=bool)

depths = arrays(np.float64, (3, 4), elements=st.floats(0.05, 5.0))


def test_hand_computed_frame():
    m = frame_metrics(PREDICTED, TRUTH, EVERYWHERE)
    assert m.rmse_m == pytest.approx(math.sqrt((0.04**2 + 0.2**2 + 0.3**2) / 4))
    assert m.mae_m == pytest.approx((0.04 + 0.2 + 0.3) / 4)
    assert m.rel == pytest.approx(m.mae_m)
    # 1/0.8 = 1.25 is not below 1.25: the threshold is strict.
    assert (m.delta_105, m.delta_110, m.delta_125) == (50.0, 50.0, 50.0)
    assert (m.pixels, m.coverage, m.frames, m.averaging) == (4, 1.0, 1, "frame")


def test_delta_is_a_ratio_and_not_a_relative_difference():
    # 1.05 m seen as 1 m: off by 4.8 % of the truth, but the ratio is 1.05 and must fail.
    m = frame_metrics(np.array([[1.0]]), np.array([[1.05]]), np.array([[True]]))
    assert m.rel == pytest.approx(0.05 / 1.05)
    assert m.delta_105 == 0.0
    assert m.delta_110 == 100.0


def test_mask_and_invalid_truth_leave_pixels_out():
    truth = np.array([[1.0, 0.0], [np.nan, 2.0]])
    predicted = np.array([[1.5, 9.0], [9.0, 9.0]])
    mask = np.array([[True, True], [True, False]])
    m = frame_metrics(predicted, truth, mask)
    assert (m.pixels, m.coverage) == (1, 1.0)
    assert m.mae_m == pytest.approx(0.5)


@pytest.mark.parametrize("hole", [0.0, np.nan])
def test_policies_for_a_missing_prediction(hole):
    truth = np.array([[1.0, 2.0, 4.0]])
    predicted = np.array([[1.5, 2.0, hole]])
    mask = np.ones((1, 3), dtype=bool)

    left_out = frame_metrics(predicted, truth, mask)
    assert left_out.mae_m == pytest.approx(0.25)
    assert left_out.delta_105 == 50.0
    assert left_out.pixels == 2

    as_zero = frame_metrics(predicted, truth, mask, missing="zero")
    assert as_zero.mae_m == pytest.approx((0.5 + 0.0 + 4.0) / 3)
    assert as_zero.rel == pytest.approx((0.5 + 0.0 + 1.0) / 3)
    assert as_zero.delta_125 == pytest.approx(100 / 3)
    assert as_zero.pixels == 3

    assert left_out.coverage == as_zero.coverage == pytest.approx(2 / 3)
    with pytest.raises(ValueError, match="1 of 3 pixels of the mask have no predicted depth"):
        frame_metrics(predicted, truth, mask, missing="error")


def test_negative_prediction_is_scored_and_fails_every_delta():
    one = np.array([[True]])
    m = frame_metrics(np.array([[-1.0]]), np.array([[1.0]]), one, missing="error")
    assert m.mae_m == pytest.approx(2.0)
    assert m.delta_125 == 0.0


def test_nothing_predicted_gives_nan_and_no_coverage():
    m = frame_metrics(np.zeros((2, 2)), TRUTH, EVERYWHERE)
    assert m.pixels == 0
    assert m.coverage == 0.0
    assert all(math.isnan(v) for v in (m.rmse_m, m.rel, m.mae_m, m.delta_105))


def test_depth_errors_are_signed_and_nan_where_not_scored():
    truth = np.array([[1.0, 1.0, 0.0, 1.0]])
    predicted = np.array([[1.25, 0.75, 1.0, np.nan]], dtype=np.float32)
    mask = np.array([[True, True, True, True]])
    np.testing.assert_allclose(
        depth_errors(predicted, truth, mask), [[0.25, -0.25, np.nan, np.nan]]
    )
    np.testing.assert_allclose(
        depth_errors(predicted, truth, mask, missing="zero"), [[0.25, -0.25, np.nan, -1.0]]
    )


def test_float32_images_are_summed_in_double():
    truth = np.full((1000, 1000), 0.7, dtype=np.float32)
    predicted = truth + np.float32(0.001)
    mask = np.ones(truth.shape, dtype=bool)
    exact = float(predicted[0, 0]) - float(truth[0, 0])
    assert frame_metrics(predicted, truth, mask).mae_m == pytest.approx(exact, rel=1e-12)


def two_frames():
    # Frame A: one pixel, off by 30 cm. Frame B: three pixels, off by 10 cm. Truth 1 m.
    a = (np.array([[1.3, 0.0, 0.0]]), np.ones((1, 3)), np.array([[True, False, False]]))
    b = (np.full((1, 3), 1.1 - 1e-9), np.ones((1, 3)), np.ones((1, 3), dtype=bool))
    return a, b


def test_pooled_differs_from_the_mean_over_frames_by_hand():
    a, b = two_frames()
    mean = mean_over_frames([frame_metrics(*a), frame_metrics(*b)])
    assert mean.rmse_m == pytest.approx((0.3 + 0.1) / 2)
    assert mean.mae_m == pytest.approx(0.2)
    assert mean.delta_110 == 50.0
    assert (mean.pixels, mean.frames, mean.averaging) == (4, 2, "per-frame mean")

    pool = pooled([a, b])
    assert pool.rmse_m == pytest.approx(math.sqrt((0.09 + 3 * 0.01) / 4))
    assert pool.mae_m == pytest.approx((0.3 + 3 * 0.1) / 4)
    assert pool.delta_110 == 75.0
    assert (pool.pixels, pool.frames, pool.averaging) == (4, 2, "pooled")


def test_pooled_takes_frames_of_different_sizes_and_an_iterator():
    small = (np.array([[2.0]]), np.array([[1.0]]), np.array([[True]]))
    pool = pooled(iter([small, (PREDICTED, TRUTH, EVERYWHERE)]))
    assert pool.pixels == 5
    assert pool.mae_m == pytest.approx((1.0 + 0.54) / 5)


def test_frames_without_a_prediction_lower_the_coverage_only():
    empty = frame_metrics(np.zeros((2, 2)), TRUTH, EVERYWHERE)
    full = frame_metrics(PREDICTED, TRUTH, EVERYWHERE)
    mean = mean_over_frames([empty, full])
    assert mean.rmse_m == pytest.approx(full.rmse_m)
    assert (mean.frames, mean.coverage) == (1, 0.5)
    pool = pooled([(np.zeros((2, 2)), TRUTH, EVERYWHERE), (PREDICTED, TRUTH, EVERYWHERE)])
    assert (pool.frames, pool.coverage) == (1, 0.5)
    nothing = mean_over_frames([empty])
    assert math.isnan(nothing.rmse_m)
    assert nothing.frames == 0


def test_averages_are_never_mixed():
    one = frame_metrics(PREDICTED, TRUTH, EVERYWHERE)
    pool = pooled([(PREDICTED, TRUTH, EVERYWHERE)])
    with pytest.raises(ValueError, match="expected single frames' metrics, got 'pooled' ones"):
        mean_over_frames([one, pool])
    with pytest.raises(ValueError, match="must not mix averages, got per-frame mean and pooled"):
        format_table({"a": mean_over_frames([one]), "b": pool})


def test_format_table():
    a, b = two_frames()
    text = format_table(
        {"hadr": pooled([a, b]), "hole": pooled([(np.zeros((2, 2)), TRUTH, EVERYWHERE)])}
    )
    lines = [re.sub(" +", " ", line) for line in text.splitlines()]
    assert lines[0].startswith("| method | RMSE (cm) | REL (%) | MAE (cm) | δ1.05 (%) |")
    assert lines[2] == "| hadr | 17.32 | 15.00 | 15.00 | 0.00 | 75.00 | 75.00 | 100.0 |"
    assert lines[3] == "| hole | – | – | – | – | – | – | 0.0 |"
    assert lines[-1] == "Pooled over the pixels of 0 to 2 frames."
    one = frame_metrics(PREDICTED, TRUTH, EVERYWHERE)
    assert format_table({"a": one}).endswith("Over the pixels of one frame.")
    mean = mean_over_frames([one, one])
    assert format_table({"a": mean}).endswith("Mean of the frames' numbers, 2 frames.")
    with pytest.raises(ValueError, match="no rows"):
        format_table({})


def test_the_best_of_those_that_compete_is_bold():
    table = pd.DataFrame(
        [["a", "2.0 ± 0.1", "9.1", "3/8", "1"], ["b", "1.5 ± 0.3", "10.0", "2/8", "2"],
         ["truth", "0.0", "100.0", "8/8", "0"], ["c", "-", "–", "", "3"]],
        columns=["method", "RMSE (cm)", "δ1.05 (%)", "> 0.5", "weights"],
    )  # fmt: skip
    shown = best_in_bold(table, [[0, 1, 3]])
    assert shown.to_numpy().tolist() == [
        ["a", "2.0 ± 0.1", "9.1", "**3/8**", "1"],
        ["b", "**1.5 ± 0.3**", "**10.0**", "2/8", "2"],
        ["truth", "0.0", "100.0", "8/8", "0"], ["c", "-", "–", "", "3"],
    ]  # fmt: skip
    assert "**" not in "".join(table.to_numpy().ravel())
    apart = best_in_bold(table, [[0], [1, 2]])  # the best of one is none
    assert list(apart["RMSE (cm)"][:3]) == ["2.0 ± 0.1", "1.5 ± 0.3", "**0.0**"]
    far, near = two_frames()
    rows = {"far": frame_metrics(*far), "near": frame_metrics(*near)}
    assert format_table(rows, best=rows).count("**") == 10  # all but δ1.05, which is 0 for both
    assert "**" not in format_table(rows)


def test_a_new_metric_needs_a_row_and_a_field(monkeypatch):
    monkeypatch.setitem(
        metrics.METRICS, "worst_m", metrics.Metric("worst", 1, lambda p, t: np.abs(p - t) > 0.25)
    )
    monkeypatch.setattr(
        metrics,
        "DepthMetrics",
        make_dataclass("More", ["worst_m"], bases=(DepthMetrics,), kw_only=True, frozen=True),
    )
    one = frame_metrics(PREDICTED, TRUTH, EVERYWHERE)
    assert one.worst_m == mean_over_frames([one]).worst_m == 0.25
    assert pooled([(PREDICTED, TRUTH, EVERYWHERE)]).worst_m == 0.25
    assert re.search(r"\bworst\b", format_table({"a": one}))


def test_to_dict_is_json_without_nan():
    empty = frame_metrics(np.zeros((2, 2)), TRUTH, EVERYWHERE)
    values = json.loads(json.dumps(empty.to_dict(), allow_nan=False))
    assert values["rmse_m"] is None
    assert values["pixels"] == 0
    assert values["averaging"] == "frame"
    assert set(values) == set(DepthMetrics.__dataclass_fields__)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"predicted": np.ones((2, 2, 1))},
            r"predicted must be \(H, W\) float metres, got \(2, 2, 1\)",
        ),
        ({"truth": np.full((2, 2), 700, np.uint16)}, r"truth must be .* got \(2, 2\) uint16"),
        ({"predicted": np.ones((2, 3))}, r"predicted has shape \(2, 3\), but truth has \(2, 2\)"),
        ({"mask": np.ones((3, 2), bool)}, r"mask must be \(2, 2\) bool, got \(3, 2\) bool"),
        (
            {"mask": np.full((2, 2), 255, np.uint8)},
            r"mask must be \(2, 2\) bool, got \(2, 2\) uint8",
        ),
        ({"mask": np.zeros((2, 2), bool)}, "nothing to score: the mask selects 0 pixels"),
        ({"truth": np.zeros((2, 2))}, "the mask selects 4 pixels, none with a true depth"),
        ({"predicted": np.full((2, 2), np.inf)}, "infinite depth inside the mask"),
        ({"missing": "ignore"}, "missing must be one of .* got 'ignore'"),
    ],
)
def test_bad_input_is_named(change, message):
    given_input = {"predicted": PREDICTED, "truth": TRUTH, "mask": EVERYWHERE, "missing": "exclude"}
    given_input |= change
    missing = given_input.pop("missing")
    for function in (frame_metrics, depth_errors):
        with pytest.raises(ValueError, match=message):
            function(**given_input, missing=missing)


def test_no_frames():
    with pytest.raises(ValueError, match="no frames to average over"):
        mean_over_frames([])
    with pytest.raises(ValueError, match="no frames to pool"):
        pooled([])


@given(st.lists(st.tuples(depths, depths), min_size=1, max_size=4))
def test_pooled_is_the_metric_of_the_concatenated_pixels(frames):
    mask = np.ones((3, 4), dtype=bool)
    pool = pooled([(p, t, mask) for p, t in frames])
    p, t = (np.concatenate([f[i] for f in frames]) for i in (0, 1))
    joined = frame_metrics(p, t, np.ones(t.shape, dtype=bool))
    assert pool.rmse_m == pytest.approx(joined.rmse_m)
    assert pool.rel == pytest.approx(joined.rel)
    assert pool.delta_110 == pytest.approx(joined.delta_110)
    assert pool.pixels == joined.pixels


@pytest.mark.parametrize(
    ("scene", "pixels", "published"),
    [
        ("000000080", 55288, (".060429", ".099972", ".050076", "29.9613", "51.9986", "97.7319")),
        ("000000130", 11478, (".030019", ".035260", ".022731", "71.7285", "96.6109", "100")),
    ],
)
def test_published_values_of_a_real_camera_on_glass(realdata: Path, scene, pixels, published):
    folder = realdata / "cleargrasp_d435"
    measured = read_depth(folder / f"{scene}-transparent-depth-img.exr")
    truth = read_depth(folder / f"{scene}-opaque-depth-img.exr")
    mask = cv2.imread(str(folder / f"{scene}-mask.png"), cv2.IMREAD_UNCHANGED) > 0
    m = frame_metrics(measured, truth, mask)
    assert m.pixels == pixels
    values = (m.rmse_m, m.rel, m.mae_m, m.delta_105, m.delta_110, m.delta_125)
    for value, printed in zip(values, published, strict=True):
        digits = len(printed.partition(".")[2])
        assert round(value, digits) == float(printed)
