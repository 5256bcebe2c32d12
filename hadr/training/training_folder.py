"""A training's folder: what each epoch leaves there, and how a stopped training goes on from it.

`last.safetensors` is the truth: network, optimiser and the whole history in one file that is
replaced at once. Whatever else lies in the folder (the best epoch's checkpoint, `history.csv`, the
records for human eyes) is written after it and can be made from it. So a training may be killed
at any moment: `resume` brings the rest into line with the last whole epoch.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn

from hadr.records.provenance import provenance
from hadr.records.reading import structured
from hadr.records.writing import set_aside, write_whole
from hadr.training import checkpoints
from hadr.training.recipe import Preset

LAST = "last.safetensors"
BEST = "best.safetensors"
HISTORY = "history.csv"
_RAW = "weights/"  # the weights themselves, where the checkpoint's are their average
History = list[dict[str, float]]


@dataclass(frozen=True)
class _Reached:
    """What the last checkpoint's record must say so that a training can go on."""

    history: list[dict[str, float | None]]
    epochs: int
    score: str | None
    preset: dict[str, Any]
    seed: int

    def __post_init__(self) -> None:
        if not self.epochs == len(self.history) >= 1:
            raise ValueError(f"epochs is {self.epochs}, but history has {len(self.history)} rows")
        if self.score is not None and any(self.score not in row for row in self.history):
            raise ValueError(f"score is {self.score!r}, which is no column of history")
        scored = [name for name in self.history[0] if name.startswith("validation")]
        if self.score is None and scored:
            raise ValueError(f"score is null, but history has scores ({scored[0]})")


