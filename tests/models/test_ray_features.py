"""Ray features: four average pools against ROI align, and ROI align against published values."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from hadr.models.ray_features import RayFeatures, features_at, roi_align

# Input, boxes and results of the ONNX operator RoiAlign's node tests (ONNX, Apache-2.0): 5x5 bins
# of 2x2 samples. The first result is for centres at k (`output_half_pixel`), the second for
# centres at k + 0.5 (`half_pixel`).
ONNX_INPUT = [
    [0.2764, 0.7150, 0.1958, 0.3416, 0.4638, 0.0259, 0.2963, 0.6518, 0.4856, 0.7250],
    [0.9637, 0.0895, 0.2919, 0.6753, 0.0234, 0.6132, 0.8085, 0.5324, 0.8992, 0.4467],
    [0.3265, 0.8479, 0.9698, 0.2471, 0.9336, 0.1878, 0.4766, 0.4308, 0.3400, 0.2162],
    [0.0206, 0.1720, 0.2155, 0.4394, 0.0653, 0.3406, 0.7724, 0.3921, 0.2541, 0.5799],
    [0.4062, 0.2194, 0.4473, 0.4687, 0.7109, 0.9327, 0.9815, 0.6320, 0.1728, 0.6119],
    [0.3097, 0.1283, 0.4984, 0.5068, 0.4279, 0.0173, 0.4388, 0.0430, 0.4671, 0.7119],
    [0.1011, 0.8477, 0.4726, 0.1777, 0.9923, 0.4042, 0.1869, 0.7795, 0.9946, 0.9689],
    [0.1366, 0.3671, 0.7011, 0.6234, 0.9867, 0.5585, 0.6985, 0.5609, 0.8788, 0.9928],
    [0.5697, 0.8511, 0.6711, 0.9406, 0.8751, 0.7496, 0.1650, 0.1049, 0.1559, 0.2514],
    [0.7012, 0.4056, 0.7879, 0.3461, 0.0415, 0.2998, 0.5094, 0.3727, 0.5482, 0.0502],
]
ONNX_BOXES = [[0.0, 0.0, 9.0, 9.0], [0.0, 5.0, 4.0, 9.0], [5.0, 5.0, 9.0, 9.0]]
ONNX_RESULT = {
    False: [
        [
            [0.4664, 0.4466, 0.3405, 0.5688, 0.6068],
            [0.3714, 0.4296, 0.3835, 0.5562, 0.3510],
            [0.2768, 0.4883, 0.5222, 0.5528, 0.4171],
            [0.4713, 0.4844, 0.6904, 0.4920, 0.8774],
            [0.6239, 0.7125, 0.6289, 0.3355, 0.3495],
        ],
        [
            [0.3022, 0.4305, 0.4696, 0.3978, 0.5423],
            [0.3656, 0.7050, 0.5165, 0.3172, 0.7015],
            [0.2912, 0.5059, 0.6476, 0.6235, 0.8299],
            [0.5916, 0.7389, 0.7048, 0.8372, 0.8893],
            [0.6227, 0.6153, 0.7097, 0.6154, 0.4585],
        ],
        [
            [0.2384, 0.3379, 0.3717, 0.6100, 0.7601],
            [0.3767, 0.3785, 0.7147, 0.9243, 0.9727],
            [0.5749, 0.5826, 0.5709, 0.7619, 0.8770],
            [0.5355, 0.2566, 0.2141, 0.2796, 0.3600],
            [0.4365, 0.3504, 0.2887, 0.3661, 0.2349],
        ],
    ],
    True: [
        [
            [0.5178, 0.3434, 0.3229, 0.4474, 0.6344],
            [0.4031, 0.5366, 0.4428, 0.4861, 0.4023],
            [0.2512, 0.4002, 0.5155, 0.6954, 0.3465],
            [0.3350, 0.4601, 0.5881, 0.3439, 0.6849],
            [0.4932, 0.7141, 0.8217, 0.4719, 0.4039],
        ],
        [
            [0.3070, 0.2187, 0.3337, 0.4880, 0.4870],
            [0.1871, 0.4914, 0.5561, 0.4192, 0.3686],
            [0.1433, 0.4608, 0.5971, 0.5310, 0.4982],
            [0.2788, 0.4386, 0.6022, 0.7000, 0.7524],
            [0.5774, 0.7024, 0.7251, 0.7338, 0.8163],
        ],
        [
            [0.2393, 0.4075, 0.3379, 0.2525, 0.4743],
            [0.3671, 0.2702, 0.4105, 0.6419, 0.8308],
            [0.5556, 0.4543, 0.5564, 0.7502, 0.9300],
            [0.6626, 0.5617, 0.4813, 0.4954, 0.6663],
            [0.6636, 0.3721, 0.2056, 0.1928, 0.2478],
        ],
    ],
}


def noise(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def every_pixel(frames: int, height: int, width: int) -> Tensor:
    axes = [torch.arange(n) for n in (frames, height, width)]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1).reshape(-1, 3)


@pytest.mark.parametrize("aligned", [False, True])
def test_roi_align_gives_the_published_values(aligned: bool) -> None:
    feature_map = torch.tensor(ONNX_INPUT, dtype=torch.float64)[None, None]
    got = roi_align(
        feature_map,
        torch.tensor(ONNX_BOXES),
        torch.zeros(3, dtype=torch.long),
        bins=5,
        sampling=2,
        aligned=aligned,
    )
    expected = torch.tensor(ONNX_RESULT[aligned], dtype=torch.float64)
    torch.testing.assert_close(got[:, 0], expected, rtol=0, atol=1e-4)


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


def test_a_thin_box_is_widened_to_one_pixel_only_in_the_old_form() -> None:
    ramp = torch.arange(12.0, dtype=torch.float64).expand(1, 1, 6, 12)
    thin, frame = torch.tensor([[3.0, 1.0, 3.5, 4.0]]), torch.zeros(1, dtype=torch.long)
    # aligned: bins of 0.25 px, centres 3.125 and 3.375 of the box's coordinates
    assert roi_align(ramp, thin, frame)[0, 0, 0].tolist() == pytest.approx([2.625, 2.875])
    # old: the box is [3, 4], bins of 0.5 px, centres 3.25 and 3.75
    old = roi_align(ramp, thin, frame, aligned=False)[0, 0, 0]
    assert old.tolist() == pytest.approx([3.25, 3.75])


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


def test_pools_are_not_equal_where_pixel_centers_are_whole_numbers() -> None:
    feature_map, pixels = noise(1, 3, 20, 20), torch.tensor([[0, 9, 11]])
    boxes = torch.tensor([[7.0, 5.0, 15.0, 13.0]])
    centered = roi_align(feature_map, boxes, pixels[:, 0], aligned=False).flatten(1)
    got = RayFeatures()(feature_map, pixels)
    assert (got - centered).abs().max() > 0.05
    # In that convention the same pixels are named by a box half a pixel further left and up.
    moved = roi_align(feature_map, boxes - 0.5, pixels[:, 0], aligned=False).flatten(1)
    torch.testing.assert_close(got, moved, rtol=0, atol=1e-12)


def test_bins_by_hand() -> None:
    # Pixel value = 100 row + column; means of the 4x4 pixels around (row 6, column 5).
    row, column = torch.arange(12.0), torch.arange(12.0)
    feature_map = (100 * row[:, None] + column[None, :])[None, None]
    feature_map = torch.cat((feature_map, -feature_map), dim=1)
    got = RayFeatures()(feature_map, torch.tensor([[0, 6, 5]]))
    # rows 2..5 and 6..9: means 3.5, 7.5; columns 1..4 and 5..8: means 2.5, 6.5
    expected = [352.5, 356.5, 752.5, 756.5]
    assert got.tolist() == [expected + [-x for x in expected]]


def test_at_the_border_the_box_is_pushed_back_into_the_image() -> None:
    feature_map = noise(1, 2, 16, 16)
    module = RayFeatures()
    corners = torch.tensor([[0, 0, 0], [0, 15, 15], [0, 3, 8], [0, 13, 8]])
    nearest_whole = torch.tensor([[0, 4, 4], [0, 12, 12], [0, 4, 8], [0, 12, 8]])
    assert torch.equal(module(feature_map, corners), module(feature_map, nearest_whole))
    boxes = module.boxes(corners, 16, 16)
    assert boxes[:2].tolist() == [[0, 0, 8, 8], [8, 8, 16, 16]]


def test_rays_read_their_own_frame() -> None:
    feature_map = torch.stack([torch.full((3, 8, 8), float(k)) for k in range(4)])
    got = RayFeatures()(feature_map, torch.tensor([[2, 4, 4], [0, 1, 7], [3, 0, 0]]))
    assert got.shape == (3, 12)
    assert got[:, 0].tolist() == [2.0, 0.0, 3.0]


def test_gradient_reaches_exactly_the_box() -> None:
    feature_map = torch.zeros(1, 1, 16, 16, requires_grad=True)
    RayFeatures()(feature_map, torch.tensor([[0, 7, 9]])).sum().backward()
    assert feature_map.grad is not None
    expected = torch.zeros(16, 16)
    expected[3:11, 5:13] = 1 / 16
    assert torch.equal(feature_map.grad[0, 0], expected)


def test_bad_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 8x8, got 6x20"):
        RayFeatures()(torch.zeros(1, 1, 6, 20), torch.zeros(1, 3, dtype=torch.long))


def test_features_at() -> None:
    feature_map = torch.arange(2 * 3 * 4 * 5.0).reshape(2, 3, 4, 5)
    pixels = torch.tensor([[1, 2, 3], [0, 0, 4]])
    expected = torch.stack((feature_map[1, :, 2, 3], feature_map[0, :, 0, 4]))
    assert torch.equal(features_at(feature_map, pixels), expected)
