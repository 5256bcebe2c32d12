"""Rays on a lattice: who gets one, and what the pixels between get."""

from dataclasses import dataclass, replace

import pytest
import torch
from torch import Tensor

from hadr.models.backbone import BackboneConfig
from hadr.models.hadr import HADR, HADRConfig
from hadr.models.hadr_input import HADRInput
from hadr.models.signals import signals_of, within_learned
from hadr.models.sparse_rays import SparseRays, fill_between, lattice_rays, restore_sparsely


@dataclass
class Images:
    depth: Tensor
    confidence: Tensor
    restored: Tensor


class Plane:
    """Stands for a network: gives a tilted plane's depth at the rays that it is given."""

    def __init__(self, lost: tuple[int, int, int] | None = None) -> None:
        self.lost = lost
        self.rays = torch.zeros(0, 3)

    def depth_at(self, row: Tensor, column: Tensor) -> Tensor:
        return 0.5 + 0.01 * row + 0.002 * column

    def __call__(self, inputs: HADRInput, *, rays: Tensor) -> Images:
        self.rays = rays
        frame, row, column = rays.unbind(dim=1)
        depth = torch.zeros_like(inputs.depth)
        depth[frame, row, column] = self.depth_at(row, column)
        if self.lost is not None:
            depth[self.lost] = 0
        return Images(depth, 0.5 * (depth > 0), depth > 0)


def batch(mask: Tensor) -> HADRInput:
    count, height, width = mask.shape
    return HADRInput(
        color=torch.zeros(count, 3, height, width),
        depth=torch.zeros(count, height, width),
        mask=mask,
        intrinsics=torch.ones(count, 4),
        keypoints=torch.zeros(count, 21, 3),
        keypoints_uv=torch.zeros(count, 21, 2),
    )


def a_mask() -> Tensor:
    mask = torch.zeros(2, 12, 14, dtype=torch.bool)
    mask[0, 2:9, 3:11] = True
    mask[1, 4, 2:10] = True  # a thin line between the lattice's rows
    return mask


def test_lattice_rays_by_hand() -> None:
    mask = torch.zeros(1, 6, 6, dtype=torch.bool)
    mask[0, 1:4, 1:4] = True
    mask[0, 5, 5] = True  # on the lattice
    assert lattice_rays(mask, 2).tolist() == [[0, 1, 1], [0, 1, 3], [0, 3, 1], [0, 3, 3], [0, 5, 5]]
    assert torch.equal(lattice_rays(mask, 1), mask.nonzero())
    lonely = torch.zeros(1, 6, 6, dtype=torch.bool)
    lonely[0, 2, 2:4] = True  # no pixel of this mask is on the lattice
    assert torch.equal(lattice_rays(lonely, 2), lonely.nonzero())


@pytest.mark.parametrize("stride", [2, 3, 4])
def test_each_pixel_of_any_mask_is_filled(stride: int) -> None:
    generator = torch.Generator().manual_seed(stride)
    for share in (0.05, 0.3, 0.9):
        mask = torch.rand(2, 17, 23, generator=generator) < share
        got = restore_sparsely(Plane(), batch(mask), stride)
        assert torch.equal(got.restored, mask)
        assert torch.equal(got.depth > 0, mask)
        assert torch.allclose(got.confidence, 0.5 * mask)
        assert len(got.rays) <= int(mask.sum())


def test_a_plane_is_exact_inside_and_off_by_at_most_a_lattice_step_at_the_border() -> None:
    mask = a_mask()
    network = Plane()
    got = restore_sparsely(network, batch(mask))
    frame, row, column = mask.nonzero().unbind(dim=1)
    truth = torch.zeros(mask.shape)
    truth[frame, row, column] = network.depth_at(row, column)
    inside = torch.zeros_like(mask)
    inside[0, 3:8, 3:10] = True  # the lattice's hull: interpolation, not extrapolation
    assert torch.allclose(got.depth[inside], truth[inside], rtol=0, atol=1e-6)
    assert (got.depth - truth).abs().max() < 0.0121
    assert len(got.rays) == 3 * 4 + 8  # a quarter of the block, and the line whole


def test_stride_one_is_the_network_itself() -> None:
    mask = a_mask()
    network = Plane()
    got = restore_sparsely(network, batch(mask), stride=1)
    assert torch.equal(network.rays, mask.nonzero())
    assert torch.equal(got.depth, network(batch(mask), rays=mask.nonzero()).depth)