@dataclass(frozen=True)
class TrainingFolder:
    """Where a training's files go.

    Args:
        path: The folder.
        recipe: What is trained, and how.
        seed: The training's seed.
        data: What the frames are, plain values.
        origin: Where epochs come from that are made now.
    """

    path: Path
    recipe: Preset
    seed: int
    data: Mapping[str, Any] | None
    origin: Mapping[str, Any] = field(default_factory=provenance)

    def check_empty(self) -> None:
        """Refuse a folder that holds a training, or what one would replace, by a ValueError."""
        if (self.path / LAST).exists():
            raise ValueError(
                f"{self.path} holds a training already ({LAST}); go on with it (--resume), or name "
                "another folder"
            )
        records = [Path(name).with_suffix(".json").name for name in (LAST, BEST)]
        for name in (BEST, *records, HISTORY):
            if (self.path / name).exists():
                raise ValueError(
                    f"{self.path} holds {name}, but no training ({LAST}); it is not replaced, name "
                    "another folder"
                )

    def check_begun(self) -> None:
        """Refuse, by a FileNotFoundError, a folder without an epoch to go on from."""
        if not (last := self.path / LAST).is_file():
            raise FileNotFoundError(f"there is no {last} to go on from; leave out --resume")

    def save(
        self,
        network: nn.Module,
        result: nn.Module,
        optimizer: torch.optim.Adam,
        history: History,
        score: str | None,
    ) -> None:
        """Write what an epoch has reached, the truth first.

        `result` is the network, or its average; smallest `score` of the history is the best epoch.
        """
        state, device = checkpoints.adam_state(optimizer), next(network.parameters()).device
        named = torch.cuda.get_device_name(device) if device.type == "cuda" else device.type
        meta = {
            "width": self.recipe.width,
            "height": self.recipe.height,
            "preset": self.recipe.to_dict(),
            "seed": self.seed,
            "data": None if self.data is None else dict(self.data),
            "epochs": len(history),
            "score": score,
            "history": history,
            "made_with": {**self.origin, "threads": torch.get_num_threads(), "device": named},
        }
        if result is not network:
            state |= {_RAW + name: values for name, values in network.state_dict().items()}
        checkpoints.save_checkpoint(self.path / LAST, result, meta, training_state=state)
        if best_epoch(history, score) == len(history):
            checkpoints.save_checkpoint(self.path / BEST, result, meta)
        self._write_history(history)

    def resume(
        self, network: nn.Module, optimizer: torch.optim.Adam, average: nn.Module | None
    ) -> History:
        """Load the last epoch into network, optimiser and average, and bring the folder into line.

        Returns the history.

        Raises:
            FileNotFoundError: There is nothing to go on from.
            ValueError: The folder holds a training of another recipe, seed or data.
        """
        self.check_begun()
        last = self.path / LAST
        earlier, meta = checkpoints.load_checkpoint(last)
        reached = structured(meta, _Reached, last, further=True)
        self._check_same(meta)
        state = checkpoints.load_training_state(last)
        raw = {n.removeprefix(_RAW): t for n, t in state.items() if n.startswith(_RAW)}
        moments = {n: t for n, t in state.items() if not n.startswith(_RAW)}
        if not moments:
            raise ValueError(f"{last} lacks the optimiser's state: it is a copy of another file")
        network.load_state_dict(raw or earlier.state_dict())
        if average is not None:
            average.load_state_dict(earlier.state_dict())
        checkpoints.restore_adam(optimizer, moments)
        history = [
            {name: math.nan if value is None else value for name, value in row.items()}
            for row in reached.history
        ]
        if best_epoch(history, reached.score) == len(history):
            there = None
            with contextlib.suppress(FileNotFoundError, ValueError):
                there = checkpoints.load_checkpoint(self.path / BEST)[1].get("epochs")
            if there != len(history):
                checkpoints.save_checkpoint(self.path / BEST, earlier, meta)
        self._write_history(history)
        return history

    def _write_history(self, history: History) -> None:
        path = self.path / HISTORY
        # as this run left it: an epoch ago, or just now where it was stopped after writing
        known = [_as_csv(history[:-1]), _as_csv(history)]
        if path.is_file() and path.read_bytes() not in known:
            set_aside(path)
        write_whole(path, known[-1])

    def _check_same(self, meta: Mapping[str, Any]) -> None:
        """Refuse to go on with another network, recipe, seed or other data."""
        last, recipe = self.path / LAST, self.recipe
        if meta["seed"] != self.seed:
            raise ValueError(f"{last} was trained with seed {meta['seed']}, not {self.seed}")
        # as it was recorded: what is loaded was built without fetching published weights
        same = meta["network"] == recipe.network and meta["preset"].get("name") == recipe.name
        if not same or type(recipe.model).from_dict(meta["model"]) != recipe.model:
            raise ValueError(
                f"{last} holds a training of preset {meta['preset'].get('name')!r} with another "
                f"network than preset {recipe.name!r} asks for"
            )
        asked = json.loads(json.dumps({"recipe": recipe.to_dict(), "data": self.data}))
        stored = {"recipe": meta["preset"], "data": meta.get("data")}
        for part, values in asked.items():
            names = set(values or {}) | set(stored[part] or {})
            first = [name for name in ("schedule", "epochs") if name in names]  # others follow
            for name in (*first, *sorted(names - set(first))):
                then, now = (stored[part] or {}).get(name), (values or {}).get(name)
                longer = name == "epochs" and recipe.schedule == "step" and not recipe.milestones
                if then != now and not longer:
                    raise ValueError(
                        f"{last} was trained with {name} = {then}, not {now}; resume it with the "
                        "same, or name another folder"
                    )


def _as_csv(history: History) -> bytes:
    """The epochs' rows, with a column for each number that one of them has."""
    names = list(dict.fromkeys(name for row in history for name in row))
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=names)
    writer.writeheader()
    writer.writerows(history)
    return text.getvalue().encode()


def best_epoch(history: History, score: str | None) -> int | None:
    """Give how many epochs had passed when the score was smallest; None without scores."""
    scores = [
        (row[score], number + 1)
        for number, row in enumerate(history)
        if score is not None and math.isfinite(row.get(score, math.nan))
    ]
    return min(scores)[1] if scores else None
