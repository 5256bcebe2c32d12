"""What a robot had before it when it chose a grasp, and how it is drawn."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from hadr.data.samples import samples_dir
from hadr.figures.handover.seen import FirstChoice, draw_choice, draw_choices, first_choice
from hadr.figures.tables.handover import SEEN, partings
from hadr.records.checkout import checkout_root
from hadr.records.result_file import read_result_file
from hadr.simulation.trials.experiment import finished_attempt
from hadr.simulation.trials.trial import Trial
from hadr.synthesis.glass.surfaces import Surface

TRIAL = Trial("0001", 905, condition="perfect")


@pytest.fixture
def choice() -> FirstChoice:
    corners = np.array([[0.6, 0.0, 0.2], [0.7, 0.0, 0.2], [0.6, 0.1, 0.4]])
    truth = Surface(corners, np.array([[0, 1, 2]]), np.tile([0.0, 0.0, 1.0], (3, 1)))
    glass = corners + np.diag([-0.01, -0.03, 0.02])
    hand = np.linspace([0.6, 0.0, 0.2], [0.8, 0.0, 0.3], 21)
    pose = np.eye(4)
    pose[:3, 3] = 0.6, 0.0, 0.3
    return FirstChoice(glass, corners + 0.1, hand, pose, 0.06, truth)


def test_how_far_off_a_cloud_is_is_the_median_to_the_nearest_true_vertex(
    choice: FirstChoice,
) -> None:
    assert choice.off == pytest.approx(0.02)


def test_a_gripper_is_drawn_as_wide_as_it_opens_and_everything_has_a_name(
    choice: FirstChoice, ax: Axes
) -> None:
    draw_choice(ax, choice)
    grasp = next(
        c
        for c in ax.collections
        if isinstance(c, LineCollection) and c.get_label() == "chosen grasp"
    )
    (left, _), (right, _), bar, _ = grasp.get_segments()
    assert np.linalg.norm(bar[1] - bar[0]) == pytest.approx(np.linalg.norm(right - left), rel=0.1)
    assert ax.get_legend_handles_labels()[1] == [
        "taken for the glass", "measured besides", "the hand's keypoints", "chosen grasp",
        "the true glass",
    ]  # fmt: skip


def test_each_kind_of_depth_has_its_column(choice: FirstChoice) -> None:
    end = (np.zeros((8, 9, 3), dtype=np.uint8), "drop after 4.0 s")
    figure = draw_choices({"one": choice, "two": choice}, {"one": end, "two": end})
    axes = figure.axes
    assert [ax.get_title() for ax in axes[:2]] == ["one", "two"]
    assert [ax.get_xlabel() for ax in axes] == 2 * ["glass off by 2.0 cm"] + 2 * [end[1]]
    plt.close(figure)


def test_with_perfect_depth_the_first_choice_is_made_on_the_true_glass() -> None:
    found = first_choice(TRIAL, 0.9)
    assert found.off < 0.005
    fingers = found.keypoints[1:].mean(axis=0)
    middle = found.truth.vertices.mean(axis=0)
    assert np.linalg.norm(fingers - middle) < 0.12  # the hand is around the glass
    tip = found.pose[:3, 3]
    assert np.linalg.norm(found.truth.vertices - tip, axis=1).min() < 0.06


def test_an_attempt_without_a_grasp_has_no_choice() -> None:
    with pytest.raises(ValueError, match=r"no grasp is chosen in the first 0\.10 s of 0001-905"):
        first_choice(TRIAL, 0.1)


def test_the_recordings_of_the_chapter_are_those_of_the_table() -> None:
    table = read_result_file(checkout_root() / "results" / "mini" / "handover.json")
    name = partings(table.rows, SEEN)[0]
    object_id, _, hold = name.partition("-")
    for condition in SEEN:
        trial = Trial(object_id, int(hold), condition=condition)
        row, *_ = finished_attempt(samples_dir() / "handover", trial)
        assert row["verdict"] == table.row(condition=condition)["verdicts"][name]
