from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hadr.camera import Intrinsics
from hadr.figures.depth.corruption_examples import (
    KINDS,
    PLACES,
    CorruptionExample,
    error_kinds,
    error_places,
    kind_shares,
    read_examples,
    write_examples,
)

CAMERA = Intrinsics(40.0, 40.0, 9.5, 5.5, 20, 12)
KEPT = Path(__file__).resolve().parents[3] / "results" / "sensor" / "pictures.npz"
WORDS = {"what": "a test", "provenance": {"commit": "0"}}


@pytest.fixture
def example():
    rng = np.random.default_rng(3)
    depths = [rng.uniform(0, 31, (12, 20)).astype(np.float32) for _ in range(3)]
    depths[0][2:4] = 0
    return CorruptionExample("made up", CAMERA, *depths, rng.random((12, 20)) > 0.5)


def test_what_is_read_is_what_was_written_to_half_a_step(tmp_path, example):
    write_examples(tmp_path / "a.npz", {"one": example, "two": example}, WORDS)
    read = read_examples(tmp_path / "a.npz")
    assert list(read) == ["one", "two"]
    assert read["two"].camera == CAMERA
    assert read["two"].name == "made up"
    for name in ("measured", "truth", "background"):
        np.testing.assert_allclose(
            getattr(read["one"], name), getattr(example, name), atol=0.000252, rtol=0
        )
    assert (read["one"].measured[2:4] == 0).all()
    np.testing.assert_array_equal(read["one"].mask, example.mask)


def test_a_changed_file_and_a_wild_depth_are_refused(tmp_path, example):
    write_examples(tmp_path / "a.npz", {"one": example}, WORDS)
    write_examples(tmp_path / "b.npz", {"one": replace(example, mask=~example.mask)}, WORDS)
    (tmp_path / "a.npz").write_bytes((tmp_path / "b.npz").read_bytes())
    with pytest.raises(ValueError, match=r"is not the file that a\.json speaks of"):
        read_examples(tmp_path / "a.npz")
    wild = replace(example, truth=example.truth + np.float32(32))
    with pytest.raises(ValueError, match=r"truth of 'one' must lie in 0\.\.32 m"):
        write_examples(tmp_path / "c.npz", {"one": wild}, WORDS)


def test_kinds_of_a_row_made_by_hand():
    truth = np.array([[0.6, 0.6, 0.6, 0.6, 0.6, 0.6, 0.6, 0.0, np.nan]])
    measured = np.array([[0.0, np.nan, 0.58, 0.605, 0.63, 0.7, 2.0, 0.6, 0.6]])
    kinds = error_kinds(measured, truth)
    assert kinds.tolist() == [[0, 0, 1, 2, 3, 4, 5, -1, -1]]
    everywhere = np.ones(truth.shape, bool)
    np.testing.assert_allclose(kind_shares(kinds, everywhere), np.array([2, 1, 1, 1, 1, 1]) / 7)
    assert np.isnan(kind_shares(kinds, ~everywhere)).all()
    assert len(KINDS) == 6


def test_places_of_a_square_before_a_wall():
    truth = np.full((40, 60), 1.0)
    truth[:, 50:] = 1.2  # a jump, far from the glass
    truth[0, 0], truth[39, 0] = 9.0, 0.0
    mask = np.zeros(truth.shape, bool)
    mask[10:20, 10:20] = True
    places = error_places(truth, mask)
    assert tuple(places) == PLACES
    inside, outline, rest = places.values()
    assert inside.sum() == 6 * 6
    assert inside[12:18, 12:18].all()
    assert outline[8:12, 8:22].all()
    assert not outline[7, 15]
    assert outline[30, [48, 51]].all()
    assert not outline[30, [46, 53]].any()
    assert rest[30, 30]
    assert not rest[0, 0], "too far away"
    assert rest[39, 0], "its truth is unknown, so it may count"
    assert (inside.astype(int) + outline + rest).max() == 1


def test_the_kept_frames():
    kept = read_examples(KEPT)
    assert list(kept) == ["real-080", "real-130", "simulated-0", "simulated-1"]
    missing = {}
    for name, example in kept.items():
        known = example.mask & (example.truth > 0)
        missing[name] = float((example.measured[known] == 0).mean())
        behind = example.background[known & (example.background > 0)]
        assert np.median(behind) > np.median(example.truth[known])
    # Those of the whole frames, in the table of the real and the simulated camera.
    assert missing["real-080"] == pytest.approx(0.454, abs=0.01)
    assert missing["real-130"] == pytest.approx(0.746, abs=0.01)
