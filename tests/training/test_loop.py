from __future__ import annotations

import csv
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import pytest
import torch

from hadr.models.networks import NETWORKS
from hadr.records.provenance import usable_cores
from hadr.training.checkpoints import load_checkpoint, update_record
from hadr.training.frames.batches import FrameTensors
from hadr.training.loop import (
    Trained,
    average_of,
    batch_workers,
    early_look,
    optimizer_of,
    train,
)
from hadr.training.losses import CODED
from hadr.training.presets import preset
from hadr.training.recipe import Preset
from hadr.training.tasks.task import Task
from hadr.training.training_folder import BEST, LAST, TrainingFolder


def same_weights(a: torch.nn.Module, b: torch.nn.Module) -> bool:
    other = b.state_dict()
    return all(torch.equal(value, other[name]) for name, value in a.state_dict().items())


def test_a_resumed_training_ends_with_the_same_weights(tmp_path, micro, frames, through):
    train(micro, frames, frames, folder=tmp_path, seed=3, stop_after=2, progress=False)
    torch.manual_seed(999)  # whatever happened in between
    resumed = train(micro, frames, frames, folder=tmp_path, seed=3, resume=True, progress=False)
    assert same_weights(through[0].model, resumed.model)
    assert [row["epoch"] for row in resumed.history] == [0, 1, 2, 3]
    for one, two in zip(through[0].history, resumed.history, strict=True):
        assert {**one, "seconds": 0} == {**two, "seconds": 0}


def test_batches_that_other_processes_prepare_train_alike(micro, frames, through, monkeypatch):
    asked: list[str] = []

    def two(device: torch.device) -> int:
        asked.append(device.type)
        return 2

    assert batch_workers(torch.device("cpu")) == 0  # a GPU gets some, where there are cores
    assert batch_workers(torch.device("cuda")) == min(4, usable_cores() - 1)
    monkeypatch.setattr("hadr.training.loop.batch_workers", two)
    prepared = train(micro, frames, frames, seed=3, progress=False)
    assert asked == ["cpu"]
    assert same_weights(through[0].model, prepared.model)


def test_a_training_that_began_with_published_weights_is_resumed(tmp_path, frames):
    recipe = preset("imagenet", "unet-hand")
    small = replace(recipe.model, width=8, view=replace(recipe.model.view, size=32))
    recipe = replace(recipe, width=64, height=36, epochs=2, model=small)
    train(recipe, frames, folder=tmp_path, stop_after=1, progress=False)
    resumed = train(recipe, frames, folder=tmp_path, resume=True, progress=False)
    assert [row["epoch"] for row in resumed.history] == [0, 1]
    at_once = train(recipe, frames, progress=False)
    assert same_weights(at_once.model, resumed.model)


def test_encoders_follow_the_schedule_from_their_own_rate(tmp_path, micro, frames, monkeypatch):
    rates: list[tuple[float, ...]] = []

    class Watched(torch.optim.Adam):
        def step(self, closure: Any = None) -> Any:
            rates.append(tuple(group["lr"] for group in self.param_groups))
            return super().step(closure)

    monkeypatch.setattr("torch.optim.Adam", Watched)
    recipe = replace(micro, encoder_rate=1 / 8)
    through = train(recipe, frames, folder=tmp_path / "a", seed=3, progress=False)
    # Six frames in batches of four: two steps an epoch; the fourth epoch has a tenth of the rate.
    assert [fast for fast, _ in rates] == [1e-3] * 6 + [pytest.approx(1e-4)] * 2
    assert [slow for _, slow in rates] == [fast / 8 for fast, _ in rates]
    train(recipe, frames, folder=tmp_path / "b", seed=3, stop_after=3, progress=False)
    rates.clear()
    resumed = train(recipe, frames, folder=tmp_path / "b", seed=3, resume=True, progress=False)
    assert rates == [(pytest.approx(1e-4), pytest.approx(1.25e-5))] * 2
    assert same_weights(through.model, resumed.model)


