"""Sections of the glasses, and sheets of objects and holds."""

import numpy as np
import pytest

from hadr.figures.solids.glasses import draw_hold_sheet, draw_objects, glass_section
from hadr.synthesis.glass.distance import signed_distance
from hadr.synthesis.glass.objects import OBJECTS, glass_object
from hadr.synthesis.holding.hold import make_hold


def area(outline):
    x, z = outline.T
    return 0.5 * float(x @ np.roll(z, -1) - z @ np.roll(x, -1))


@pytest.mark.parametrize("object_id", ["0000", "0001", "0008"])
def test_a_section_lies_on_the_surface_and_its_area_is_that_of_the_glass(object_id):
    item = glass_object(object_id)
    outlines = glass_section(item)
    x, z = np.concatenate(outlines).T
    on_plane = np.stack([x, np.zeros_like(x), z], axis=1)
    assert np.abs(signed_distance(item, on_plane)).max() < 6e-4
    assert z.min() == pytest.approx(0.0, abs=1e-3)
    assert z.max() == pytest.approx(item.height, abs=1e-3)
    # The same area, counted on a grid.
    grid = np.stack(
        np.meshgrid(np.arange(-0.12, 0.12, 0.0005), [0.0], np.arange(0.0, 0.23, 0.0005)), -1
    )
    inside = signed_distance(item, grid.reshape(-1, 3)) < 0
    assert sum(area(p) for p in outlines) == pytest.approx(inside.sum() * 0.0005**2, rel=0.06)


def test_objects_stand_in_a_grid_with_their_names():
    items = [glass_object(i) for i in list(OBJECTS)[:5]]
    fig = draw_objects(items, {items[1].object_id: "unknown"}, columns=3, pixels=48)
    titles = [ax.get_title() for ax in fig.axes if ax.get_title()]
    assert titles[0] == f"{items[0].object_id} {items[0].name}"
    assert titles[1].endswith("(unknown)")
    assert len([ax for ax in fig.axes if ax.images]) == 5
    picture = fig.axes[0].images[0]
    low, high = picture.get_extent()[2:]
    assert (low + high) / 2 == pytest.approx(50 * items[0].height)
    widths = {round(np.ptp(ax.get_xlim()), 6) for ax in fig.axes if ax.images}
    assert len(widths) == 1, "one scale for all"


def test_a_sheet_of_holds_names_kinds_and_rows():
    holds = [[make_hold("0000", n, 0) for n in range(2)], [make_hold("0009", 0, 0)]]
    fig = draw_hold_sheet(holds, ["tumbler", "bowl"], pixels=32)
    shown = [ax for ax in fig.axes if ax.images]
    assert [ax.get_title() for ax in shown] == [*(h.kind for row in holds for h in row), ""]
    assert [ax.get_ylabel() for ax in fig.axes if ax.get_ylabel()] == ["tumbler", "bowl"]
