from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hadr.models.network_input import HADRInput
from hadr.rivals.dfnet import DenseBlock, DFNet, DFNetConfig, fill_nearest, frame_range

SMALL = DFNetConfig(width=8, layers=2, growth=4)


def settled(inputs: HADRInput, config: DFNetConfig = SMALL) -> DFNet:
    """A network whose running statistics are those of some frames."""
    torch.manual_seed(0)
    network = DFNet(config)
    for _ in range(20):
        network(inputs)
    return network.eval()


@pytest.fixture(scope="module")
def network(noise_frames) -> DFNet:
    return settled(noise_frames())


def constant(answer: float) -> DFNet:
    """A network that says the same of each pixel, in the frame's own units."""
    network = DFNet(SMALL).eval()
    torch.nn.init.zeros_(network.head.weight)
    torch.nn.init.constant_(network.head.bias, answer)
    return network


def test_it_has_the_published_number_of_weights_and_needs_no_hand() -> None:
    network = DFNet()
    count = sum(values.numel() for values in network.parameters())
    assert count == pytest.approx(1.25e6, rel=0.01)
    assert network.config.hand == "none"


def test_an_odd_size_is_cut_and_not_stretched(noise_frames) -> None:
    # Far from the cut a cut picture gives what the whole one gives.
    network = settled(noise_frames(), replace(SMALL, levels=1, layers=1)).double().network
    generator = torch.Generator().manual_seed(1)
    color, depth = (
        torch.rand(1, channels, 136, 136, generator=generator).double() for channels in (3, 1)
    )
    whole = network(color, depth)
    cut = network(color[:, :, :131, :133], depth[:, :, :131, :133])
    assert cut.shape == (1, 131, 133)
    torch.testing.assert_close(cut[:, :64, :64], whole[:, :64, :64], atol=1e-12, rtol=0)


def test_colour_and_measured_depth_matter_in_and_out_of_the_mask(network, noise_frames):
    inputs = noise_frames()
    before = network(inputs).image
    inside, outside = inputs.depth.clone(), inputs.depth.clone()
    inside[:, 10, 15] = 0.7
    outside[:, 1, 1] = 0.7
    for other in ({"depth": inside}, {"depth": outside}, {"color": 1 - inputs.color}):
        assert not torch.equal(network(replace(inputs, **other)).image, before)
    elsewhere = replace(inputs, mask=inputs.mask.roll(5, dims=2))
    assert torch.equal(network(elsewhere).image, before)  # it does not see the mask


def test_a_scene_in_other_units_is_restored_in_those(network, in_double, noise_frames):
    network, inputs = in_double(network, noise_frames())
    moved = replace(inputs, depth=torch.where(inputs.depth > 0, 0.5 * inputs.depth + 0.4, 0))
    # apart from the micrometre that the range is wider than the frame's own
    torch.testing.assert_close(
        network(moved).image, 0.5 * network(inputs).image + 0.4, atol=2e-5, rtol=0
    )


def test_a_frame_is_normalised_by_its_own_extremes_and_spread() -> None:
    # Values 0.4, 0.6, 0.6, 0.8: standard deviation sqrt(0.02).
    depth = torch.tensor([[[0.4, 0.6], [0.6, 0.8]], [[0.5, 0.5], [0.5, 0.5]]])
    low, high = frame_range(depth)
    half = 0.5 * 0.02**0.5
    assert low.tolist() == pytest.approx([0.4 - half - 1e-6, 0.5 - 1e-6], abs=1e-7)
    assert high.tolist() == pytest.approx([0.8 + half + 1e-6, 0.5 + 1e-6], abs=1e-7)


def test_answers_0_and_1_are_the_ends_of_that_range(noise_frames) -> None:
    inputs = noise_frames()
    filled = fill_nearest(inputs.depth, inputs.depth > 0)
    for answer, ends in zip((0.0, 1.0), frame_range(filled), strict=True):
        expected = ends[:, None, None].expand(2, 18, 32)
        torch.testing.assert_close(constant(answer)(inputs).image, expected)


def test_depth_not_before_the_camera_is_not_restored(noise_frames) -> None:
    output = constant(-1.0)(noise_frames())
    assert output.image.max() < 0
    assert not output.restored.any()
    assert output.depth.abs().max() == 0


