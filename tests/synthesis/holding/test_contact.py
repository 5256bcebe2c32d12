from dataclasses import replace

import numpy as np

from hadr.hand import ANGLE_NAMES, HandShape
from hadr.synthesis.glass.distance import signed_distance
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.holding.contact import check_contact, passes_through_wall
from hadr.synthesis.holding.hold import check_hold, make_hold


def test_a_hand_pushed_into_the_wall_is_found():
    hold = make_hold("0005", 1)  # a power hold: its palm lies on the wall
    toward = hold.wrist_from_object[:3, 3] * 0
    toward[2] = -1.0
    for depth, found in ((0.0, False), (0.006, True), (0.02, True), (0.045, True)):
        pose = hold.wrist_from_object.copy()
        pose[:3, 3] += depth * toward
        report = check_hold(replace(hold, wrist_from_object=pose))
        assert any("deep in the glass" in p for p in report.problems) == found
        # A thin wall is passed at 20 mm and more: the filled object says how far.
        assert report.depth >= min(depth, 0.03) - 0.003


def test_a_hand_drawn_away_has_no_contact():
    hold = make_hold("0005", 1)
    pose = hold.wrist_from_object.copy()
    pose[:3, 3] += [0, 0, 0.2]
    report = check_hold(replace(hold, wrist_from_object=pose))
    assert report.problems[0].startswith("no two fingers with thumb or palm touch (gaps in mm: th")
    assert report.depth == 0
    assert report.touching == ()


def test_angles_beyond_the_limits_and_overlapping_fingers_are_named():
    hold = make_hold("0005", 1)
    angles = hold.angles.copy()
    angles[ANGLE_NAMES.index("ring_pip_stretch")] = np.deg2rad(120)
    assert any(
        p == "beyond the limits: ring_pip_stretch"
        for p in check_hold(replace(hold, angles=angles)).problems
    )
    crossed = np.zeros(20)
    crossed[ANGLE_NAMES.index("index_mcp_spread")] = np.deg2rad(-20)
    crossed[ANGLE_NAMES.index("middle_mcp_spread")] = np.deg2rad(20)
    far = np.eye(4)
    far[:3, 3] = 1.0
    report = check_contact("0000", HandShape(), crossed, far)
    assert report.overlap > 0.003
    assert any(p.startswith("fingers overlap by") for p in report.problems)
    assert check_contact("0000", HandShape(), np.zeros(20), far).overlap < 0.003


def test_skin_through_a_wall_is_told_from_skin_over_the_rim():
    """Two points, one in the hollow and one outside, joined through the wall or above it."""
    item = glass_object("0005")
    rim, r = item.height, item.outer_radius(0.05)
    inside, outside = [r - 0.006, 0, 0.05], [r + 0.004, 0, 0.05]
    assert passes_through_wall(item, np.array([inside, outside]), np.array([[0, 1]]))
    over = [[r - 0.006, 0, z] for z in np.arange(0.05, rim + 0.012, 0.004)]
    over += [[r + 0.006, 0, z] for z in np.arange(rim + 0.012, 0.05, -0.004)]
    edges = np.stack([np.arange(len(over) - 1), np.arange(1, len(over))], axis=1)
    assert not passes_through_wall(item, np.array(over), edges)
    # A point in the middle of the wall does not hide the way through.
    wall = signed_distance(item, np.array([[x, 0, 0.05] for x in np.linspace(r - 0.003, r, 61)]))
    middle = [r - 0.003 + 0.003 * wall.argmin() / 60, 0, 0.05]
    three = np.array([inside, middle, outside])
    assert passes_through_wall(item, three, np.array([[0, 1], [1, 2]]))
    assert not passes_through_wall(item, np.array([outside, [0.2, 0, 0]]), np.array([[0, 1]]))
