"""The systems that the tables compare, each under the name that its rows carry."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from hadr.models.hadr import HADRConfig
from hadr.training.presets import RIVALS, Preset, preset

CHEAP = ("raw", "inpainting", "nearest", "hand-median")
"""Methods that learn nothing; what a learned one must beat."""
LEARNED = ("hadr", "no-hand", "unet-hand", "hadr-plus", *RIVALS, "hadr-long")
"""Networks, in the order in which they are trained: the long run last."""
METHODS = (*CHEAP, *LEARNED)
LONG_RUN = 4
"""How many times as many epochs the long run has."""

PresetName = Literal["tiny", "mini", "paper"]


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
        method: One of `METHODS`.
        size: "tiny", "mini" or "paper".

    Returns:
        The system; `hadr-long` is HADR with `LONG_RUN` times as many epochs, `no-hand` HADR
        without the hand feature, the others are the recipes of their networks.

    Raises:
        ValueError: The method or the preset is unknown.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if method in CHEAP:
        return System(method, None)
    if method in ("hadr-plus", "unet-hand", *RIVALS):
        return System(method, preset(size, method))
    recipe = preset(size, "hadr")
    if method == "hadr-long":
        recipe = replace(
            recipe, epochs=LONG_RUN * recipe.epochs, drop_epoch=LONG_RUN * recipe.drop_epoch
        )
    if method == "no-hand":
        if not isinstance(recipe.model, HADRConfig):
            raise TypeError(f"recipe {recipe.name!r} of HADR has a {type(recipe.model).__name__}")
        recipe = replace(recipe, model=replace(recipe.model, hand="none"))
    return System(method, recipe)
