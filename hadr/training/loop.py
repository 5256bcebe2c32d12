"""The training loop of all networks: one pass after another over frames in memory.

Every random choice follows from the seed, the epoch's number and the frame's. A training that was
stopped and resumed therefore ends with the same weights as one that ran through. Torch's schedulers
of the rate have a state to be kept, `Preset.rate` has none.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

from hadr.models.networks import network_of
from hadr.records.provenance import usable_cores
from hadr.training.frames.augmentation import augment_frames
from hadr.training.frames.batches import FrameTensors
from hadr.training.recipe import Preset
from hadr.training.tasks.diagnosis import gradient_norms
from hadr.training.tasks.pictures import depth_picture, save_png
from hadr.training.tasks.task import Task
from hadr.training.training_folder import TrainingFolder


@dataclass(frozen=True)
class Trained:
    """What a training gives.

    Attributes:
        model: The network after the last epoch, in evaluation mode; the average of its weights
            where the recipe asks for it.
        history: One row of numbers an epoch.
    """

    model: nn.Module
    history: list[dict[str, float]]


def train(
    recipe: Preset,
    frames: FrameTensors,
    validation: FrameTensors | None = None,
    *,
    folder: str | Path | None = None,
    seed: int = 0,
    data: Mapping[str, Any] | None = None,
    start: nn.Module | None = None,
    resume: bool = False,
    stop_after: int | None = None,
    progress: bool = True,
    watch: Callable[[int, Any], None] | None = None,
    device: str = "cpu",
    tensorboard: bool = False,
) -> Trained:
    """Train a network.

    Args:
        recipe: What to train, and how.
        frames: Training frames at the recipe's size.
        validation: Frames that are only scored, after each epoch.
        folder: Where `last.safetensors`, `best.safetensors` (the best validation score), their
            records, `history.csv` and pictures of validation frames go; None writes nothing.
        seed: Seed of weights, shuffling, stochastic depth and augmentation.
        data: What the frames are (their number, corruption, objects), plain values for the
            record; a training can only be resumed with the same.
        start: A network of the same form whose weights the training begins with; new ones, drawn
            by chance, where it is left out.
        resume: Go on from the folder's last checkpoint, if there is one.
        stop_after: Stop after this many epochs, as if interrupted; None trains all of them.
        progress: Show a progress bar.
        watch: Called after each epoch with its number and the network, e.g. to keep pictures.
        device: Where it runs, "cpu" or "cuda" (`chosen_device`).
        tensorboard: Write event files for TensorBoard into the folder as well.

    Returns:
        The trained network and the history.

    Raises:
        ValueError: `resume` without a folder, or with a checkpoint of another recipe, seed or
            data; a folder that holds a training, without `resume`; TensorBoard without folder;
            `stop_after` below 1.
        FloatingPointError: The loss is no longer a finite number.
        ImportError: TensorBoard is asked for and not installed.
    """
    if stop_after is not None and stop_after < 1:
        raise ValueError(f"stop_after must be at least 1, got {stop_after}")
    if validation is not None:
        validation = evenly(validation, recipe.validation_frames)
    task = Task(recipe)
    workers = batch_workers(torch.device(device))
    torch.manual_seed(seed)
    network = task.build().to(device)
    if start is not None:
        network.load_state_dict(start.state_dict())
    encoders = network_of(recipe.network).encoders
    optimizer = optimizer_of(recipe, network)
    rates = [group["lr"] for group in optimizer.param_groups]  # of each, before the schedule
    average = None if recipe.average_decay is None else average_of(network, recipe.average_decay)

    history: list[dict[str, float]] = []
    home = None if folder is None else TrainingFolder(Path(folder), recipe, seed, data)
    if home is None and (resume or tensorboard):
        raise ValueError("resume and tensorboard need the folder of the training, got None")
    if home is not None and resume:
        history = home.resume(network, optimizer, average and average.module)
    elif home is not None:
        home.check_empty()
    events: Any = None
    if home is not None and tensorboard:
        from torch.utils.tensorboard import SummaryWriter

        # Rows of epochs that are trained again are replaced.
        events = SummaryWriter(str(home.path / "tensorboard"), purge_step=len(history))

    starts = range(0, len(frames), recipe.batch_size)
    steps = len(starts)
    last = recipe.epochs if stop_after is None else min(recipe.epochs, stop_after)
    if average is not None:
        average.n_averaged.fill_(1 + steps * len(history))  # it begins with the start's weights
    bar = tqdm(total=steps * last, initial=steps * len(history), unit="step", mininterval=1.0,
               disable=not progress)  # fmt: skip
    for epoch in range(len(history), last):
        started = time.perf_counter()
        bar.set_description(f"epoch {epoch + 1}/{recipe.epochs}")
        order = torch.randperm(len(frames), generator=chance(seed, epoch)).tolist()
        torch.manual_seed(chance(seed, epoch).initial_seed())  # stochastic depth
        seen, sums = 0, dict[str, float]()

        network.train()
        chosen = [order[start : start + recipe.batch_size] for start in starts]
        batches = DataLoader(
            _Epoch(frames, recipe, seed, epoch),
            batch_size=None,
            sampler=chosen,
            num_workers=workers,
            multiprocessing_context="fork" if workers else None,  # they share the frames
            worker_init_fn=lambda _: cv2.setNumThreads(0),  # it can't use those of its parent
            generator=torch.Generator(),  # else it would draw from that of stochastic depth
        )
        for step, batch in enumerate(batches):
            with torch.autocast(device, torch.bfloat16, enabled=recipe.precision == "bf16-mixed"):
                losses = task.losses(network, batch.to(device), epoch, chance(seed, epoch, step))
            optimizer.zero_grad()
            losses["loss"].backward()  # type: ignore[no-untyped-call]
            norms = gradient_norms(network, encoders)
            if recipe.clip_norm is not None:
                nn.utils.clip_grad_norm_(network.parameters(), recipe.clip_norm)
            for group, rate in zip(optimizer.param_groups, rates, strict=True):
                group["lr"] = recipe.rate(epoch + (step + 0.5) / steps, rate)
            optimizer.step()
            if average is not None:
                average.update_parameters(network)

            numbers = {name: float(value.detach()) for name, value in (losses | norms).items()}
            if not math.isfinite(numbers["loss"]):
                raise FloatingPointError(
                    f"the loss is {numbers['loss']} in epoch {epoch + 1}, step {step + 1}; a lower "
                    "learning_rate, warmup_epochs or clip_norm may help"
                )
            seen += len(batch)
            for name, value in numbers.items():
                sums[name] = sums.get(name, 0.0) + value * len(batch)
            bar.set_postfix({name: f"{sums[name] / seen:.4g}" for name in losses}, refresh=False)
            bar.update()

        row = {"epoch": float(epoch), "rate": recipe.rate(epoch)}
        row |= {name: value / seen for name, value in sums.items()}
        result = (network if average is None else average.module).eval()
        scores = task.validate(result, validation, recipe.batch_size) if validation else {}
        row |= scores
        row["seconds"] = time.perf_counter() - started
        history.append(row)
        if watch is not None:
            watch(epoch, result)
        if home is not None:
            if validation and task.restores_depth and early_look(epoch, recipe.epochs):
                path = home.path / "pictures" / f"{epoch + 1:04d}.png"
                save_png(path, depth_picture(result, validation))
            home.save(network, result, optimizer, history, next(iter(scores), None))
        if events is not None:
            for name, value in row.items():
                events.add_scalar(name, value, epoch)
    bar.close()
    if events is not None:
        events.close()
    return Trained((network if average is None else average.module).eval(), history)


def chosen_device(wish: str) -> str:
    """Give "cuda" or "cpu" for "auto", "cpu" or "cuda"; ValueError for a CUDA that is not there."""
    cuda = torch.cuda.is_available()
    if wish == "cuda" and not cuda:
        raise ValueError("--accelerator cuda: PyTorch finds no CUDA device on this machine")
    return "cuda" if cuda and wish != "cpu" else "cpu"


def batch_workers(device: torch.device) -> int:
    """Say how many processes augment the next batches: up to 4, that no GPU waits for them."""
    return 0 if device.type == "cpu" else min(4, usable_cores() - 1)


@dataclass(frozen=True)
class _Epoch(Dataset[FrameTensors]):
    """An epoch's batches, augmented, by the numbers of their frames."""

    frames: FrameTensors
    recipe: Preset
    seed: int
    epoch: int

    def __getitem__(self, chosen: list[int]) -> FrameTensors:
        batch = self.frames.take(chosen)
        return augment_frames(batch, chosen, self.recipe, self.seed, self.epoch)


