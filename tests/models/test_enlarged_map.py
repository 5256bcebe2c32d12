"""The map that is never made gives what the made one gives."""

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from hadr.models.enlarged_map import EnlargedMap, block_enlargement, enlargement
from hadr.models.ray_features import RayFeatures, features_at

SIZES = [(12, 20, 3, 5, 4), (45, 50, 12, 13, 4), (10, 9, 10, 9, 1)]  # height, width, h, w, cell


def some_map(height: int, width: int, h: int, w: int, cell: int) -> tuple[EnlargedMap, Tensor]:
    generator = torch.Generator().manual_seed(height)
    coarse = torch.rand(2, 4, h, w, generator=generator, dtype=torch.float64)
    whole = (h * cell, w * cell)
    dense = functional.interpolate(coarse, whole, mode="bilinear", align_corners=False)
    return EnlargedMap(coarse, height, width, cell), dense[:, :, :height, :width]


def every_pixel(height: int, width: int) -> Tensor:
    return torch.ones(2, height, width).nonzero()


def test_enlargement_by_hand() -> None:
    # Two cells to four pixels: their centres lie at -1/4 (clamped), 1/4, 3/4 and 5/4 (clamped).
    expected = torch.tensor([[1, 0], [0.75, 0.25], [0.25, 0.75], [0, 1]])
    assert torch.allclose(enlargement(2, 2, 4, torch.zeros(1)), expected)
    assert torch.allclose(enlargement(2, 2, 3, torch.zeros(1)), expected[:3])  # cut, not squeezed
    halves = torch.tensor([[0.875, 0.125], [0.5, 0.5], [0.125, 0.875]])
    assert torch.allclose(block_enlargement(2, 2, 4, 2, torch.zeros(1)), halves)


@pytest.mark.parametrize("size", SIZES)
def test_each_pixel_has_the_enlarged_maps_features(size: tuple[int, int, int, int, int]) -> None:
    lazy, dense = some_map(*size)
    assert lazy.shape == tuple(dense.shape)
    assert torch.equal(lazy.dense(), dense)
    pixels = every_pixel(*size[:2])
    expected = dense.permute(0, 2, 3, 1).reshape(-1, 4)
    assert torch.allclose(lazy.at(pixels), expected, rtol=0, atol=1e-12)
    assert torch.equal(features_at(lazy, pixels), lazy.at(pixels))


@pytest.mark.parametrize("size", SIZES)
def test_each_ray_has_the_enlarged_maps_feature(size: tuple[int, int, int, int, int]) -> None:
    lazy, dense = some_map(*size)
    pixels = every_pixel(*size[:2])
    got = RayFeatures()(lazy, pixels)
    assert torch.allclose(got, RayFeatures()(dense, pixels), rtol=0, atol=1e-12)
    few = pixels[[37, 80]]  # only the part around them is computed
    assert torch.allclose(RayFeatures()(lazy, few), got[[37, 80]], rtol=0, atol=1e-12)


def test_gradients_are_those_of_the_enlarged_map() -> None:
    lazy, _ = some_map(12, 20, 3, 5, 4)
    pixels = every_pixel(12, 20)[::7]
    gradients = []
    for as_map in (lambda m: m, lambda m: m.dense()):
        coarse = lazy.coarse.clone().requires_grad_()
        feature_map = as_map(EnlargedMap(coarse, 12, 20, 4))
        values = torch.cat(
            (features_at(feature_map, pixels), RayFeatures()(feature_map, pixels)), dim=1
        )
        values.square().sum().backward()
        gradients.append(coarse.grad)
    assert gradients[0] is not None
    assert torch.allclose(gradients[0], gradients[1], rtol=0, atol=1e-12)


def test_no_ray() -> None:
    lazy, _ = some_map(12, 20, 3, 5, 4)
    none = torch.zeros(0, 3, dtype=torch.long)
    assert RayFeatures()(lazy, none).shape == (0, 16)
    assert lazy.at(none).shape == (0, 4)