def test_a_ray_that_found_nothing_has_no_weight() -> None:
    mask = a_mask()
    lost = (0, 5, 5)
    got = restore_sparsely(Plane(lost), batch(mask))
    complete = restore_sparsely(Plane(), batch(mask))
    assert not got.restored[lost]  # not invented from its neighbours
    assert got.depth[lost] == 0
    around = got.depth[0, 4:7, 4:7][got.restored[0, 4:7, 4:7]]
    assert len(around) == 8
    assert (around > 0.5).all()
    beside = (0, 5, 6)  # between the lost ray and the one right of it: that one alone counts
    assert got.depth[beside] == complete.depth[0, 5, 7]


def test_fill_between_by_hand() -> None:
    images = torch.zeros(1, 1, 3, 3)
    images[0, 0, 0, 0], images[0, 0, 0, 2], images[0, 0, 2, 0] = 1.0, 2.0, 4.0
    known = images[0] > 0
    pixels = torch.tensor([[0, 0, 1], [0, 1, 1], [0, 1, 2]])
    filled = fill_between(images, known, pixels, 2)[0, 0]
    assert filled[0, 1] == 1.5
    assert filled[1, 1] == pytest.approx(7 / 3)  # three corners of the same weight
    assert filled[1, 2] == 2.0
    assert torch.equal(filled[0, [0, 2]], torch.tensor([1.0, 2.0]))


def test_no_mask_no_rays() -> None:
    got = restore_sparsely(Plane(), batch(torch.zeros(1, 8, 8, dtype=torch.bool)))
    assert len(got.rays) == 0
    assert not got.restored.any()


def test_frames_do_not_mix() -> None:
    mask = a_mask()
    both = restore_sparsely(Plane(), batch(mask))
    for frame in range(2):
        one = restore_sparsely(Plane(), batch(mask[frame : frame + 1]))
        assert torch.equal(one.depth[0], both.depth[frame])


def test_stride_must_be_positive() -> None:
    with pytest.raises(ValueError, match="stride must be at least 1, got 0"):
        lattice_rays(a_mask(), 0)


def test_depth_outside_of_the_mask_is_not_used() -> None:
    mask = a_mask()
    inputs = batch(mask)
    other = replace(inputs, depth=torch.where(mask, 0.0, 9.0))
    got = restore_sparsely(Plane(), other)
    plain = restore_sparsely(Plane(), inputs)
    assert torch.equal(got.depth[mask], plain.depth[mask])


def a_network_and_frames() -> tuple[HADR, HADRInput]:
    torch.manual_seed(3)
    backbone = BackboneConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), window=4)
    network = HADR(HADRConfig(backbone=backbone, feature_channels=4, max_points=500)).eval()
    mask = torch.zeros(2, 32, 40, dtype=torch.bool)
    mask[:, 10:21, 12:26] = True
    inputs = replace(
        batch(mask),
        color=torch.rand(2, 3, 32, 40),
        depth=torch.where(mask, 0.0, 0.5 + 0.3 * torch.rand(mask.shape)),
        intrinsics=torch.tensor([[40.0, 40.0, 20.0, 16.0]] * 2),
        keypoints=0.6 + 0.1 * torch.rand(2, 21, 3),
    )
    return network, inputs


def test_hadr_with_all_rays_says_the_same_about_itself() -> None:
    network, inputs = a_network_and_frames()
    with torch.inference_mode():
        exact, sparse = network(inputs), SparseRays(network, 1)(inputs)
        assert torch.equal(sparse.depth, exact.depth)
        for name, values in signals_of(exact).items():
            assert torch.equal(signals_of(sparse)[name], values), name
        for learned in (None, (0.4, 0.6)):
            known = within_learned(exact, learned)
            assert torch.equal(within_learned(sparse, learned), known)
        # Push every answer to the end of its voxel.
        network.offset_decoder.decoder.rest[-1].bias.fill_(9.0)
        assert not within_learned(network(inputs), None).any()
        assert not within_learned(SparseRays(network, 2)(inputs), None).any()


def test_hadrs_cast_rays_are_those_of_the_whole_mask(in_double) -> None:
    network, inputs = in_double(*a_network_and_frames())
    with torch.inference_mode():
        exact, sparse = network(inputs), SparseRays(network, 2)(inputs)
    cast = tuple(sparse.rays.unbind(dim=1))
    assert len(sparse.rays) < 0.4 * int(inputs.mask.sum())
    assert (sparse.depth[cast] - exact.depth[cast]).abs().max() < 1e-12
    assert (sparse.confidence[cast] - exact.confidence[cast]).abs().max() < 1e-12
    assert SparseRays(network).config is network.config
