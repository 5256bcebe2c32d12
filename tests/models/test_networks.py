"""What every depth network of the table keeps to, at preset tiny."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import nn

from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.hand.keypoints import predict_keypoints
from hadr.models.networks import DEPTH_NETWORKS, NETWORKS
from hadr.models.segmentation import predict_logits
from hadr.training.checkpoints import for_inference
from hadr.training.presets import preset

WITH_LITE = [kind for kind in DEPTH_NETWORKS if hasattr(NETWORKS[kind].config_class()(), "lite")]


def with_lite(config: Any, **settings: Any) -> Any:
    """Put an EfficientNet-Lite0, which normalises colours itself, into a configuration."""
    alone = {"normalize_color": False} if hasattr(config, "normalize_color") else {}
    lite = LiteConfig(stages=2, pretrained=False, **settings)
    return replace(config, lite=lite, **alone)


@pytest.fixture(
    scope="module", params=[*DEPTH_NETWORKS, *(f"{kind} with Lite0" for kind in WITH_LITE)]
)
def network(request: pytest.FixtureRequest) -> nn.Module:
    torch.manual_seed(0)
    kind, _, lite = request.param.partition(" ")
    config: Any = preset("tiny", kind).model
    if lite:
        config = with_lite(config)
    made: nn.Module = NETWORKS[kind].network_class()(config)
    return made.eval()


@pytest.mark.parametrize(("height", "width"), [(72, 128), (126, 224), (46, 58)])
@torch.no_grad()
def test_any_size_will_do_and_only_the_mask_is_restored(network, height, width, noise_frames):
    inputs = noise_frames(height, width, hand=True)
    output = network(inputs)
    assert output.depth.shape == output.restored.shape == (2, height, width)
    assert not (output.restored & ~inputs.mask).any()
    assert torch.equal(output.restored, output.depth > 0)
    assert output.depth.isfinite().all()
    assert output.depth.min() == 0


@torch.no_grad()
def test_frames_of_a_batch_do_not_influence_each_other(network: nn.Module, noise_frames) -> None:
    inputs = noise_frames(36, 64, hand=True)
    both = network(inputs).depth
    for number in range(2):
        alone = network(inputs.take(slice(number, number + 1))).depth[0]
        torch.testing.assert_close(alone, both[number], atol=1e-4, rtol=0)


def as_if_trained(network: nn.Module) -> nn.Module:
    """Give normalisations averages and weights of some kind: fresh ones change nothing."""
    network = deepcopy(network)
    for norm in network.modules():
        if isinstance(norm, nn.BatchNorm2d):
            for values in (norm.weight.data, norm.running_var):
                values.uniform_(0.5, 1.5)
            for values in (norm.bias.data, norm.running_mean):
                values.normal_(std=0.3)
    return network


def count(network: nn.Module, kind: type[nn.Module]) -> int:
    return sum(isinstance(part, kind) for part in network.modules())


@torch.no_grad()
def test_the_form_for_inference_answers_alike_and_leaves_the_network(network, noise_frames) -> None:
    network, inputs = as_if_trained(network), noise_frames(72, 128, hand=True)
    before = {name: value.clone() for name, value in network.state_dict().items()}
    quick, expected = for_inference(network), network(inputs)
    transposed = count(quick, nn.ConvTranspose2d)  # their results are cut before it
    assert count(quick, nn.BatchNorm2d) == min(transposed, count(network, nn.BatchNorm2d))
    torch.testing.assert_close(quick(inputs).depth, expected.depth, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(network.state_dict(), before, atol=0, rtol=0)


@pytest.mark.parametrize("kind", ["segmentation", "hand-keypoints"])
@torch.no_grad()
def test_what_finds_mask_and_hand_answers_alike_for_inference(kind: str, noise_frames) -> None:
    torch.manual_seed(0)
    config: Any = preset("tiny", kind).model
    network = as_if_trained(NETWORKS[kind].network_class()(config).eval())
    inputs = noise_frames(72, 128)
    given = (inputs.color,) if kind == "segmentation" else (inputs, inputs.mask)
    find = predict_logits if kind == "segmentation" else predict_keypoints
    quick = for_inference(network)
    assert count(quick, nn.BatchNorm2d) == 0 < count(network, nn.BatchNorm2d)
    torch.testing.assert_close(find(quick, *given), find(network, *given), atol=1e-4, rtol=1e-4)


@torch.no_grad()
def test_bytes_are_colours_and_a_frame_without_mask_keeps_its_depth(network, noise_frames):
    inputs = noise_frames(36, 64, hand=True)
    bytes_ = (255 * inputs.color).round().to(torch.uint8)
    as_floats = network(replace(inputs, color=bytes_ / 255)).depth
    assert torch.equal(network(replace(inputs, color=bytes_)).depth, as_floats)
    empty = network(replace(inputs, mask=torch.zeros_like(inputs.mask)))
    assert not empty.restored.any()


@pytest.mark.parametrize("kind", WITH_LITE)
def test_slow_encoders_see_colour_and_learn(kind: str, noise_frames) -> None:
    config = with_lite(preset("tiny", kind).model, frozen=0)
    torch.manual_seed(0)
    network = NETWORKS[kind].network_class()(config).eval()
    (name, lite), *_ = NETWORKS[kind].encoders_of(network).items()
    assert name.endswith("lite")
    assert name in NETWORKS[kind].slow
    network(noise_frames(36, 64, hand=True)).depth.sum().backward()
    for weight in (lite.stem[1].weight, [*lite.parameters()][-1]):
        assert float(weight.grad.abs().sum()) > 0