def average_of(network: nn.Module, decay: float) -> AveragedModel:
    """Copy a network for the running average of its weights over the steps; buffers are copied.

    Late in training the weights circle around a minimum; their average lies nearer to it. A step
    keeps `decay` of it, and less in the first steps, so that the random start is forgotten.
    """

    @torch.no_grad()
    def follow(means: Any, weights: Any, steps: Tensor | int) -> None:
        keep = min(decay, (1 + int(steps)) / (10 + int(steps)))
        torch._foreach_lerp_(list(means), list(weights), 1 - keep)

    return AveragedModel(network, multi_avg_fn=follow)


def optimizer_of(recipe: Preset, network: nn.Module) -> torch.optim.Adam:
    """Build the recipe's optimiser; the loop schedules the rate of each of its groups."""
    parts = tuple(f"{name}." for name in network_of(recipe.network).slow)
    slow, fast = list[Tensor](), list[Tensor]()
    for name, weight in network.named_parameters():
        (slow if recipe.encoder_rate != 1 and name.startswith(parts) else fast).append(weight)
    groups: list[dict[str, Any]] = [{"params": fast}]
    if slow:
        groups.append({"params": slow, "lr": recipe.learning_rate * recipe.encoder_rate})
    if recipe.optimizer == "adamw":
        return torch.optim.AdamW(groups, lr=recipe.learning_rate, weight_decay=recipe.weight_decay)
    return torch.optim.Adam(groups, lr=recipe.learning_rate)


def chance(seed: int, epoch: int, step: int | None = None) -> torch.Generator:
    """Give the source of randomness of an epoch, or of one of its steps."""
    words = (seed, epoch) if step is None else (seed, epoch, step + 1)
    state = np.random.SeedSequence(words).generate_state(1, np.uint64)
    return torch.Generator().manual_seed(int(state[0] >> np.uint64(1)))


def evenly(frames: FrameTensors, most: int | None) -> FrameTensors:
    """Take at most so many frames, evenly spread over all; None takes all."""
    count = len(frames)
    if most is None or count <= most:
        return frames
    return frames.take([number * count // most for number in range(most)])


def early_look(epoch: int, epochs: int) -> bool:
    """Say whether an epoch's picture is drawn: the first, second, fourth, eighth, ..., last."""
    done = epoch + 1
    return done == epochs or done & (done - 1) == 0
