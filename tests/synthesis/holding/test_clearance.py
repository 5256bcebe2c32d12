import numpy as np
import pytest

from hadr.synthesis.glass.distance import signed_distance
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.holding.clearance import clearance_table, hollow_distance


def test_distances_of_a_finger_in_the_mouth():
    """In the hollow of the beaker: the distance from its wall; outside: how far it is through."""
    item = glass_object("0005")
    z = item.height / 2
    outer = item.outer_radius(z)
    ray = np.stack([np.linspace(0.02, 0.05, 301), np.zeros(301), np.full(301, z)], axis=1)
    glass = signed_distance(item, ray)
    inner = ray[np.flatnonzero(glass < 0)[0], 0]
    assert 0.001 < outer - inner < 0.004
    np.testing.assert_allclose(hollow_distance(item, ray), inner - ray[:, 0], atol=2e-4)
    above = hollow_distance(item, np.array([[0.0, 0, item.height + 0.02], [0.2, 0, 0.2]]))
    assert (above > 0.01).all()


@pytest.mark.parametrize("object_id", ["0001", "0005", "0008"])
def test_the_tables_agree_with_the_exact_distance(object_id):
    rng = np.random.default_rng(4)
    item = glass_object(object_id)
    points = rng.uniform([-0.07, -0.05, -0.02], [0.08, 0.05, item.height + 0.02], (4000, 3))
    table = clearance_table(object_id)
    exact = signed_distance(item, points, filled=True)
    near = np.abs(exact) < 0.012
    around = table.around(points.astype(np.float32))
    # The beaker's spout is not in the table; the final check is exact.
    assert np.quantile(np.abs(around - exact)[near], 0.95) < 0.0008
    free = exact > 0.001
    glass = signed_distance(item, points)
    close = free & (glass < 0.012)
    said = table.glass_near(points.astype(np.float32), around)
    assert np.abs(said - glass)[close].mean() < 0.0004
    # Nothing can be touched at the closed mouth.
    mouth = np.array([[0.0, 0.0, item.height + 0.0005]], dtype=np.float32)
    assert table.around(mouth)[0] < 0.002
    assert table.glass_near(mouth, table.around(mouth))[0] > 0.02
