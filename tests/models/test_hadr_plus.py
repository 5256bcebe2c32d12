import math
from dataclasses import replace

import pytest
import torch

from hadr.data.samples import open_samples
from hadr.models.hadr_plus import HADRPlus, HADRPlusConfig, _share_within
from hadr.training.frames.batches import load_frames

SMALL = HADRPlusConfig(crop=64, pixel_m=0.0045, width=16, blocks=1)


@pytest.fixture(scope="module")
def batch():
    return load_frames(open_samples("train")[:3], (256, 144)).take(range(3))


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    return HADRPlus(SMALL).eval()


def silent(config):
    """A network that says nothing: its candidates lie where they start."""
    network = HADRPlus(config).eval()
    for layer in (network.coarse[1], network.fine[1], network.unet.answer):
        torch.nn.init.zeros_(layer.weight)
        torch.nn.init.zeros_(layer.bias)
    return network


def restored(network, inputs):
    with torch.no_grad():
        return network(inputs)


def test_every_pixel_of_the_mask_is_restored_near_the_hand(network, batch):
    output = restored(network, batch.inputs)
    mask = batch.inputs.mask
    assert torch.equal(output.restored, mask)
    assert (output.depth[~mask] == 0).all()
    assert (output.confidence[~mask] == 0).all()
    prior = batch.inputs.keypoints[:, :, 2].median(dim=1).values
    away = (output.depth - prior[:, None, None])[mask].abs()
    assert away.max() < 0.5
    assert ((output.confidence[mask] > 0) & (output.confidence[mask] <= 1)).all()


def test_measured_depth_in_the_mask_is_not_looked_at(network, batch):
    spoiled = torch.where(batch.inputs.mask, 0.33, batch.inputs.depth)
    other = restored(network, replace(batch.inputs, depth=spoiled))
    assert torch.equal(other.depth, restored(network, batch.inputs).depth)


def test_a_scene_twice_as_large_and_far_is_the_same_scene(network, batch):
    """All lengths doubled, same picture: relative to the hand only the unit of depth changes.

    The crop's pixel is a fixed length, so the object fills twice as many crop pixels: with pixels
    of twice the length the network sees the same crop but for depths in metres.
    """
    inputs = batch.inputs
    far = replace(inputs, depth=2 * inputs.depth, keypoints=2 * inputs.keypoints)
    near_crop = network.crop(inputs)
    double = HADRPlus(replace(SMALL, pixel_m=2 * SMALL.pixel_m))
    far_crop = double.crop(far)
    assert torch.allclose(near_crop.step, far_crop.step)
    assert torch.allclose(2 * near_crop.prior, far_crop.prior)
    same = [0, 1, 2, 3, *range(6, 12), 18, 19]  # colour, mask, blobs, ray
    seen, seen_far = network.pictures(inputs, near_crop), double.pictures(far, far_crop)
    assert torch.allclose(seen[:, same], seen_far[:, same], atol=1e-6)


@pytest.mark.parametrize("switch", ["color", "hand_depth", "keypoint_maps"])
def test_a_switch_blanks_its_channels_and_no_others(network, batch, switch):
    channels = {"color": (0, 3), "hand_depth": (4, 6), "keypoint_maps": (6, 18)}
    off = HADRPlus(replace(SMALL, **{switch: False}))
    crop = network.crop(batch.inputs)
    seen, blanked = network.pictures(batch.inputs, crop), off.pictures(batch.inputs, crop)
    low, high = channels[switch]
    assert (blanked[:, low:high] == 0).all()
    assert seen[:, low:high].abs().sum() > 0
    rest = [n for n in range(seen.shape[1]) if not low <= n < high]
    assert torch.equal(seen[:, rest], blanked[:, rest])


def test_the_plane_lies_below_the_candidates_at_its_place_in_metres(batch):
    network = silent(SMALL)
    network.start.zero_()
    # 3 cm before the hand at the crop's centre, 0.2 m a metre to the right, 0.4 down.
    network.unet.answer.bias.data = torch.tensor([-1.0, 0.5, 1.0])
    inputs = batch.inputs
    output, crop = restored(network, inputs), network.crop(inputs)
    for frame, row, column in output.rays[::37].tolist():
        prior, (fx, fy) = crop.prior[frame], inputs.intrinsics[frame, :2]
        across = (column - crop.center[frame, 0]) / fx * prior
        down = (row - crop.center[frame, 1]) / fy * prior
        expected = prior - 0.03 + 0.2 * across + 0.4 * down
        assert output.depth[frame, row, column].item() == pytest.approx(expected.item(), abs=1e-4)
    mask = inputs.mask
    assert torch.allclose(output.plane, output.depth[mask], atol=1e-6)


