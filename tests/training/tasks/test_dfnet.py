from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from hadr.rivals.dfnet import DFNetConfig
from hadr.training.recipe import Preset
from hadr.training.tasks.task import Task

MICRO = Preset(
    name="micro",
    width=32,
    height=24,
    network="dfnet",
    model=DFNetConfig(width=16, layers=2, growth=8, levels=1),
)


def terms_of(image: torch.Tensor, batch) -> dict[str, torch.Tensor]:
    """The loss of a network that says this image."""
    answer = SimpleNamespace(image=image)
    return Task(MICRO).losses(lambda _: answer, batch, 0, torch.Generator())


def losses(image: torch.Tensor, batch) -> dict[str, float]:
    return {name: value.item() for name, value in terms_of(image, batch).items()}


def test_the_truth_costs_nothing(frames) -> None:
    terms = losses(frames.true_depth, frames)
    assert terms == pytest.approx({"loss": 0, "mse": 0, "normals": 0}, abs=1e-6)


def test_an_error_by_hand_and_each_pixel_counts_the_same(frames) -> None:
    few = frames.take([0, 1])
    truth, mask = few.true_depth.clone(), few.object_mask.clone()
    mask[1, 9:] = False  # 64 pixels in frame 0, a row of 8 in frame 1
    few = replace(few, object_mask=mask)
    image = truth.clone()
    image[0] += 0.02
    image[1] += 0.05
    terms = losses(image, few)
    assert terms["mse"] == pytest.approx((64 * 0.02**2 + 8 * 0.05**2) / 72, rel=1e-4)
    image[~mask] = 9.0  # the rest of the image has no part in the squared error
    steep = losses(image, few)
    assert steep["mse"] == pytest.approx(terms["mse"], rel=1e-5)
    assert steep["normals"] > 0.1
    assert steep["loss"] == pytest.approx(1000 * (steep["mse"] + 0.001 * steep["normals"]))


def test_the_objects_true_pixels_count_whatever_the_mask_given(frames) -> None:
    few = frames.take([0])
    image = few.true_depth + 0.02
    before = losses(image, few)
    given = replace(few.inputs, mask=torch.zeros_like(few.inputs.mask))
    assert losses(image, replace(few, inputs=given)) == before


def test_unknown_truth_and_truth_out_of_range_do_not_count(frames) -> None:
    few = frames.take([0])
    image = few.true_depth.clone()
    image[0, 8, 12] += 0.5
    image[0, 15, 19] += 0.5
    truth = few.true_depth.clone()
    truth[0, 8, 12], truth[0, 15, 19] = 0, 1.6
    assert losses(image, replace(few, true_depth=truth))["mse"] == 0
    assert losses(image, few)["mse"] == pytest.approx(2 * 0.5**2 / 64, rel=1e-4)


def test_a_frame_without_given_depth_does_not_count(frames) -> None:
    few = frames.take([0, 1])
    depth = few.inputs.depth.clone()
    depth[0] = 0
    few = replace(few, inputs=replace(few.inputs, depth=depth))
    image = few.true_depth.clone()
    image[0] = 0
    image[1] += 0.02
    assert losses(image, few)["mse"] == pytest.approx(0.02**2, rel=1e-4)
    nothing = replace(few, inputs=replace(few.inputs, depth=torch.zeros_like(depth)))
    terms = terms_of(image.requires_grad_(), nothing)
    assert terms["loss"].item() == 0
    terms["loss"].backward()
    assert torch.equal(image.grad, torch.zeros_like(image))


def test_a_normal_needs_its_pixel_counted_and_the_next_two_known(frames) -> None:
    few = frames.take([0])
    few = replace(few, true_depth=torch.ones_like(few.true_depth))
    image = few.true_depth.clone()
    image[0, 12, 13] = 1.2
    pixel = torch.zeros_like(few.object_mask)
    for row, column in ((12, 13), (12, 12), (11, 13)):  # the three normals that the pixel bends
        here = pixel.clone()
        here[0, row, column] = True
        seen = replace(few, object_mask=here)
        assert losses(image, seen)["normals"] > 0.1
        for beside in ((row, column + 1), (row + 1, column)):
            unknown = few.true_depth.clone()
            unknown[0, *beside] = 0
            assert losses(image, replace(seen, true_depth=unknown))["normals"] == 0
    here = pixel.clone()
    here[0, 13, 13] = here[0, 12, 14] = True  # normals that do not look back at it
    assert losses(image, replace(few, object_mask=here))["normals"] == pytest.approx(0, abs=1e-6)
