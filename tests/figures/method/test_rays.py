"""Figures of rays and voxels: they show what they are given."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch

from hadr.figures.method.rays import (
    draw_slabs,
    draw_strip,
    draw_walk,
    stages_figure,
    voxel_walk,
    walk_along_ray,
    walk_picture,
)
from hadr.figures.method.voxels import draw_cubes, upright
from hadr.figures.panels import COLORS
from hadr.ray_voxels import VoxelGrid, occupied_voxels, ray_voxel_pairs

GRID = VoxelGrid()


def scene():
    cells = torch.tensor([[4, 4, 3], [4, 4, 4], [4, 4, 7]])
    centers = GRID.center_of(cells, torch.float64)
    occupied = occupied_voxels(centers, torch.zeros(3, dtype=torch.long), GRID, 1)
    directions = torch.tensor([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]], dtype=torch.float64)
    return directions, occupied, ray_voxel_pairs(directions, torch.zeros(2).long(), occupied, GRID)


def test_upright_turns_y_down_to_z_up() -> None:
    assert upright([1.0, 2.0, 3.0]).tolist() == [1.0, 3.0, -2.0]


def test_a_cube_has_twelve_edges_of_its_size() -> None:
    ax = plt.figure().add_subplot(projection="3d")
    draw_cubes(ax, [[0.0, 0.0, 1.0], [0.25, 0.0, 1.0]], 0.25)
    (collection,) = ax.collections
    segments = np.asarray(collection._segments3d)
    assert segments.shape == (24, 2, 3)
    assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) == pytest.approx([0.25] * 24)
    first = segments[:12].reshape(-1, 3)
    assert first.min(axis=0).tolist() == [-0.125, 0.875, -0.125]
    assert first.max(axis=0).tolist() == [0.125, 1.125, 0.125]


@pytest.mark.parametrize(
    ("reached", "dark"), [(0.3, []), (0.7, [0]), (1.0, [1]), (1.3, []), (1.7, [2])]
)
def test_walk_marks_the_candidate_in_which_the_ray_is(ax, reached, dark) -> None:
    directions, occupied, pairs = scene()
    mine = (pairs.ray == 0).nonzero().squeeze(1)
    stay = (pairs.t_in[mine], pairs.t_out[mine])
    centers = occupied.center[pairs.voxel[mine]]
    draw_walk(ax, directions[0], centers, *stay, 0.25, reached=reached)
    opacity = [patch.get_facecolor()[3] for patch in ax.patches]
    assert [k for k, a in enumerate(opacity) if a > 0.4] == dark
    assert len(ax.texts) == sum(float(t) <= reached for t in torch.cat(stay))


def test_strip_has_a_bar_for_each_pair_and_a_star_for_each_ray(ax) -> None:
    _, occupied, pairs = scene()
    draw_strip(ax, pairs, occupied, [0.7, 0.9], [0, 1])
    ends = sorted((p.get_x(), p.get_x() + p.get_width()) for p in ax.patches)
    expected = sorted(zip(pairs.t_in.tolist(), pairs.t_out.tolist(), strict=True))
    assert ends == [pytest.approx(pair) for pair in expected]
    assert [line.get_xdata()[0] for line in ax.lines] == [0.7, 0.9]
    assert {line.get_color() for line in ax.lines} == {COLORS["truth"]}


def test_slabs_show_the_stay_in_each_and_what_they_share(ax) -> None:
    draw_slabs(ax, [1.0417, -np.inf, 1.09375], [1.4583, np.inf, 1.40625])
    bars = [(p.get_x(), p.get_x() + p.get_width()) for p in ax.patches]
    low, high = ax.get_xlim()
    assert bars[0] == pytest.approx((1.0417, 1.4583))
    assert bars[1] == pytest.approx((low, high))  # no limit: as wide as the picture
    assert bars[2] == bars[3] == pytest.approx((1.09375, 1.40625))
    texts = [t.get_text() for t in ax.texts]
    assert texts == ["1.042 to 1.458", "no limit", "1.094 to 1.406", "1.094 to 1.406"]
    right = ax.get_window_extent().x1
    assert all(text.get_window_extent().x0 > right for text in ax.texts), "beside the bars"


def test_stages_stop_before_in_at_and_past() -> None:
    directions, occupied, pairs = scene()
    mine = (pairs.ray == 0).nonzero().squeeze(1)
    centers, stay = occupied.center[pairs.voxel[mine]], (pairs.t_in[mine], pairs.t_out[mine])
    fig = stages_figure(directions[0], centers, *stay, 0.25, 0.7)
    first, last = float(stay[0][0]), float(stay[1][-1])
    reached = [ax.lines[1].get_xdata()[1] for ax in fig.axes]  # the ray looks along z
    assert reached == pytest.approx([first / 2, first + 0.03, 0.7, last + 0.05])
    dark = [[p.get_facecolor()[3] > 0.4 for p in ax.patches] for ax in fig.axes]
    assert dark == [[False] * 3, [True, False, False], [True, False, False], [False] * 3]


def test_the_widget_offers_the_rays_that_have_a_candidate() -> None:
    directions, occupied, pairs = scene()
    assert pairs.candidates().tolist() == [3, 0]
    widget = walk_along_ray(directions, pairs, occupied, torch.tensor([0.7, 0.9]), GRID)
    ray, distance = widget.children[:2]
    assert ray.options == (0,)
    assert distance.max == pytest.approx(1.875 + 0.05)
    widget.update()
    assert "error" not in [output.get("output_type") for output in widget.out.outputs]


def walked(direction, cells):
    centers = GRID.center_of(torch.tensor(cells), torch.float64)
    occupied = occupied_voxels(centers, torch.zeros(len(cells), dtype=torch.long), GRID, 1)
    return voxel_walk(torch.tensor(direction, dtype=torch.float64), occupied, GRID)


@pytest.fixture
def slanted():
    """Past (4, 4, 4) and (7, 4, 4), which hold something, and over (6, 4, 4), which it misses."""
    return walked([0.6, 0.0, 0.8], [[6, 4, 4], [7, 4, 4], [6, 4, 3]])


def panel(figure, ylabel):
    return next(ax for ax in figure.axes if ax.get_ylabel().startswith(ylabel))


def test_a_ray_along_z_crosses_nine_cells_of_its_column():
    walk = walked([0.0, 0.0, 1.0], [[4, 4, 3], [4, 4, 7], [5, 4, 3]])
    assert walk.cells.tolist() == [[4, 4, k] for k in range(9)]
    np.testing.assert_allclose(walk.t_out, np.arange(9) * 0.25 + 0.125)
    np.testing.assert_allclose(walk.t_in, [0, *walk.t_out[:-1]])
    assert walk.candidate.tolist() == [-1, -1, -1, 0, -1, -1, -1, 1, -1]


def test_a_walk_has_no_gap_and_knows_its_candidates(slanted):
    np.testing.assert_allclose(slanted.t_in[1:], slanted.t_out[:-1])
    held = slanted.cells[slanted.candidate >= 0].tolist()
    assert held == [[6, 4, 3], [7, 4, 4]]
    place = slanted.cells.tolist().index([7, 4, 4])
    assert (slanted.t_in[place], slanted.t_out[place]) == pytest.approx((1.09375, 1.40625))


def test_the_cell_at_a_distance(slanted):
    assert slanted.cells[slanted.cell_at(1.2)].tolist() == [7, 4, 4]
    assert slanted.cell_at(0.0) == 0
    assert slanted.cell_at(99.0) == -1


def test_the_picture_tells_of_its_cell(slanted):
    place = slanted.cells.tolist().index([7, 4, 4])
    figure = walk_picture(slanted, np.array([0.25, 0.75]), 1.2, place)
    above = panel(figure, "from above")
    assert above.get_title("left") == "cell (7, 4, 4): candidate 2; the glass is in here"
    shares = panel(figure, "share")
    assert [bar.get_height() for bar in shares.patches] == [25, 75]
    inks = [mpl.colors.to_hex(bar.get_facecolor()).upper() for bar in shares.patches]
    assert inks == [COLORS["background"], COLORS["voxel"]]
    slabs = next(ax for ax in figure.axes if ax.get_title() == "in at 1.094 m, out at 1.406 m")
    assert [text.get_text() for text in slabs.texts][-1] == "1.094 to 1.406"


def test_from_the_side_up_is_minus_y():
    walk = walked([0.0, 0.6, 0.8], [[4, 6, 3], [4, 4, 4]])
    place = walk.cell_at(1.0)
    figure = walk_picture(walk, np.array([1.0]), 1.0, place)
    star = next(line for line in panel(figure, "from the side").lines if line.get_marker() == "*")
    assert (star.get_xdata()[0], star.get_ydata()[0]) == pytest.approx((0.8, -0.6))
    star = next(line for line in panel(figure, "from above").lines if line.get_marker() == "*")
    assert (star.get_xdata()[0], star.get_ydata()[0]) == pytest.approx((0.8, 0.0))
