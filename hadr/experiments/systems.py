"""The systems that are compared, by their rows' names, and the recipe of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.networks import DEPTH_NETWORKS, RIVALS
from hadr.ray_voxels import VoxelGrid
from hadr.training.losses import CODED
from hadr.training.presets import preset
from hadr.training.recipe import Preset

CHEAP = ("raw", "inpainting", "nearest", "hand-median", "hand-offset")
"""Methods without a network; what one must beat. The last learns one number, how far behind the
hand's median depth the glass lies in training frames."""
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
SEEING: Mapping[str, Mapping[str, Any]] = {
    "random-encoder": {
        "encoder_rate": 1.0,
        "model": {"lite": LiteConfig(frozen=0, pretrained=False)},
    },
    "whole-picture": {"width": 128, "height": 72, "ray_stride": 2, "model": {"view": None}},
    "no-aggregation-thawed": {"model": {"aggregation": False, "lite": LiteConfig(frozen=0)}},
    "no-augmentation": {"augment": False},
    "hand-xy": {"model": {"hand": "xy"}},
    "six-cells": {"model": {"grid": VoxelGrid(cells=6)}},
    "cells-from-zero": {"model": {"grid": VoxelGrid((-1.0, -1.0, 0.125), (1.0, 1.0, 2.125))}},
}
"""What preset imagenet is without its weights, which learns at the full rate, for there is nothing
to keep; without its window, with about as many rays of a frame as `mini`; without aggregation,
which leaves the encoder one stage: its frozen one, so here nothing is frozen; with the pictures'
colours as they are (mirrored still); with x and y of the keypoints in metres, the published code's
2D hand; with cells of 33 cm in place of 25; and with cells that begin at a depth of 0 m, not of
-12.5 cm."""
LONG_RUN = 4
"""How many times as many epochs a long run has."""
LONGER: Mapping[str, tuple[str, int]] = {
    "hadr-long": ("hadr", 16), "unet-hand-long": ("unet-hand", 32),
    "hadr-plus-long": ("hadr-plus", 32),
}  # fmt: skip
"""The long runs, whose they are, and their frames in a step with preset imagenet: enough to keep a
GPU busy. So HADR and the U-Net make twice as many steps, HADR-plus as many as its short run. Only
that preset has the last two, and any of unknown objects."""
COMPARED = tuple(dict.fromkeys((*METHODS, *LONGER)))
"""What the tables of preset imagenet compare."""
ALL_METHODS = tuple(dict.fromkeys((*COMPARED, *PARTS, *SWITCHES, *SEEING)))
"""Whatever a run can be of, in the order of the tables."""


def recipe_of(method: str, size: str) -> Preset | None:
    """Say how a system is trained at the size of a preset; None: it learns nothing.

    Those of `LONGER` have `LONG_RUN` times as many epochs as their network's, those of `PARTS`,
    `SWITCHES` and, with "imagenet", `SEEING` are HADR with one change, the others are their
    networks' recipes.
    ValueError for an unknown method or preset.
    """
    switches = switches_of(size)
    if method not in (known := (*COMPARED, *PARTS, *switches)):
        raise ValueError(f"method must be one of {', '.join(known)}, got {method!r}")
    if method in CHEAP:
        return None
    network, batch_size = LONGER.get(method, (method, 0))
    recipe = preset(size, network if network in DEPTH_NETWORKS else "hadr")
    if method in LONGER:
        recipe = replace(
            recipe, epochs=LONG_RUN * recipe.epochs, drop_epoch=LONG_RUN * recipe.drop_epoch
        )
        if size == "imagenet":
            recipe = replace(recipe, batch_size=batch_size)
    if method in PARTS:
        recipe = replace(recipe, model=_changed(recipe, PARTS[method]))
    if method in switches:
        changes = dict(switches[method])
        if "model" in changes:
            changes["model"] = _changed(recipe, changes["model"])
        recipe = replace(recipe, **changes)
    return recipe


def switches_of(size: str) -> Mapping[str, Mapping[str, Any]]:
    """What is changed in HADR's recipe in the rows of the ledger that a preset has."""
    return {**SWITCHES, **SEEING} if size == "imagenet" else SWITCHES


def _changed(recipe: Preset, changes: Mapping[str, Any]) -> Any:
    model: Any = recipe.model
    return replace(model, **changes)
