from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from hadr.data.frame import Frame, write_frame
from hadr.data.samples import open_samples
from hadr.models.hand.keypoints import HandKeypointNet
from hadr.models.segmentation import SegmentationNet
from hadr.training.checkpoints import save_checkpoint
from hadr.training.frames import predicted
from hadr.training.frames.batches import FrameTensors, load_frames
from hadr.training.frames.predicted import hand_known, pixels_of, read_split, with_predicted
from hadr.training.presets import preset
from hadr.training.recipe import Given

SIZE, OWN = (64, 36), (128, 72)
"""Size of the frames, and that at which the helpers were trained."""


@pytest.fixture(scope="module")
def source() -> list[Frame]:
    samples = open_samples("val")
    return [samples[number] for number in (0, 20, 40, 60, 80, 90)]


@pytest.fixture
def helpers(tmp_path: Path) -> tuple[Path, Path]:
    """Checkpoints of both helpers, untrained."""
    segmentation = SegmentationNet(preset("tiny", "segmentation").model)  # type: ignore[arg-type]
    keypoints = HandKeypointNet(preset("tiny", "hand-keypoints").model)  # type: ignore[arg-type]
    paths = tmp_path / "masks.safetensors", tmp_path / "hands.safetensors"
    for path, model in zip(paths, (segmentation, keypoints), strict=True):
        save_checkpoint(path, model, {"width": OWN[0], "height": OWN[1]})
    return paths


def test_true_ones_leave_the_frames_alone(source: list[Frame]) -> None:
    frames = load_frames(source, SIZE)
    assert with_predicted(frames, source, Given()) is frames


def see_truth(monkeypatch: pytest.MonkeyPatch, blind: str = "") -> list[tuple[int, ...]]:
    """Let the segmentation answer with the true masks, but for one frame's hand."""
    sizes: list[tuple[int, ...]] = []

    def masks(_: object, part: FrameTensors) -> torch.Tensor:
        sizes.append(tuple(part.object_mask.shape[1:]))
        hand = part.hand_mask.clone()
        hand[[stem == blind for stem in part.stems]] = False
        return torch.stack((part.object_mask, hand), dim=1)

    monkeypatch.setattr(predicted, "_masks", masks)
    return sizes


def test_each_helper_works_at_its_own_size(source, helpers, monkeypatch):
    frames = load_frames(source[:1] + source[2:], SIZE)  # one of the source is not among them
    blind = frames.stems[-1]
    sizes = see_truth(monkeypatch, blind)
    found = with_predicted(frames, source, Given("oracle", *helpers), batch_size=4)
    assert set(sizes) == {(OWN[1], OWN[0])}
    # The larger mask's pixels nearest to the small ones are the small mask, but for its rim.
    wrong = (found.inputs.mask ^ frames.object_mask).float().mean()
    assert wrong < 0.2 * frames.object_mask.float().mean()
    assert torch.equal(found.object_mask, frames.object_mask)
    assert torch.equal(found.inputs.depth == 0, found.inputs.mask | (frames.inputs.depth == 0))
    assert torch.equal(found.true_keypoints, frames.true_keypoints)
    assert (found.inputs.keypoints[:-1] != 0).any(dim=(1, 2)).all()
    assert not found.inputs.keypoints[-1].any()
    assert not found.inputs.keypoints_uv[-1].any()
    assert found.hand_mask.flatten(1).any(dim=1).tolist() == [True] * 4 + [False]


def test_the_same_keypoints_whatever_the_size_of_the_frames(source, helpers, monkeypatch):
    see_truth(monkeypatch)
    small, large = (
        with_predicted(load_frames(source, size), source, Given("oracle", *helpers))
        for size in (SIZE, (224, 126))
    )
    torch.testing.assert_close(small.inputs.keypoints, large.inputs.keypoints)
    apart = small.inputs.keypoints_uv - large.inputs.keypoints_uv * SIZE[0] / 224
    assert apart.abs().max() < 0.5


def test_depth_of_a_sensor_is_left_in_the_mask(source, helpers, monkeypatch):
    see_truth(monkeypatch)
    frames = load_frames(source, SIZE, "sensor")
    found = with_predicted(frames, source, Given("sensor", helpers[0]))
    assert torch.equal(found.inputs.depth, frames.inputs.depth)
    assert torch.equal(found.inputs.keypoints, frames.inputs.keypoints)


def test_a_network_that_finds_nothing_at_all_is_refused(source, helpers, monkeypatch):
    monkeypatch.setattr(
        predicted, "_masks", lambda _, part: torch.zeros(len(part), 2, OWN[1], OWN[0]) > 0
    )
    with pytest.raises(ValueError, match="finds no object in any of the 6 frames"):
        with_predicted(load_frames(source, SIZE), source, Given("oracle", helpers[0]))


def test_frames_of_another_source_are_refused(source, helpers):
    with pytest.raises(ValueError, match="is not in the source, or out of its order"):
        with_predicted(load_frames(source, SIZE), source[1:], Given("oracle", helpers[0]))


def test_a_training_that_needs_the_hand_names_the_frame_without_one(tmp_path, helpers, glass_frame):
    blind = glass_frame("000002")
    for frame in (glass_frame(), replace(blind, hand_mask=blind.hand_mask & False)):
        write_frame(tmp_path / "data", frame)
    asked = [tmp_path / "data"], "train", SIZE, Given(keypoints=str(helpers[1]))
    found = read_split(*asked, network="hadr")
    assert hand_known(found.inputs).tolist() == [True, False]
    with pytest.raises(ValueError, match=r"of 1 of the 2 frames .* the first is 0004/000002"):
        read_split(*asked, network="unet-hand")


def test_pixels_hand_computed() -> None:
    points = torch.tensor([[[0.1, -0.2, 0.5]]])
    uv = pixels_of(points, torch.tensor([[100.0, 50.0, 10.0, 20.0]]))
    assert uv[0, 0].tolist() == pytest.approx([30.0, 0.0])
