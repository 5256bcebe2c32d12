"""What frame number ``i`` of a data set shows, and to which split it belongs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hadr.data.splits import UNKNOWN_OBJECTS
from hadr.synthesis.glass.objects import OBJECTS, glass_object

SplitBy = Literal["frame", "holding", "object"]

#: Shares of training, validation and testing frames (paper, section IV-A).
_RATIO = (0.7, 0.2, 0.1)
_HOLD_CYCLE = ("train", "train", "test", "train", "val", "train", "train", "train", "val", "train")


@dataclass(frozen=True)
class FrameRecipe:
    """What frame ``index`` of a data set shows.

    Args:
        index: Position in the data set.
        object_id: Which object.
        hold_number: Which of its holding poses.
        split: Where the frame belongs.
    """

    index: int
    object_id: str
    hold_number: int
    split: str

    @property
    def stem(self) -> str:
        """Name of the frame's files."""
        return f"{self.index:06d}"


def hold_split(hold_number: int, object_id: str = "0000") -> str:
    """The split of an object's hold number: ten in turn hold seven, two and one.

    A hold's split so never depends on how many frames are made. Kinds of hold come in turns of
    eight; the cycle moves on by one each ten and begins elsewhere for each object, so that every
    kind is tested with some object.
    """
    turn = hold_number // len(_HOLD_CYCLE)
    return _HOLD_CYCLE[(hold_number + turn + int(object_id)) % len(_HOLD_CYCLE)]


def frame_recipe(
    index: int,
    *,
    seed: int = 0,
    objects: Sequence[str] | None = None,
    frames_per_hold: float = 2,
    split_by: SplitBy = "holding",
    hold_shift: int = 0,
) -> FrameRecipe:
    """Say what frame ``index`` shows.

    Args:
        index: Position in the data set, from 0. Objects alternate.
        seed: Seed of the data set (only a split by frame depends on it).
        objects: The objects to alternate between; all eight where it is left out.
        frames_per_hold: How many frames share a holding pose; 2.5 means two and three in turn.
        split_by: ``holding`` and ``frame`` split 7:2:1; ``object`` tests on the unknown objects.
        hold_shift: Object number j begins with its hold number ``j * hold_shift``, so that few
            frames show many kinds of hold.

    Returns:
        The recipe.

    Raises:
        ValueError: A value is out of range or an object unknown.
    """
    names = list(OBJECTS) if objects is None else list(objects)
    for name in names:
        glass_object(name)
    if index < 0 or frames_per_hold < 1 or hold_shift < 0 or not names:
        raise ValueError(
            "need index >= 0, frames_per_hold >= 1, hold_shift >= 0 and an object, got "
            f"{index}, {frames_per_hold}, {hold_shift}, {names}"
        )
    turn, position = divmod(index, len(names))
    object_id = names[position]
    hold_number = int(turn // frames_per_hold) + position * hold_shift
    if split_by == "holding":
        split = hold_split(hold_number, object_id)
    elif split_by == "frame":
        draw = np.random.default_rng([seed, index, 29]).choice(3, p=_RATIO)
        split = ("train", "val", "test")[int(draw)]
    elif split_by == "object":
        split = "test" if object_id in UNKNOWN_OBJECTS else "train"
    else:
        raise ValueError(f"split_by must be 'holding', 'frame' or 'object', got {split_by!r}")
    return FrameRecipe(index, object_id, hold_number, split)


def recipes_by_hold(recipes: Sequence[FrameRecipe]) -> list[tuple[FrameRecipe, ...]]:
    """Put the frames that share a holding pose together, in the order of their first frames."""
    groups: dict[tuple[str, int], list[FrameRecipe]] = {}
    for recipe in recipes:
        groups.setdefault((recipe.object_id, recipe.hold_number), []).append(recipe)
    return [tuple(group) for group in groups.values()]
