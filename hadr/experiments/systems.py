"""The systems that the tables compare, each under the name that its rows carry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from hadr.models.hadr import HADRConfig
from hadr.models.networks import RIVALS
from hadr.training.losses import CODED
from hadr.training.presets import preset
from hadr.training.recipe import Preset

CHEAP = ("raw", "inpainting", "nearest", "hand-median")
"""Methods that learn nothing; what a learned one must beat."""
LEARNED = ("hadr", "no-hand", "unet-hand", "hadr-plus", *RIVALS, "hadr-long")
"""Networks of the two tables, in the order in which they are trained: the long run last."""
METHODS = (*CHEAP, *LEARNED)
"""What the tables of known and of unknown objects compare."""
PARTS: Mapping[str, Mapping[str, Any]] = {
    "no-hand": {"hand": "none"},
    "no-aggregation": {"aggregation": False},
    "no-point-fusion": {"point_fusion": False},
    "hand-2d": {"hand": "2d"},
}
"""The paper's ablation of HADR, and what each row changes in its configuration."""
SWITCHES: Mapping[str, Mapping[str, Any]] = {
    "coded-weights": {"weights": CODED},
    "wrist-translation": {"model": {"wrist_rotation": False}},
    "clamped-probability": {"model": {"clamp_probability": True}},
}
"""Rows of the ledger that are measured by a training, and what each changes in HADR's recipe."""
LONG_RUN = 4
"""How many times as many epochs the long run has."""


@dataclass(frozen=True)
class System:
    """A system under test.

    Args:
        method: Its name in the tables.
        recipe: How it is trained; None for a method that learns nothing.
    """

    method: str
    recipe: Preset | None


def system(method: str, size: str) -> System:
    """Describe a system at the size of a preset.

    Args:
        method: One of `METHODS`, `PARTS` or `SWITCHES`.
        size: "tiny", "mini" or "paper".

    Returns:
        The system; `hadr-long` is HADR with `LONG_RUN` times as many epochs, those of `PARTS` and
        `SWITCHES` are HADR with one change, the others are the recipes of their networks.

    Raises:
        ValueError: The method or the preset is unknown.
    """
    if method not in (*METHODS, *PARTS, *SWITCHES):
        raise ValueError(
            f"method must be one of {', '.join((*METHODS, *PARTS, *SWITCHES))}, got {method!r}"
        )
    if method in CHEAP:
        return System(method, None)
    if method in ("hadr-plus", "unet-hand", *RIVALS):
        return System(method, preset(size, method))
    recipe = preset(size, "hadr")
    if method == "hadr-long":
        recipe = replace(
            recipe, epochs=LONG_RUN * recipe.epochs, drop_epoch=LONG_RUN * recipe.drop_epoch
        )
    if method in PARTS:
        recipe = replace(recipe, model=_changed(recipe, PARTS[method]))
    if method in SWITCHES:
        changes = dict(SWITCHES[method])
        if "model" in changes:
            changes["model"] = _changed(recipe, changes["model"])
        recipe = replace(recipe, **changes)
    return System(method, recipe)


def _changed(recipe: Preset, changes: Mapping[str, Any]) -> HADRConfig:
    if not isinstance(recipe.model, HADRConfig):
        raise TypeError(f"recipe {recipe.name!r} of HADR has a {type(recipe.model).__name__}")
    return replace(recipe.model, **changes)
