from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from torch import Tensor

from hadr.models.backbone import BackboneConfig
from hadr.rivals.swindrnet import SwinDRNetConfig
from hadr.training.frames.batches import FrameTensors, blank_frames
from hadr.training.recipe import Preset
from hadr.training.tasks.images import image_terms
from hadr.training.tasks.task import Task

MICRO = Preset(
    name="micro",
    width=32,
    height=24,
    network="swindrnet",
    model=SwinDRNetConfig(
        backbone=BackboneConfig(embed_dim=16, depths=(1, 1), heads=(1, 2), drop_path=0.0),
        channels=16,
        dropout=0.0,
    ),
)


def batch(truth: Tensor, glass: Tensor) -> FrameTensors:
    count, height, width = truth.shape
    blank = blank_frames(count, (width, height))
    # the mask stays empty: what is restored does not decide what is learned from
    camera = torch.tensor([[40.0, 40.0, 3.0, 3.0]]).repeat(count, 1)
    inputs = replace(blank.inputs, depth=truth * ~glass, intrinsics=camera)
    return replace(blank, inputs=inputs, true_depth=truth, object_mask=glass)


def losses(image: Tensor, initial: Tensor, truth: Tensor, glass: Tensor) -> dict[str, float]:
    answer = SimpleNamespace(image=image, initial=initial)
    found = Task(MICRO).losses(lambda _: answer, batch(truth, glass), 0, torch.Generator())
    return {name: value.item() for name, value in found.items()}


def flat(depth: float, count: int = 1, height: int = 7, width: int = 7) -> Tensor:
    return torch.full((count, height, width), depth)


def everywhere(there: bool) -> Tensor:
    return torch.full((1, 7, 7), there)


def test_the_perfect_answer_costs_nothing_and_unknown_truth_asks_for_nothing() -> None:
    generator = torch.Generator().manual_seed(0)
    truth = 0.5 + torch.rand(2, 7, 9, generator=generator)
    truth[:, 2:4, 3:5] = 0
    glass = torch.rand(2, 7, 9, generator=generator) < 0.5
    guess = torch.where(truth > 0, truth, 3.0)
    assert all(value == 0 for value in losses(guess, guess, truth, glass).values())
    nothing = losses(guess, guess, torch.zeros_like(truth), glass)
    assert all(value == 0 for value in nothing.values())


def test_a_displaced_plane_costs_its_distance_by_the_parts_weight() -> None:
    truth, off = flat(1.0), flat(1.1)
    for image, initial, weight in ((off, truth, 1.0), (truth, off, 0.4), (off, off, 1.4)):
        for glass, part in ((True, 1.0), (False, 0.4)):
            found = losses(image, initial, truth, everywhere(glass))
            assert found["loss"] == pytest.approx(0.1 * weight * part, rel=1e-4)
            assert found["normals"] == pytest.approx(0, abs=1e-6)
            assert found["gradient"] == pytest.approx(0, abs=1e-5)
    known = truth.clone()
    known[0, :3] = 0
    for glass, name in ((True, "depth"), (False, "background")):
        found = losses(off, off, known, everywhere(glass))
        assert found[name] == pytest.approx(0.1, rel=1e-4)
    found = losses(off, truth, truth, everywhere(True))
    assert found["depth"] == pytest.approx(0.1, rel=1e-4)
    assert found["background"] == found["initial"] == 0
    found = losses(off, off, truth, everywhere(False))
    assert found["background"] == pytest.approx(0.1, rel=1e-4)
    assert found["depth"] == found["initial"] == 0
    assert losses(truth, off, truth, everywhere(True))["initial"] == pytest.approx(0.1, rel=1e-4)


def test_means_run_over_the_batchs_pixels() -> None:
    truth = torch.cat((flat(1.0), flat(1.0)))
    image = torch.cat((flat(1.1), flat(1.3)))
    glass = torch.zeros(2, 7, 7, dtype=torch.bool)
    glass[0, 3, 3:5] = True
    glass[1, 3, 0:6] = True
    found = losses(image, truth, truth, glass)
    assert found["depth"] == pytest.approx((2 * 0.1 + 6 * 0.3) / 8, rel=1e-4)
    assert found["background"] == pytest.approx((47 * 0.1 + 43 * 0.3) / 90, rel=1e-4)


def test_a_plane_of_45_degrees_against_a_wall() -> None:
    camera = torch.tensor([[40.0, 50.0, 3.0, 3.0]])
    # z = 1 + x, and z = 1 + y
    across, down = (
        (1 / (1 - (torch.arange(7) - 3.0) / focal)).expand(1, 7, 7) for focal in (40, 50)
    )
    for plane in (across, down.mT):
        on, off = image_terms(plane, flat(1.0), camera, everywhere(True))
        # (-1, 0, 1) / sqrt 2 against (0, 0, 1): (0.7071 + 0 + 0.2929) / 3
        assert on.normals.item() == pytest.approx(1 / 3, abs=1e-4)
        assert off.normals == off.depth == off.gradient == 0


def test_a_ramp_and_a_dent_have_sobels_gradient() -> None:
    camera = torch.tensor([[40.0, 40.0, 3.0, 3.0]])
    ramp = 1 + 0.01 * torch.arange(7.0).expand(1, 7, 7)
    for image in (ramp, ramp.mT):
        on, _ = image_terms(image, flat(1.0), camera, everywhere(True))
        assert on.gradient.item() == pytest.approx(0.08, rel=1e-4)
    dent = flat(1.0, height=5, width=5)
    dent[0, 2, 2] = 0.9
    glass = torch.ones(1, 5, 5, dtype=torch.bool)
    on, _ = image_terms(dent, flat(1.0, height=5, width=5), camera, glass)
    assert on.gradient.item() == pytest.approx(0.1 * (8 + 8) / 9, rel=1e-4)
    glass[0, 2, 3] = False  # beside the dent: 2 across, 0 down
    on, off = image_terms(dent, flat(1.0, height=5, width=5), camera, glass)
    assert on.gradient.item() == pytest.approx(0.1 * 14 / 8, rel=1e-4)
    assert off.gradient.item() == pytest.approx(0.1 * 2, rel=1e-4)
    truth = flat(1.0, height=5, width=5)
    truth[0, 0, 0] = 0  # one corner unknown: one window, which saw the dent by 1 and 1, is out
    on, _ = image_terms(dent, truth, camera, torch.ones(1, 5, 5, dtype=torch.bool))
    assert on.gradient.item() == pytest.approx(0.1 * (16 - 2) / 8, rel=1e-4)


def test_the_three_terms_have_their_weights() -> None:
    generator = torch.Generator().manual_seed(0)
    truth = 0.8 + 0.1 * torch.rand(1, 7, 7, generator=generator)
    image = 0.8 + 0.1 * torch.rand(1, 7, 7, generator=generator)
    found = losses(image, truth, truth, everywhere(True))
    assert min(found[name] for name in ("depth", "normals", "gradient")) > 0
    expected = found["depth"] + 0.1 * found["normals"] + 0.6 * found["gradient"]
    assert found["loss"] == pytest.approx(expected, rel=1e-5)
