"""HADR computes what it computed when its forward was compared with the published code.

With the ReLUs of the ledger's row 28 the network equals the published one from the same weights,
up to what the ledger's rows 4, 7, 10, 11 and 30 name. That code is not here; the file
`hadr_forward.safetensors` keeps what our own forward gave then, of a small network with weights
and frames of chance. Written by ``python tests/models/test_published_form.py``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from hadr.models.backbone import BackboneConfig
from hadr.models.hadr import HADR, HADRConfig
from hadr.models.network_input import HADRInput

STORED = Path(__file__).with_name("hadr_forward.safetensors")
CONFIG = HADRConfig(
    backbone=BackboneConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), drop_path=0.0),
    feature_channels=8,
    voxel_width=16,
    decoder_widths=(16, 8),
    max_points=400,
    voxel_relu=True,
)
GIVEN = ("color", "depth", "mask", "intrinsics", "keypoints", "keypoints_uv")
ANSWER = ("logits", "probability", "offset", "points", "depth")


def frames() -> HADRInput:
    """Two frames: slanted walls with a hole before them, a hand near it, colours of chance."""
    chance = torch.Generator().manual_seed(1)
    row, column = torch.meshgrid(torch.arange(24.0), torch.arange(32.0), indexing="ij")
    depth = torch.stack((0.5 + 0.01 * column, 0.9 - 0.015 * row))
    mask = torch.zeros(2, 24, 32, dtype=torch.bool)
    mask[0, 6:14, 8:16] = True
    mask[1, 10:18, 14:22] = True
    keypoints = 0.04 * torch.randn(2, 21, 3, generator=chance) + torch.tensor([0.0, 0.0, 0.6])
    intrinsics = torch.tensor([[30.0, 31.0, 15.5, 11.5], [40.0, 40.0, 15.0, 12.0]])
    uv = keypoints[..., :2] / keypoints[..., 2:] * intrinsics[:, None, :2] + intrinsics[:, None, 2:]
    color = torch.rand(2, 3, 24, 32, generator=chance)
    return HADRInput(color, depth * ~mask, mask, intrinsics, keypoints, uv)


def answer(weights: dict[str, Tensor], inputs: HADRInput) -> dict[str, Tensor]:
    """What the network gives, and the gradient of its depths and logits by the voxels' layers."""
    network = HADR(CONFIG).eval()
    network.load_state_dict(weights)
    output = network(inputs)
    (output.depth.sum() + output.logits.square().sum()).backward()
    found = {f"answer.{name}": getattr(output, name).detach() for name in ANSWER}
    learned = dict(network.named_parameters())
    grown = {name: learned[name].grad for name in learned if name.startswith("voxel_features.")}
    return found | {
        f"gradient.{name}": values for name, values in grown.items() if values is not None
    }


@pytest.fixture(scope="module")
def stored() -> dict[str, Tensor]:
    return load_file(STORED)


def part(stored: dict[str, Tensor], of: str) -> dict[str, Tensor]:
    """The tensors of a part by their names within it."""
    return {name.removeprefix(of): v for name, v in stored.items() if name.startswith(of)}


def test_answers_and_gradients_are_those_that_were_stored(stored: dict[str, Tensor]) -> None:
    given = HADRInput(**part(stored, "given."))
    found = answer(part(stored, "weights."), given)
    kept = {name: v for name, v in stored.items() if name.startswith(("answer.", "gradient."))}
    assert found.keys() == kept.keys()
    for name, values in kept.items():
        scale = float(values.abs().max())
        torch.testing.assert_close(
            found[name], values, atol=1e-4 * scale, rtol=1e-3, msg=lambda m, n=name: f"{n}: {m}"
        )


def test_without_the_relus_the_voxels_are_others(stored: dict[str, Tensor]) -> None:
    """What is stored depends on them: the stored network's voxel layers do fall below 0."""
    network = HADR(replace(CONFIG, voxel_relu=False)).eval()
    network.load_state_dict(part(stored, "weights."))
    with torch.no_grad():
        logits = network(HADRInput(**part(stored, "given."))).logits
    assert float((logits - stored["answer.logits"]).abs().max()) > 1e-3


def main() -> None:
    """Store weights and frames of chance, and what the forward makes of them."""
    torch.manual_seed(0)
    weights = HADR(CONFIG).state_dict()
    inputs = frames()
    tensors = {f"weights.{name}": v for name, v in weights.items()}
    tensors |= {f"given.{name}": getattr(inputs, name) for name in GIVEN}
    save_file({**tensors, **answer(weights, inputs)}, STORED)


if __name__ == "__main__":
    main()
