"""Exported networks give what the network gives."""

from pathlib import Path

import pytest
import torch
from torch import nn

from hadr.models.backbone import BackboneConfig
from hadr.models.exported import (
    ExportedNetwork,
    export_backbone,
    export_network,
    with_exported_backbone,
)
from hadr.models.hadr import HADR, HADRConfig
from hadr.models.hadr_input import HADRInput

SIZE = (40, 32)


def model() -> HADR:
    torch.manual_seed(3)
    backbone = BackboneConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), window=4, drop_path=0.5)
    return HADR(HADRConfig(backbone=backbone, feature_channels=4, max_points=500)).eval()


def frames() -> HADRInput:
    width, height = SIZE
    generator = torch.Generator().manual_seed(5)
    mask = torch.zeros(2, height, width, dtype=torch.bool)
    mask[:, 10:20, 12:25] = True
    depth = 0.5 + 0.3 * torch.rand(2, height, width, generator=generator)
    return HADRInput(
        color=torch.rand(2, 3, height, width, generator=generator),
        depth=torch.where(mask, 0.0, depth),
        mask=mask,
        intrinsics=torch.tensor([[40.0, 40.0, 20.0, 16.0]] * 2),
        keypoints=0.6 + 0.1 * torch.rand(2, 21, 3, generator=generator),
        keypoints_uv=torch.zeros(2, 21, 2),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("exported")
    export_backbone(model(), SIZE, path / "exact.onnx")
    return path


def test_the_exported_backbone_gives_the_same_depth(folder: Path) -> None:
    """But for rounding, which may choose another of two candidates that are all but as probable."""
    network, inputs = model(), frames()
    fast = with_exported_backbone(network, folder / "exact.onnx", threads=1)
    with torch.inference_mode():
        expected, got = network(inputs), fast(inputs)
    assert expected.restored.any()
    assert torch.equal(got.restored, expected.restored)
    assert (got.logits - expected.logits).abs().max() < 1e-5
    lost = expected.logits[expected.chosen] - expected.logits[got.chosen]
    assert lost.max() < 2e-5
    same = got.chosen == expected.chosen
    assert (got.points - expected.points)[same].abs().max() < 1e-5
    assert (got.confidence - expected.confidence).abs().max() < 1e-5
    dense = network.backbone(inputs.color)
    assert (fast.backbone(inputs.color) - dense).abs().max() < 1e-5 * dense.abs().max()


def test_integers_are_near_and_not_the_same(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = nn.Sequential(nn.Linear(64, 64), nn.ReLU(), nn.Linear(64, 8))
    values = torch.rand(1, 5, 64)
    export_network(network, (1, 5, 64), tmp_path / "integers.onnx", integers=True)
    with torch.inference_mode():
        expected, got = network(values), ExportedNetwork(tmp_path / "integers.onnx")(values)
    error = ((got - expected).norm() / expected.norm()).item()
    assert 1e-6 < error < 0.05  # a weight of seven bits is off by up to 1/128 of the largest


def test_the_network_itself_stays_as_it_was(tmp_path: Path, folder: Path) -> None:
    network, inputs = model(), frames()
    network.train()
    network.ray_features.eval()
    modes = [module.training for module in network.modules()]
    copied = with_exported_backbone(network, folder / "exact.onnx")
    assert [module.training for module in network.modules()] == modes
    assert type(network.backbone).__name__ == "ColorBackbone"
    assert copied.probability_decoder.first.weight is network.probability_decoder.first.weight
    assert not copied.training
    linear = nn.Sequential(nn.Linear(3, 2), nn.Dropout())
    linear[0].eval()
    export_network(linear, (1, 3), tmp_path / "linear.onnx")
    assert [module.training for module in linear.modules()] == [True, False, True]
    assert [p.name for p in tmp_path.iterdir()] == ["linear.onnx"]  # nothing else is left behind
    values = inputs.keypoints[:1, 0]
    got = ExportedNetwork(tmp_path / "linear.onnx")(values)
    assert torch.allclose(got, linear[0](values), atol=1e-6)


def test_errors_say_what_is_wrong(folder: Path, tmp_path: Path) -> None:
    network = ExportedNetwork(folder / "exact.onnx")
    with pytest.raises(ValueError, match=r"exported for \(1, 3, 32, 40\), got \(1, 3, 8, 8\)"):
        network(torch.zeros(1, 3, 8, 8))
    with pytest.raises(FileNotFoundError, match=r"no exported network at .*nothing\.onnx"):
        ExportedNetwork(tmp_path / "nothing.onnx")
    with pytest.raises(ValueError, match="Linear has no colour backbone, but NoneType"):
        export_backbone(nn.Linear(1, 1), SIZE, tmp_path / "x.onnx")


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r'need onnxruntime; .*pip install "hadr\[onnx\]"'):
        ExportedNetwork(tmp_path / "x.onnx")
