"""Ray features: four average pools against ROI align, and ROI align against values by hand."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from hadr.models.ray_features import RayFeatures, roi_align


def noise(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def every_pixel(frames: int, height: int, width: int) -> Tensor:
    axes = [torch.arange(n) for n in (frames, height, width)]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1).reshape(-1, 3)


def test_roi_align_of_a_ramp_is_the_value_at_the_bin_centers() -> None:
    # f(column, row) = 10 column + row at the pixels' centres. Bilinear samples of a linear function
    # are exact, and their mean is the value in the middle of the bin.
    column, row = torch.arange(12.0), torch.arange(9.0)
    ramp = (10 * column[None, :] + row[:, None]).double()[None, None]
    box = torch.tensor([[2.0, 1.0, 8.0, 5.0]])  # bins of 3 columns by 2 rows
    frame = torch.zeros(1, dtype=torch.long)
    for sampling in (0, 1, 2, 3):
        aligned = roi_align(ramp, box, frame, sampling=sampling)[0, 0]
        # centres at columns 3.5 and 6.5, rows 2 and 4; pixel k has its centre at k + 0.5
        expected = [[30 + 1.5, 60 + 1.5], [30 + 3.5, 60 + 3.5]]
        assert aligned.tolist() == [pytest.approx(line) for line in expected]
        shifted = roi_align(ramp, box, frame, sampling=sampling, aligned=False)[0, 0]
        assert (shifted - aligned).flatten().tolist() == pytest.approx([5.5] * 4)


def test_four_average_pools_equal_roi_align_at_every_pixel() -> None:
    feature_map = noise(2, 5, 13, 17)
    pixels = every_pixel(2, 13, 17)
    module = RayFeatures()
    direct = roi_align(feature_map, module.boxes(pixels, 13, 17), pixels[:, 0])
    torch.testing.assert_close(module(feature_map, pixels), direct.flatten(1), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("sampling", "equal"), [(0, True), (4, True), (2, True), (1, False)])
def test_which_sampling_is_equal_to_the_pools(sampling: int, equal: bool) -> None:
    # Four samples fall on the four pixels' centres; two fall halfway between two pixels each;
    # one sees the middle two pixels only.
    feature_map, pixels = noise(1, 3, 20, 20), torch.tensor([[0, 9, 11]])
    boxes = torch.tensor([[7.0, 5.0, 15.0, 13.0]])  # [x - 4, x + 4], [y - 4, y + 4]
    direct = roi_align(feature_map, boxes, pixels[:, 0], sampling=sampling).flatten(1)
    got = RayFeatures()(feature_map, pixels)
    assert torch.allclose(got, direct, rtol=0, atol=1e-12) == equal


def test_at_the_border_the_box_is_pushed_back_into_the_image() -> None:
    feature_map = noise(1, 2, 16, 16)
    module = RayFeatures()
    corners = torch.tensor([[0, 0, 0], [0, 15, 15], [0, 3, 8], [0, 13, 8]])
    nearest_whole = torch.tensor([[0, 4, 4], [0, 12, 12], [0, 4, 8], [0, 12, 8]])
    assert torch.equal(module(feature_map, corners), module(feature_map, nearest_whole))
    boxes = module.boxes(corners, 16, 16)
    assert boxes[:2].tolist() == [[0, 0, 8, 8], [8, 8, 16, 16]]


def test_bad_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 8x8, got 6x20"):
        RayFeatures()(torch.zeros(1, 1, 6, 20), torch.zeros(1, 3, dtype=torch.long))