def test_the_likelier_candidate_is_the_answer_and_its_confidence_is_by_hand(batch):
    network = silent(replace(SMALL, plane=False))
    network.coarse[1].bias.data[2:4] = torch.tensor([0.0, 2.0])  # scores
    output, mask = restored(network, batch.inputs), batch.inputs.mask
    # Candidates 3 cm before the hand and 3 cm behind it, whose scale is exp(-3.5) metres.
    hand = network.crop(batch.inputs).prior[output.rays[:, 0]]
    torch.testing.assert_close(output.depth[mask], hand + 0.03, atol=1e-5, rtol=0)
    scale, share = math.exp(-3.5), 1 / (1 + math.exp(-2))
    near, far = (1 - math.exp(-width / scale) for width in (0.04, 0.08))
    sure = share * (1 - math.exp(-0.02 / scale)) + (1 - share) * (far - near) / 2
    assert output.confidence[mask].tolist() == pytest.approx([sure] * len(hand), abs=1e-5)


def test_without_plane_nothing_is_guessed(batch):
    assert restored(HADRPlus(replace(SMALL, plane=False)).eval(), batch.inputs).plane is None


def test_the_keypoints_vector_is_in_metres_around_the_crop(network, batch):
    inputs = batch.inputs
    crop = network.crop(inputs)
    known = network.keypoints(inputs, crop)
    points = known[:, :63].reshape(-1, 21, 3) / 10
    deep = inputs.keypoints[:, :, 2] - crop.prior[:, None]
    assert torch.allclose(points[:, :, 2], deep, atol=1e-6)
    # A keypoint as deep as the hand's median lies where the camera sees it.
    for frame in range(len(inputs)):
        number = int(deep[frame].abs().argmin())
        (fx, fy, cx, cy), prior = inputs.intrinsics[frame].tolist(), crop.prior[frame].item()
        x = (crop.center[frame, 0].item() - cx) / fx * prior
        y = (crop.center[frame, 1].item() - cy) / fy * prior
        expected = inputs.keypoints[frame, number, :2] - torch.tensor([x, y])
        assert torch.allclose(points[frame, number, :2], expected, atol=1e-3)
    off = HADRPlus(replace(SMALL, hand_vector=False))
    assert (off.keypoints(inputs, crop) == 0).all()


def test_without_metric_crop_all_frames_have_one_scale(batch):
    crop = HADRPlus(replace(SMALL, metric_crop=False)).crop(batch.inputs)
    assert torch.allclose(crop.step, crop.step[:1].expand_as(crop.step))


def test_spread_of_two_candidates_by_hand(network, batch):
    output = restored(network, batch.inputs)
    depth = output.depth[output.restored]
    two = torch.stack((depth - 0.03, depth + 0.01), dim=1)
    even = replace(
        output,
        candidate=two,
        logits=torch.zeros_like(two),
        log_scale=torch.full_like(two, math.log(0.01)),
    )
    # Means 4 cm apart: 2 cm off the middle each; a Laplace distribution's variance is 2 b^2.
    expected = math.sqrt(0.02**2 + 2 * 0.01**2)
    assert even.spread[output.restored].tolist() == pytest.approx([expected] * len(depth), rel=1e-3)
    assert (even.spread[~output.restored] == 0).all()


def test_probability_of_being_within_a_width():
    # A Laplace distribution of scale b: P(|x| < w) = 1 - exp(-w / b).
    scale = torch.tensor([0.02, 0.01])
    found = _share_within(0.02, torch.zeros(2), scale)
    assert found.tolist() == pytest.approx([1 - 0.36787944, 1 - 0.13533528], rel=1e-5)
    shifted = _share_within(0.02, torch.tensor([0.02]), torch.tensor([0.01]))
    assert shifted.item() == pytest.approx(0.5 * (1 - 0.01831564), rel=1e-4)


def test_a_crop_that_cannot_be_halved_five_times_is_named():
    with pytest.raises(ValueError, match=r"crop must be .* 32, got 50"):
        replace(SMALL, crop=50)


def test_a_frame_without_hand_is_named(network, batch):
    lost = replace(batch.inputs, keypoints=torch.zeros_like(batch.inputs.keypoints))
    with pytest.raises(ValueError, match="frame 0 of the batch has no hand"):
        network(lost)