@pytest.mark.parametrize("kind", sorted(NETWORKS))
def test_of_each_network_the_encoders_have_their_own_rate(kind: str) -> None:
    recipe = replace(preset("tiny", kind), encoder_rate=0.5)
    network = Task(recipe).build()
    found = NETWORKS[kind].encoders_of(network).items()
    inside = [part for name, part in found if name.endswith(("swin", "lite"))]
    assert bool(inside) == (kind in ("hadr", "swindrnet", "tode"))  # without a Lite0
    wanted = {id(weight) for part in inside for weight in part.parameters()}
    groups = optimizer_of(recipe, network).param_groups
    assert [group["lr"] / recipe.learning_rate for group in groups] == [1, 0.5][: 1 + bool(inside)]
    assert {id(weight) for group in groups[1:] for weight in group["params"]} == wanted
    everything = {id(weight) for group in groups for weight in group["params"]}
    assert everything == {id(weight) for weight in network.parameters()}


def test_another_seed_is_another_training(micro: Preset, frames: FrameTensors) -> None:
    short = replace(micro, epochs=2)
    through = train(short, frames, seed=3, progress=False)
    assert not same_weights(through.model, train(short, frames, seed=4, progress=False).model)


def test_each_epoch_sees_all_frames_in_an_order_of_its_own(micro, frames, monkeypatch):
    seen: list[tuple[str, ...]] = []
    losses = Task.losses

    def watched(task: Task, model: Any, batch: FrameTensors, *further: Any) -> Any:
        seen.append(batch.stems)
        return losses(task, model, batch, *further)

    monkeypatch.setattr(Task, "losses", watched)
    train(replace(micro, epochs=2), frames, progress=False)
    orders = seen[0] + seen[1], seen[2] + seen[3]  # six frames in batches of four
    assert [sorted(order) for order in orders] == [list(frames.stems)] * 2
    assert len({*orders, frames.stems}) == 3


def test_what_a_training_cannot_go_on_from_is_refused(tmp_path, micro, frames):
    def resumed() -> None:
        train(short, frames, frames, folder=tmp_path, seed=3, resume=True, progress=False)

    short = replace(micro, epochs=2)
    with pytest.raises(FileNotFoundError, match=r"no .*last\.safetensors to go on from"):
        resumed()
    train(short, frames, frames, folder=tmp_path, seed=3, stop_after=1, progress=False)
    last, best = tmp_path / "last.safetensors", tmp_path / "best.safetensors"
    whole = last.read_bytes()
    for field, value, said in (
        ("history", [], "epochs is 1, but history has 0 rows"),
        ("epochs", 9, "epochs is 9, but history has 1 rows"),
        ("score", "x", "score is 'x', which is no column of history"),
        ("score", None, r"score is null, but history has scores \(validation_rmse_m\)"),
        ("seed", None, "seed: must be a whole number, got None"),
        ("preset", 7, "preset: must be named values, got 7"),
    ):
        last.write_bytes(whole)
        update_record(last, {field: value})
        with pytest.raises(ValueError, match=rf"last\.safetensors: {said}"):
            resumed()
    shutil.copy(best, last)
    with pytest.raises(ValueError, match="lacks the optimiser's state"):
        resumed()


