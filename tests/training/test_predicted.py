from __future__ import annotations

from pathlib import Path

import pytest
import torch

from hadr.models.hadr import HADR
from hadr.models.hand_keypoints import HandKeypointNet
from hadr.models.segmentation import SegmentationNet
from hadr.training import predicted
from hadr.training.batches import FrameTensors
from hadr.training.checkpoints import save_checkpoint
from hadr.training.predicted import Given, pixels_of, with_predicted
from hadr.training.presets import Preset, preset


def test_true_ones_leave_the_frames_alone(frames: FrameTensors) -> None:
    assert with_predicted(frames, Given()) is frames


def test_predicted_masks_and_keypoints_are_given_and_the_true_ones_kept(
    frames: FrameTensors, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    segmentation = SegmentationNet(preset("tiny", "segmentation").model)  # type: ignore[arg-type]
    keypoints = HandKeypointNet(preset("tiny", "hand-keypoints").model)  # type: ignore[arg-type]
    save_checkpoint(tmp_path / "masks.safetensors", segmentation, {})
    save_checkpoint(tmp_path / "hands.safetensors", keypoints, {})
    shifted = frames.object_mask.roll(2, dims=2)

    def masks(_: object, part: FrameTensors) -> torch.Tensor:
        rows = [frames.stems.index(stem) for stem in part.stems]
        hand = frames.hand_mask[rows].clone()
        hand[[row == 5 for row in rows]] = False  # the last frame's hand is not seen
        return torch.stack((shifted[rows], hand), dim=1)

    monkeypatch.setattr(predicted, "_masks", masks)
    given = Given("oracle", tmp_path / "masks.safetensors", tmp_path / "hands.safetensors")
    found = with_predicted(frames, given, batch_size=4)
    assert torch.equal(found.inputs.mask, shifted)
    assert torch.equal(found.object_mask, frames.object_mask)
    erased = shifted | frames.object_mask
    assert torch.equal(found.inputs.depth == 0, erased)
    assert torch.equal(found.true_keypoints, frames.true_keypoints)
    assert (found.inputs.keypoints[:5] != 0).all()
    assert not found.inputs.keypoints[5].any()
    assert not found.inputs.keypoints_uv[5].any()
    sensor = with_predicted(frames, Given("sensor", tmp_path / "masks.safetensors"))
    assert torch.equal(sensor.inputs.depth, frames.inputs.depth)
    assert torch.equal(sensor.inputs.keypoints, frames.inputs.keypoints)


def test_a_checkpoint_of_another_network_is_refused(
    frames: FrameTensors, micro: Preset, tmp_path: Path
) -> None:
    save_checkpoint(tmp_path / "hadr.safetensors", HADR(micro.model), {})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="of kind 'hadr', expected 'segmentation'"):
        with_predicted(frames, Given("oracle", tmp_path / "hadr.safetensors"))


def test_pixels_hand_computed() -> None:
    points = torch.tensor([[[0.1, -0.2, 0.5]]])
    uv = pixels_of(points, torch.tensor([[100.0, 50.0, 10.0, 20.0]]))
    assert uv[0, 0].tolist() == pytest.approx([30.0, 0.0])