def test_a_frame_without_depth_in_range_gives_nothing_and_no_nan(network, in_double, noise_frames):
    network, inputs = in_double(network, noise_frames())
    for missing in (0.0, 0.25, 1.6):
        depth = inputs.depth.clone()
        depth[0] = missing
        partly = replace(inputs, depth=depth)
        output = network(partly)
        assert output.image[0].abs().max() == 0
        assert not output.restored[0].any()
        assert output.depth[0].abs().max() == 0
        torch.testing.assert_close(output.image[1], network(inputs).image[1], atol=1e-12, rtol=0)
    training = DFNet(SMALL).double()
    training(partly).image.sum().backward()
    assert all(torch.isfinite(values.grad).all() for values in training.parameters())


def test_holes_take_the_nearest_depth_of_their_own_frame() -> None:
    depth = torch.zeros(3, 2, 5)
    depth[0, :, 0], depth[0, 0, 4] = 0.5, 0.9
    depth[1, 1, 2] = 0.7
    filled = fill_nearest(depth, depth > 0)
    assert filled[0, 0].tolist() == pytest.approx([0.5, 0.5, filled[0, 0, 2].item(), 0.9, 0.9])
    assert filled[0, 1].tolist() == pytest.approx([0.5, 0.5, 0.5, 0.9, 0.9])
    torch.testing.assert_close(filled[1], torch.full((2, 5), 0.7))
    assert filled[2].abs().max() == 0


def test_depth_out_of_range_counts_as_a_hole(network: DFNet, noise_frames) -> None:
    inputs = noise_frames()
    for wrong in (0.29, 1.51, 4.0):
        depth = torch.where(inputs.depth > 0, inputs.depth, wrong)
        assert torch.equal(network(replace(inputs, depth=depth)).image, network(inputs).image)
    wide = settled(inputs, replace(SMALL, far_m=5.0))
    depth = torch.where(inputs.depth > 0, inputs.depth, 4.0)
    assert not torch.equal(wide(replace(inputs, depth=depth)).image, wide(inputs).image)


def test_without_filling_holes_are_zeros(noise_frames) -> None:
    inputs = noise_frames()
    low, _ = frame_range(inputs.depth)
    assert low.max() < 0
    unfilled = constant(0.0)
    unfilled.config = replace(SMALL, fill_holes=False)
    torch.testing.assert_close(unfilled(inputs).image[:, 0, 0], low)


def test_a_dense_layer_sees_all_before_it_and_the_last_one_alone_answers() -> None:
    block = DenseBlock(channels=3, layers=3, growth=4)
    seen = [layer[0][0].in_channels for layer in block.layers]
    assert seen == [4, 8, 12]  # input and depth, then 4 more each
    values, depth = torch.rand(2, 3, 6, 7), torch.rand(2, 1, 6, 7)
    answers: list[torch.Tensor] = []
    given: list[torch.Tensor] = []

    def note(_: torch.nn.Module, inputs: tuple[torch.Tensor], answer: torch.Tensor) -> None:
        given.append(inputs[0])
        answers.append(answer)

    for layer in block.layers:
        layer.register_forward_hook(note)
    assert torch.equal(block(values, depth), answers[-1])
    assert torch.equal(given[0], torch.cat((values, depth), dim=1))
    assert torch.equal(given[2], torch.cat((values, depth, answers[0], answers[1]), dim=1))


def test_each_dense_block_is_given_every_nth_pixel_of_the_depth(noise_frames) -> None:
    network = settled(noise_frames())
    steps: list[int] = []

    def note(_: torch.nn.Module, inputs: tuple[torch.Tensor, torch.Tensor]) -> None:
        values, given = inputs
        step = 128 // values.shape[3]
        assert torch.equal(given, depth[:, :, ::step, ::step])
        steps.append(step)

    for module in network.modules():
        if isinstance(module, DenseBlock):
            module.register_forward_pre_hook(note)
    color, depth = torch.rand(1, 3, 72, 128), torch.rand(1, 1, 72, 128)
    network.network(color, depth)
    assert steps == [2, 2, 4, 4, 8, 8, 16, 16, 8, 4, 2]