def test_history_and_checkpoints_are_written(through: tuple[Trained, Path]) -> None:
    trained, folder = through
    with (folder / "history.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["rate"]) for row in rows] == pytest.approx([1e-3, 1e-3, 1e-3, 1e-4])
    assert float(rows[2]["loss"]) == trained.history[2]["loss"]
    last, meta = load_checkpoint(folder / LAST)
    assert same_weights(last, trained.model)
    assert (meta["width"], meta["height"], meta["epochs"]) == (32, 24, 4)
    _, best_meta = load_checkpoint(folder / BEST)
    errors = [row["validation_rmse_m"] for row in trained.history]
    assert best_meta["epochs"] - 1 == errors.index(min(errors))
    assert not list(folder.glob(".*"))  # no temporary file stays


def test_strided_rays_train_too(micro: Preset, frames: FrameTensors) -> None:
    trained = train(replace(micro, ray_stride=2, epochs=2), frames, progress=False)
    assert 0 < trained.history[-1]["depth"] < 0.5


def test_resume_refuses_another_training(tmp_path, micro, frames):
    short = replace(micro, epochs=1)
    train(short, frames, folder=tmp_path, progress=False)
    with pytest.raises(ValueError, match="was trained with seed 0, not 1"):
        train(short, frames, folder=tmp_path, seed=1, resume=True, progress=False)
    other = replace(short, model=replace(short.model, hand="none"))
    with pytest.raises(ValueError, match=r"preset 'micro' with another\s+network"):
        train(other, frames, folder=tmp_path, resume=True, progress=False)
    another = replace(preset("tiny", "unet-hand"), name="micro", epochs=1)
    with pytest.raises(ValueError, match=r"preset 'micro' with another\s+network"):
        train(another, frames, folder=tmp_path, resume=True, progress=False)
    with pytest.raises(ValueError, match="resume and tensorboard need the folder"):
        train(short, frames, resume=True, progress=False)


@pytest.mark.parametrize(
    ("change", "data", "message"),
    [
        ({"weights": CODED}, "oracle", "trained with weights"),
        ({"drop_epoch": 1}, "oracle", "trained with drop_epoch"),
        ({"batch_size": 1}, "oracle", "trained with batch_size"),
        ({}, "sensor", "corruption = oracle, not sensor"),
    ],
)
def test_resume_refuses_another_recipe_or_other_data_and_names_the_difference(
    micro: Preset, frames: FrameTensors, tmp_path: Path, change, data, message
) -> None:
    short = replace(micro, epochs=1, drop_epoch=5, batch_size=2)
    again = partial(train, frames=frames, folder=tmp_path, progress=False)
    again(short, data={"corruption": "oracle"})
    with pytest.raises(ValueError, match=message):
        again(replace(short, **change), data={"corruption": data}, resume=True)


def test_a_training_is_not_overwritten(micro: Preset, frames: FrameTensors, tmp_path: Path) -> None:
    short = replace(micro, epochs=1)
    train(short, frames, folder=tmp_path, progress=False)
    before = (tmp_path / "last.safetensors").read_bytes()
    with pytest.raises(ValueError, match="holds a training already"):
        train(short, frames, folder=tmp_path, progress=False)
    assert (tmp_path / "last.safetensors").read_bytes() == before


def test_the_best_epoch_is_mended_after_a_kill_between_two_files(
    tmp_path: Path,
    micro: Preset,
    frames: FrameTensors,
    through: tuple[Trained, Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import hadr.training.checkpoints as home

    (whole, one), two = through, tmp_path
    again = partial(train, micro, frames, frames, folder=two, seed=3, progress=False)
    best = load_checkpoint(one / BEST)[1]["epochs"]
    write = home.save_checkpoint

    def killed(path: Path, *args: Any, **kwargs: Any) -> None:
        if path.name == BEST and args[1]["epochs"] == best:
            raise KeyboardInterrupt
        write(path, *args, **kwargs)

    monkeypatch.setattr(home, "save_checkpoint", killed)
    with pytest.raises(KeyboardInterrupt):
        again()
    monkeypatch.setattr(home, "save_checkpoint", write)
    assert load_checkpoint(two / LAST)[1]["epochs"] == best
    short = again(resume=True, stop_after=best)
    assert len(short.history) == best  # nothing was trained, and yet all is in line:
    assert load_checkpoint(two / BEST)[1]["epochs"] == best
    assert len((two / "history.csv").read_text(encoding="utf-8").splitlines()) == best + 1
    again(resume=True)
    for name in (LAST, BEST):
        mine, theirs = load_checkpoint(one / name)[0], load_checkpoint(two / name)[0]
        assert same_weights(mine, theirs)
    assert same_weights(whole.model, load_checkpoint(two / LAST)[0])


def test_a_history_that_somebody_changed_is_kept(micro, frames, tmp_path):
    again = partial(train, micro, frames, folder=tmp_path, progress=False)
    again(stop_after=1)
    again(resume=True, stop_after=2)
    history = tmp_path / "history.csv"
    assert not list(tmp_path.glob("*.changed*")), "it had grown, and nothing else"
    history.write_text("mine")
    again(resume=True)
    assert (tmp_path / "history.csv.changed").read_text() == "mine"
    assert history.read_text().startswith("epoch,")


def test_a_number_that_later_epochs_add_is_no_change_of_the_history(micro, tmp_path):
    home = TrainingFolder(tmp_path, micro, 0, None)
    rows = [{"epoch": 0.0}, {"epoch": 1.0, "first_depth": 0.5}]
    home._write_history(rows[:1])
    home._write_history(rows)
    home._write_history(rows)  # as where it was stopped before the checkpoint
    assert not list(tmp_path.glob("*.changed*"))
    assert (tmp_path / "history.csv").read_text().split() == [
        "epoch,first_depth",
        "0.0,",
        "1.0,0.5",
    ]


def test_the_average_of_the_weights_is_the_result_and_is_resumed(tmp_path, micro, frames, through):
    averaging = partial(train, replace(micro, average_decay=0.9), frames, seed=3, progress=False)
    plain, averaged = through[0], averaging()
    assert not same_weights(plain.model, averaged.model)
    assert plain.history[-1]["loss"] == averaged.history[-1]["loss"]  # it only watches
    averaging(folder=tmp_path, stop_after=2)
    resumed = averaging(folder=tmp_path, resume=True)
    assert same_weights(averaged.model, resumed.model)
    assert same_weights(averaged.model, load_checkpoint(tmp_path / LAST)[0])


def test_weight_average_hand_computed() -> None:
    net = torch.nn.Linear(1, 1, bias=False)
    torch.nn.init.constant_(net.weight, 1.0)
    average = average_of(net, 0.5)
    torch.nn.init.constant_(net.weight, 2.0)
    for steps, wanted in ((1, 20 / 11), (10_000, (20 / 11 + 2) / 2)):  # keeps 2 / 11 at first
        average.n_averaged.fill_(steps)
        average.update_parameters(net)
        assert average.module.weight.item() == pytest.approx(wanted)


def test_an_early_look_and_event_files(tmp_path: Path, micro: Preset, frames: FrameTensors) -> None:
    pytest.importorskip("tensorboard")
    recipe = replace(micro, epochs=3)
    train(recipe, frames, frames, folder=tmp_path, tensorboard=True, progress=False)
    drawn = sorted(path.name for path in tmp_path.glob("pictures/*"))
    assert drawn == ["0001.png", "0002.png", "0003.png"]
    picture = cv2.imread(str(tmp_path / "pictures" / "0001.png"))
    assert picture is not None
    assert picture.shape[1] > 5 * 200
    assert picture.std() > 20
    assert list((tmp_path / "tensorboard").glob("events*"))
    assert [early_look(epoch, 50) for epoch in (0, 1, 2, 3, 15, 16, 49)] == [
        True, True, False, True, True, False, True
    ]  # fmt: skip


def test_a_loss_that_is_no_number_stops_the_training(micro: Preset, frames: FrameTensors) -> None:
    broken = replace(frames, true_depth=frames.true_depth * torch.inf)
    with pytest.raises(FloatingPointError, match=r"the loss is .* in epoch 1, step 1"):
        train(micro, broken, progress=False)


def test_gradients_are_clipped(micro: Preset, frames: FrameTensors) -> None:
    short = replace(micro, epochs=1)
    free = train(short, frames, progress=False, seed=2)
    clipped = train(replace(short, clip_norm=1e-9), frames, progress=False, seed=2)
    assert not same_weights(free.model, clipped.model)


def test_a_training_begins_with_the_weights_that_it_is_given(micro, frames):
    first = train(micro, frames, seed=1, progress=False).model
    still = replace(micro, learning_rate=0.0, epochs=1, warmup_epochs=0.0)
    again = train(still, frames, seed=2, start=first, progress=False).model
    for name, values in first.state_dict().items():
        torch.testing.assert_close(again.state_dict()[name], values, msg=name)
