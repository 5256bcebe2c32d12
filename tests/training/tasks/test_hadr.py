from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch

from hadr.models.hadr import HADR
from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import CODED
from hadr.training.recipe import Preset
from hadr.training.tasks.task import Task


def test_the_terms_have_the_recipes_weights(micro: Preset, frames: FrameTensors) -> None:
    task = Task(replace(micro, weights=CODED))
    torch.manual_seed(0)
    found = task.losses(task.build(), frames, 0, torch.Generator())
    loss, depth, probability, normals = (
        found[name].item() for name in ("loss", "depth", "probability", "normals")
    )
    assert loss == pytest.approx(200 * depth + 0.5 * probability + 10 * normals, rel=1e-5)
    assert abs(probability - normals) > 0.01  # else it would not matter which has which weight


def test_true_voxels_in_the_first_epochs_and_strided_rays_from_anywhere(
    micro: Preset, frames: FrameTensors
) -> None:
    recipe = replace(micro, true_voxel_epochs=2, ray_stride=2)
    task, few = Task(recipe), frames.take([0])
    told: list[bool] = []
    starts: set[tuple[int, ...]] = set()

    class Spy(HADR):
        def forward(self, *inputs: Any, **options: Any) -> Any:
            told.append(options["true_depth"] is few.true_depth)
            (start,) = (options["rays"][:, 1:] % 2).unique(dim=0).tolist()
            starts.add(tuple(start))
            return super().forward(*inputs, **options)

    model = Spy(recipe.model).train()  # type: ignore[arg-type]
    generator = torch.Generator().manual_seed(0)
    for epoch in range(20):
        task.losses(model, few, epoch, generator)
    assert told == [True] * 2 + [False] * 18
    assert starts == {(0, 0), (0, 1), (1, 0), (1, 1)}
