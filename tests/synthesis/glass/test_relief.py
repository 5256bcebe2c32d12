import numpy as np
import pytest

from hadr.synthesis.glass.relief import facets, marks, spout, thread


def array(*values):
    return np.array(values, dtype=float)


def test_facets_never_reach_beyond_the_body_and_end_at_their_top():
    ground = facets(10, 0.030, 0.05, 0.05)
    angle, z = np.meshgrid(np.linspace(0, 6, 50), np.linspace(0, 0.1, 41))
    shift = ground.shift(angle, z, np.full(z.shape, 0.031))
    assert (shift <= 0).all()
    assert (shift[z >= 0.05] == 0).all()
    assert shift.min() < -0.0005


def test_a_thread_climbs_by_its_pitch():
    ridge = thread(0.10, 0.004, 2.0, 0.001, 0.0012)
    z = np.linspace(0.098, 0.112, 2801)
    for lap in (0.5, 1.0, 1.5):
        shift = ridge.shift(np.full(z.shape, 2 * np.pi * lap), z, np.full(z.shape, 0.02))
        ridges = z[shift > 0.000999]
        assert np.abs(ridges - (0.10 + 0.004 * lap)).min() < 1e-5
    behind = ridge.shift(np.full(z.shape, np.pi), z, np.full(z.shape, 0.02))
    peaks = z[1:-1][(behind[1:-1] > behind[:-2]) & (behind[1:-1] > behind[2:])]
    np.testing.assert_allclose(peaks, [0.102, 0.106], atol=1e-5)  # half a turn, one and a half
    # It begins and ends in the smooth neck, and joins itself across angle 0.
    assert ridge.shift(array(0.0), array(0.10), array(0.02))[0] == 0
    across = ridge.shift(array(-1e-9, 1e-9), array(0.104, 0.104), array(0.02, 0.02))
    assert across[0] == pytest.approx(across[1], abs=1e-9)


def test_a_spout_is_drawn_out_at_angle_0_alone():
    lip = spout(0.006, 0.4, 0.09, 0.10)
    at = lip.shift(array(0, 0.4, -0.4, np.pi, 0), array(0.1, 0.1, 0.1, 0.1, 0.09), array(0.04))
    np.testing.assert_allclose(at, [0.006, 0, 0, 0, 0], atol=1e-15)
    assert lip.through


def test_marks_are_long_and_short_by_turns():
    lines = marks((0.02, 0.03), 1.0, 0.6)
    angle = np.linspace(0, 2 * np.pi, 3601)
    lengths = []
    for height in (0.02, 0.03):
        shift = lines.shift(angle, np.full(angle.shape, height), np.full(angle.shape, 0.03))
        assert shift.max() == pytest.approx(0.0004)
        raised = angle[shift > 0.0002]
        assert raised.min() == pytest.approx(1.03, abs=0.003)
        lengths.append(np.ptp(raised))
    np.testing.assert_allclose(lengths, [0.24, 0.54], atol=0.004)
    between = lines.shift(angle, np.full(angle.shape, 0.025), np.full(angle.shape, 0.03))
    assert (between == 0).all()
