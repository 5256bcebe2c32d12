import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hadr.synthesis.glass.shape import rounded_path, subdivided


def test_a_right_angle_rounded_with_2_by_hand():
    """The arc begins 2 before the corner, ends 2 behind it, and its centre is (8, 2)."""
    path = rounded_path(((0, 0), (10, 0, 2), (10, 10)), 100.0)
    np.testing.assert_allclose(path[[0, 1, -2, -1]], [[0, 0], [8, 0], [10, 2], [10, 10]])
    np.testing.assert_allclose(np.linalg.norm(path[1:-1] - [8, 2], axis=1), 2.0)
    angles = np.arctan2(*(path[1:-1] - [8, 2]).T[::-1])
    assert (np.diff(angles) > 0).all()
    assert np.rad2deg(np.diff(angles)).max() <= 11.0


def test_without_a_radius_a_corner_is_as_round_as_fits_and_too_large_a_radius_shrinks():
    free = rounded_path(((0, 0), (4, 0), (4, 10)), 100.0)
    np.testing.assert_allclose(free[1], [4 - 0.499 * 4, 0])  # half of the shorter line
    np.testing.assert_allclose(rounded_path(((0, 0), (4, 0, 50), (4, 10)), 100.0), free)


def test_a_radius_of_0_and_a_straight_corner_stay_points():
    corners = ((0, 0), (1, 0), (3, 0, 0.0), (3, 2))
    np.testing.assert_allclose(
        rounded_path(corners, 10.0), [[0, 0], [1, 0], [3, 0], [3, 2]], atol=1e-12
    )


@given(st.floats(-1.2, 1.2), st.floats(0.05, 0.4))
def test_an_arc_leaves_both_lines_as_a_tangent(turn, radius):
    """No kink at its ends: directions change by one step of the arc at most."""
    end = (2 + 2 * np.cos(turn), 2 * np.sin(turn))
    path = rounded_path(((0, 0), (2, 0, radius), end), 100.0)
    steps = np.diff(path, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert headings[-1] == pytest.approx(turn, abs=1e-6)
    assert np.abs(np.diff(headings)).max(initial=0.0) <= np.deg2rad(11.0) + 1e-9


def test_long_pieces_are_split_and_finer_in_a_band():
    path = np.array([[0.0, 0.0], [0.0, 3.0], [0.0, 4.0]])
    np.testing.assert_allclose(subdivided(path, 1.0)[:, 1], [0, 1, 2, 3, 4])
    finer = subdivided(path, 1.0, [(3.2, 3.4, 0.25)])
    np.testing.assert_allclose(finer[:, 1], [0, 1, 2, 3, 3.25, 3.5, 3.75, 4])


def test_what_is_no_path_is_named():
    with pytest.raises(ValueError, match=r"two corners at least, got \(\(0, 0\),\)"):
        rounded_path(((0, 0),), 1.0)
    with pytest.raises(ValueError, match="corner 2 repeats the one before"):
        rounded_path(((0, 0), (1, 0), (1, 0), (2, 0)), 1.0)
