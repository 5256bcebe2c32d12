"""The losses of networks that answer with whole images: DFNet, SwinDRNet, TODE, the U-Net."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from torch import Tensor

from hadr.training.frames.batches import FrameTensors, blank_frames
from hadr.training.losses import frame_mean
from hadr.training.presets import preset
from hadr.training.tasks.images import image_terms
from hadr.training.tasks.task import Task


def terms(network: str, batch: FrameTensors, **answer: Tensor) -> dict[str, Tensor]:
    """The loss of a network of this kind that gives this answer."""
    given = SimpleNamespace(**answer)
    return Task(preset("tiny", network)).losses(lambda _: given, batch, 0, torch.Generator())


def losses(network: str, batch: FrameTensors, **answer: Tensor) -> dict[str, float]:
    return {name: value.item() for name, value in terms(network, batch, **answer).items()}


def dfnet(image: Tensor, batch: FrameTensors) -> dict[str, float]:
    return losses("dfnet", batch, image=image)


def test_dfnets_error_by_hand_and_each_pixel_counts_the_same(frames) -> None:
    few = frames.take([0, 1])
    truth, mask = few.true_depth.clone(), few.object_mask.clone()
    mask[1, 9:] = False  # 64 pixels in frame 0, a row of 8 in frame 1
    few = replace(few, object_mask=mask)
    image = truth.clone()
    image[0] += 0.02
    image[1] += 0.05
    found = dfnet(image, few)
    assert found["mse"] == pytest.approx((64 * 0.02**2 + 8 * 0.05**2) / 72, rel=1e-4)
    image[~mask] = 9.0  # the rest of the image has no part in the squared error
    steep = dfnet(image, few)
    assert steep["mse"] == pytest.approx(found["mse"], rel=1e-5)
    assert steep["normals"] > 0.1
    assert steep["loss"] == pytest.approx(1000 * (steep["mse"] + 0.001 * steep["normals"]))


def test_the_objects_true_pixels_count_whatever_the_mask_given(frames) -> None:
    few = frames.take([0])
    image = few.true_depth + 0.02
    before = dfnet(image, few)
    given = replace(few.inputs, mask=torch.zeros_like(few.inputs.mask))
    assert dfnet(image, replace(few, inputs=given)) == before


def test_unknown_truth_and_truth_out_of_range_do_not_count(frames) -> None:
    few = frames.take([0])
    image = few.true_depth.clone()
    image[0, 8, 12] += 0.5
    image[0, 15, 19] += 0.5
    truth = few.true_depth.clone()
    truth[0, 8, 12], truth[0, 15, 19] = 0, 1.6
    assert dfnet(image, replace(few, true_depth=truth))["mse"] == 0
    assert dfnet(image, few)["mse"] == pytest.approx(2 * 0.5**2 / 64, rel=1e-4)


def test_a_frame_without_given_depth_does_not_count(frames) -> None:
    few = frames.take([0, 1])
    depth = few.inputs.depth.clone()
    depth[0] = 0
    few = replace(few, inputs=replace(few.inputs, depth=depth))
    image = few.true_depth.clone()
    image[0] = 0
    image[1] += 0.02
    assert dfnet(image, few)["mse"] == pytest.approx(0.02**2, rel=1e-4)
    nothing = replace(few, inputs=replace(few.inputs, depth=torch.zeros_like(depth)))
    found = terms("dfnet", nothing, image=image.requires_grad_())
    assert found["loss"].item() == 0
    found["loss"].backward()
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
        assert dfnet(image, seen)["normals"] > 0.1
        for beside in ((row, column + 1), (row + 1, column)):
            unknown = few.true_depth.clone()
            unknown[0, *beside] = 0
            assert dfnet(image, replace(seen, true_depth=unknown))["normals"] == 0
    here = pixel.clone()
    here[0, 13, 13] = here[0, 12, 14] = True  # normals that do not look back at it
    assert dfnet(image, replace(few, object_mask=here))["normals"] == pytest.approx(0, abs=1e-6)


def wall(truth: Tensor, glass: Tensor) -> FrameTensors:
    """Frames with this true depth whose glass is there."""
    count, height, width = truth.shape
    blank = blank_frames(count, (width, height))
    # the mask stays empty: what is restored does not decide what is learned from
    camera = torch.tensor([[40.0, 40.0, 3.0, 3.0]]).repeat(count, 1)
    inputs = replace(blank.inputs, depth=truth * ~glass, intrinsics=camera)
    return replace(blank, inputs=inputs, true_depth=truth, object_mask=glass)


def swin(image: Tensor, initial: Tensor, truth: Tensor, glass: Tensor) -> dict[str, float]:
    return losses("swindrnet", wall(truth, glass), image=image, initial=initial)


def flat(depth: float, count: int = 1, height: int = 7, width: int = 7) -> Tensor:
    return torch.full((count, height, width), depth)


def everywhere(there: bool) -> Tensor:
    return torch.full((1, 7, 7), there)


def test_the_perfect_answer_costs_swindrnet_nothing_and_unknown_truth_asks_for_nothing() -> None:
    generator = torch.Generator().manual_seed(0)
    truth = 0.5 + torch.rand(2, 7, 9, generator=generator)
    truth[:, 2:4, 3:5] = 0
    glass = torch.rand(2, 7, 9, generator=generator) < 0.5
    guess = torch.where(truth > 0, truth, 3.0)
    assert all(value == 0 for value in swin(guess, guess, truth, glass).values())
    nothing = swin(guess, guess, torch.zeros_like(truth), glass)
    assert all(value == 0 for value in nothing.values())


def test_a_displaced_plane_costs_its_distance_by_the_parts_weight() -> None:
    truth, off = flat(1.0), flat(1.1)
    for image, initial, weight in ((off, truth, 1.0), (truth, off, 0.4), (off, off, 1.4)):
        for glass, part in ((True, 1.0), (False, 0.4)):
            found = swin(image, initial, truth, everywhere(glass))
            assert found["loss"] == pytest.approx(0.1 * weight * part, rel=1e-4)
            assert found["normals"] == pytest.approx(0, abs=1e-6)
            assert found["gradient"] == pytest.approx(0, abs=1e-5)
    known = truth.clone()
    known[0, :3] = 0
    for glass, name in ((True, "depth"), (False, "background")):
        found = swin(off, off, known, everywhere(glass))
        assert found[name] == pytest.approx(0.1, rel=1e-4)
    found = swin(off, truth, truth, everywhere(True))
    assert found["depth"] == pytest.approx(0.1, rel=1e-4)
    assert found["background"] == found["initial"] == 0
    found = swin(off, off, truth, everywhere(False))
    assert found["background"] == pytest.approx(0.1, rel=1e-4)
    assert found["depth"] == found["initial"] == 0
    assert swin(truth, off, truth, everywhere(True))["initial"] == pytest.approx(0.1, rel=1e-4)


def test_means_run_over_the_batchs_pixels() -> None:
    truth = torch.cat((flat(1.0), flat(1.0)))
    image = torch.cat((flat(1.1), flat(1.3)))
    glass = torch.zeros(2, 7, 7, dtype=torch.bool)
    glass[0, 3, 3:5] = True
    glass[1, 3, 0:6] = True
    found = swin(image, truth, truth, glass)
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
    found = swin(image, truth, truth, everywhere(True))
    assert min(found[name] for name in ("depth", "normals", "gradient")) > 0
    expected = found["depth"] + 0.1 * found["normals"] + 0.6 * found["gradient"]
    assert found["loss"] == pytest.approx(expected, rel=1e-5)


def two_walls() -> tuple[Tensor, FrameTensors]:
    """Two frames of 3 x 4 pixels before a wall at 0.5 m, and an answer.

    In the first one it is a wall that turns away by 45 degrees, in the second one a wall 0.1 m
    too far. There one pixel's truth is unknown, and the answer nonsense.
    """
    u = (torch.arange(4.0) - 1.5) / 40
    image = torch.stack(((0.5 / (1 - u)).expand(3, 4), torch.full((3, 4), 0.6)))
    truth = torch.full((2, 3, 4), 0.5)
    image[1, 1, 1], truth[1, 1, 1] = 5.0, 0.0
    on_object = torch.zeros(2, 3, 4, dtype=torch.bool)
    on_object[0, :, :2] = True
    on_object[1, 0, 0] = True
    blank = blank_frames(2, (4, 3))
    camera = torch.tensor([[40.0, 40.0, 1.5, 1.0]]).repeat(2, 1)
    # the network was told another mask
    inputs = replace(blank.inputs, depth=truth, mask=~blank.inputs.mask, intrinsics=camera)
    return image, replace(blank, inputs=inputs, true_depth=truth, object_mask=on_object)


def test_todes_loss_by_hand() -> None:
    image, batch = two_walls()
    found = losses("tode", batch, image=image)
    column = [abs(0.5 / (1 - (c - 1.5) / 40) - 0.5) for c in range(4)]
    depth = (3 * sum(column[:2]) + 0.1) / 7
    everywhere = (3 * sum(column) + 11 * 0.1) / 23
    turned = 1 - 0.5**0.5
    # Six normals a frame; three of the second one need the unknown pixel. On the object: 4 and 1.
    normals, all_normals = 4 * turned / 5, 6 * turned / 9
    assert found["depth"] == pytest.approx(depth, abs=1e-6)
    assert found["depth_everywhere"] == pytest.approx(everywhere, abs=1e-6)
    assert found["normals"] == pytest.approx(normals, abs=1e-4)
    assert found["normals_everywhere"] == pytest.approx(all_normals, abs=1e-4)
    total = depth + 0.01 * everywhere + 0.1 * (normals + 0.01 * all_normals)
    assert found["loss"] == pytest.approx(total, abs=2e-5)


def test_without_truth_or_without_an_answer_gradients_stay_numbers() -> None:
    image, batch = two_walls()
    for answer, truth in ((image, torch.zeros_like(image)), (0 * image, batch.true_depth)):
        answer = answer.clone().requires_grad_()
        found = terms("tode", replace(batch, true_depth=truth), image=answer)
        found["loss"].backward()
        assert torch.isfinite(found["loss"])
        assert torch.isfinite(answer.grad).all()
        assert (found["loss"].item() > 0) == bool(truth.any())


def batch_of(frames: FrameTensors, truth: Tensor, counted: Tensor) -> FrameTensors:
    few = frames.take(range(len(truth)))
    return replace(few, inputs=replace(few.inputs, mask=counted), true_depth=truth)


def test_the_u_nets_depth_and_steps_by_hand_and_each_frame_counts_the_same(frames):
    truth = torch.full((2, 2, 3), 0.5)
    depth = truth.clone()
    depth[0] += torch.tensor([[0.01, 0.01, 0.03], [0.01, 0.0, 9.0]])
    depth[1] += 0.04  # displaced as a whole: no wrong step
    counted = torch.ones(2, 2, 3, dtype=torch.bool)
    counted[0, 1, 2] = False
    counted[1, 1] = False
    found = losses("unet-hand", batch_of(frames, truth, counted), depth=depth)
    # frame 0: (10 + 10 + 30 + 10 + 0) / 5 = 12 mm; frame 1: 40 mm
    assert found["depth"] == pytest.approx(0.026, abs=1e-6)
    # frame 0: columns 0, 20, 10 and rows 0, 10 mm over five steps = 8 mm; frame 1: 0
    assert found["step"] == pytest.approx(0.004, abs=1e-6)
    assert found["loss"] == pytest.approx(20 * 0.030, rel=1e-5)


def test_frames_in_which_nothing_counts_do_not_count(frames: FrameTensors) -> None:
    assert frame_mean(torch.tensor([6.0, 0.0]), torch.tensor([2, 0])).item() == 3
    depth, nothing = torch.ones(1, 2, 2, requires_grad=True), torch.zeros(1, 2, 2)
    found = terms("unet-hand", batch_of(frames, nothing, nothing.bool()), depth=depth)
    found["loss"].backward()
    assert found["loss"].item() == 0
    assert torch.equal(depth.grad, nothing)
