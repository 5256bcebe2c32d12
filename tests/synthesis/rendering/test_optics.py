import numpy as np
import pytest

from hadr.synthesis.rendering.optics import GLASS_INDEX, reflect, refract


def test_snell_and_fresnel_by_hand():
    angle = np.deg2rad(40.0)
    direction = np.array([[np.sin(angle), 0, np.cos(angle)]])
    normal = np.array([[0, 0, -1.0]])
    bent, share = refract(direction, normal, np.array([1 / 1.5]))
    assert bent[0, 0] == pytest.approx(np.sin(angle) / 1.5)
    straight, normal_share = refract(np.array([[0, 0, 1.0]]), normal, np.array([1 / 1.5]))
    np.testing.assert_allclose(straight, [[0, 0, 1.0]])
    assert normal_share[0] == pytest.approx(0.04)  # ((1.5 - 1) / (1.5 + 1))^2
    # s: -sin(i - t)/sin(i + t), p: tan(i - t)/tan(i + t)
    out = np.arcsin(np.sin(angle) / 1.5)
    s = np.sin(angle - out) / np.sin(angle + out)
    p = np.tan(angle - out) / np.tan(angle + out)
    assert share[0] == pytest.approx((s**2 + p**2) / 2)


def test_total_reflection_begins_at_the_critical_angle():
    critical = np.arcsin(1 / GLASS_INDEX)
    for angle, total in ((critical - 0.01, False), (critical + 0.01, True)):
        direction = np.array([[np.sin(angle), 0, np.cos(angle)]])
        _, share = refract(direction, np.array([[0, 0, -1.0]]), np.array([GLASS_INDEX]))
        assert bool(share[0] == 1.0) == total
    np.testing.assert_allclose(
        reflect(np.array([[0.6, 0, 0.8]]), np.array([[0, 0, -1.0]])), [[0.6, 0, -0.8]]
    )
