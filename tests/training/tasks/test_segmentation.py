"""The segmentation network's training: loss and scores by hand."""

import math
from dataclasses import replace

import pytest
import torch

from hadr.models.blocks.resnet import UNetConfig
from hadr.models.segmentation import SegmentationConfig
from hadr.training.frames.batches import FrameTensors, blank_frames
from hadr.training.recipe import Preset
from hadr.training.tasks.segmentation import iou, mask_losses
from hadr.training.tasks.task import Task

RECIPE = Preset(
    name="micro",
    width=64,
    height=48,
    network="segmentation",
    model=SegmentationConfig(
        UNetConfig((1, 1, 1, 1), widths=(8, 16, 16, 16), decoder=(16, 16, 16, 16))
    ),
    augment=False,
)


def four_scenes() -> FrameTensors:
    """A round glass, a little lighter than the noisy wall behind it, and a reddish hand below."""
    generator = torch.Generator().manual_seed(2)
    height, width = 48, 64
    v, u = torch.meshgrid(torch.arange(48.0), torch.arange(64.0), indexing="ij")
    middle = torch.tensor([[20.0, 18], [30, 20], [40, 16], [34, 22]])[:, :, None, None]
    held = (u - middle[:, 0]) ** 2 + (v - middle[:, 1]) ** 2 < 11**2
    hand = ((u - middle[:, 0]).abs() < 9) & (v > middle[:, 1]) & ~held
    color = 0.4 + 0.1 * torch.rand(4, 3, height, width, generator=generator)
    color[:, 0] += 0.3 * hand
    color += 0.1 * held[:, None]
    blank = blank_frames(4, (width, height))
    inputs = replace(blank.inputs, color=(color * 255).round().to(torch.uint8), mask=held)
    return replace(blank, inputs=inputs, hand_mask=hand, object_mask=held)


def test_iou_by_hand() -> None:
    frame, pooled = iou(torch.tensor([1, 30, 0]), torch.tensor([4, 40, 0]))
    assert frame == pytest.approx((0.25 + 0.75 + 1) / 3)
    assert pooled == pytest.approx(31 / 44)
    assert iou(torch.tensor([0]), torch.tensor([0])) == (1.0, 1.0)


def test_the_scores_are_those_of_the_object_s_true_mask_not_of_the_given_one() -> None:
    """A network that says 'object' of each pixel: the IoU is the true mask's share."""

    class Everything(torch.nn.Linear):
        config = RECIPE.model

        def forward(self, color: torch.Tensor) -> torch.Tensor:
            return torch.ones(len(color), 2, *color.shape[2:])

    frames = four_scenes()
    frames.inputs.mask[:] = False
    scores = Task(RECIPE).validate(Everything(1, 1), frames, 3)
    assert next(iter(scores)) == "validation_iou_missing", "it decides which epoch is the best"
    assert scores["validation_iou_missing"] == pytest.approx(1 - scores["validation_object_iou"])
    share = frames.object_mask.float().mean(dim=(1, 2))
    assert scores["validation_object_iou"] == pytest.approx(float(share.mean()))
    assert scores["validation_hand_iou_pooled"] == pytest.approx(
        float(frames.hand_mask.float().mean())
    )


def test_loss_by_hand() -> None:
    """Logits of 0 everywhere on 4 pixels of which one is true."""
    truth = torch.tensor([[[[True, False], [False, False]]]])
    terms = mask_losses(torch.zeros(1, 1, 2, 2), truth)
    assert float(terms["cross_entropy"]) == pytest.approx(math.log(2))
    assert float(terms["dice"]) == pytest.approx(1 - (2 * 0.5 + 1) / (2 + 1 + 1))
    assert float(terms["loss"]) == pytest.approx(math.log(2) + 0.5)
    sure = mask_losses(torch.where(truth, 30.0, -30.0), truth)
    assert float(sure["loss"]) == pytest.approx(0, abs=1e-6)


def test_an_empty_mask_has_a_finite_loss_and_gradient() -> None:
    logits = torch.full((1, 1, 4, 4), -8.0, requires_grad=True)
    loss = mask_losses(logits, torch.zeros(1, 1, 4, 4, dtype=torch.bool))["loss"]
    loss.backward()
    assert float(loss.detach()) < 0.01
    assert logits.grad is not None
    assert (logits.grad > 0).all()
