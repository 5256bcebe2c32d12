from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from hadr.training.batches import FrameTensors
from hadr.training.checkpoints import load_checkpoint
from hadr.training.loop import BEST, LAST, train
from hadr.training.losses import CODED
from hadr.training.presets import Preset


def same_weights(a: torch.nn.Module, b: torch.nn.Module) -> bool:
    other = b.state_dict()
    return all(torch.equal(value, other[name]) for name, value in a.state_dict().items())


def test_a_resumed_training_ends_with_the_same_weights(
    tmp_path: Path, micro: Preset, frames: FrameTensors
) -> None:
    through = train(micro, frames, frames, folder=tmp_path / "a", seed=3, progress=False)
    train(micro, frames, frames, folder=tmp_path / "b", seed=3, stop_after=2, progress=False)
    torch.manual_seed(999)  # whatever happened in between
    resumed = train(
        micro, frames, frames, folder=tmp_path / "b", seed=3, resume=True, progress=False
    )
    assert same_weights(through.model, resumed.model)
    assert [row["epoch"] for row in resumed.history] == [0, 1, 2, 3]
    for one, two in zip(through.history, resumed.history, strict=True):
        assert {**one, "seconds": 0} == {**two, "seconds": 0}


def test_resuming_needs_the_optimizers_state_and_the_seed(
    tmp_path: Path, micro: Preset, frames: FrameTensors, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = replace(micro, epochs=2)
    through = train(short, frames, seed=3, progress=False)
    assert not same_weights(through.model, train(short, frames, seed=4, progress=False).model)
    train(short, frames, folder=tmp_path, seed=3, stop_after=1, progress=False)
    monkeypatch.setattr("hadr.training.training_folder.load_training_state", lambda _: {})
    forgetful = train(short, frames, folder=tmp_path, seed=3, resume=True, progress=False)
    assert not same_weights(through.model, forgetful.model)


def test_history_and_checkpoints_are_written(
    tmp_path: Path, micro: Preset, frames: FrameTensors
) -> None:
    trained = train(micro, frames, frames, folder=tmp_path, progress=False)
    with (tmp_path / "history.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["rate"]) for row in rows] == pytest.approx([1e-3, 1e-3, 1e-3, 1e-4])
    assert float(rows[2]["loss"]) == trained.history[2]["loss"]
    last, meta = load_checkpoint(tmp_path / LAST)
    assert same_weights(last, trained.model)
    assert (meta["width"], meta["height"], meta["epochs"]) == (32, 24, 4)
    _, best_meta = load_checkpoint(tmp_path / BEST)
    errors = [row["validation_rmse_m"] for row in trained.history]
    assert best_meta["epochs"] - 1 == errors.index(min(errors))
    assert not list(tmp_path.glob(".*"))  # no temporary file stays


def test_the_loss_falls_on_frames_that_are_seen_often(micro: Preset, frames: FrameTensors) -> None:
    longer = replace(
        micro,
        epochs=40,
        drop_epoch=30,
        augment=False,
        model=replace(micro.model, backbone=replace(micro.model.backbone, drop_path=0.0)),
    )
    trained = train(longer, frames, frames, progress=False)
    first, last = trained.history[0], trained.history[-1]
    assert last["loss"] < 0.2 * first["loss"]
    assert last["validation_mae_m"] < 0.03


def test_strided_rays_train_too(micro: Preset, frames: FrameTensors) -> None:
    trained = train(replace(micro, ray_stride=2, epochs=2), frames, progress=False)
    assert 0 < trained.history[-1]["depth"] < 0.5


def test_resume_refuses_another_training(
    tmp_path: Path, micro: Preset, frames: FrameTensors
) -> None:
    short = replace(micro, epochs=1)
    train(short, frames, folder=tmp_path, progress=False)
    with pytest.raises(ValueError, match="was trained with seed 0, not 1"):
        train(short, frames, folder=tmp_path, seed=1, resume=True, progress=False)
    other = replace(short, model=replace(short.model, hand="none"))
    with pytest.raises(ValueError, match=r"preset 'micro' with another\s+network"):
        train(other, frames, folder=tmp_path, resume=True, progress=False)
    with pytest.raises(ValueError, match="resume and tensorboard need the folder"):
        train(short, frames, resume=True, progress=False)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": CODED}, "trained with weights"),
        ({"drop_epoch": 1}, "trained with drop_epoch"),
        ({"batch_size": 1}, "trained with batch_size"),
    ],
)
def test_resume_refuses_another_recipe_and_names_the_difference(
    micro: Preset, frames: FrameTensors, tmp_path: Path, change, message
) -> None:
    short = replace(micro, epochs=1, drop_epoch=5, batch_size=2)
    train(short, frames, folder=tmp_path, progress=False)
    with pytest.raises(ValueError, match=message):
        train(replace(short, **change), frames, folder=tmp_path, resume=True, progress=False)


def test_resume_refuses_other_data(micro: Preset, frames: FrameTensors, tmp_path: Path) -> None:
    short = replace(micro, epochs=1)
    train(short, frames, folder=tmp_path, data={"corruption": "oracle"}, progress=False)
    with pytest.raises(ValueError, match="corruption = oracle, not sensor"):
        train(
            short,
            frames,
            folder=tmp_path,
            data={"corruption": "sensor"},
            resume=True,
            progress=False,
        )


def test_a_training_is_not_overwritten(micro: Preset, frames: FrameTensors, tmp_path: Path) -> None:
    short = replace(micro, epochs=1)
    train(short, frames, folder=tmp_path, progress=False)
    before = (tmp_path / "last.safetensors").read_bytes()
    with pytest.raises(ValueError, match="holds a training already"):
        train(short, frames, folder=tmp_path, progress=False)
    assert (tmp_path / "last.safetensors").read_bytes() == before
