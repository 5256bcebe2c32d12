import matplotlib as mpl
import numpy as np
import pytest
import torch

from hadr.figures.method.voxel_walk import voxel_walk, walk_picture
from hadr.figures.panels import COLORS
from hadr.ray_voxels import VoxelGrid, occupied_voxels

GRID = VoxelGrid()


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
