"""Trains a micro HADR, a micro LIDF and a small net with batch norm, with several processes.

python tests/training/two_processes.py PROCESSES OUT.json
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from lightning_fabric import Fabric
from torch import Tensor, nn

sys.path.insert(0, str(Path(__file__).parent))

from conftest import MICRO, little_frames

from hadr.models.baselines.lidf import LIDFConfig
from hadr.models.dilated_resnet import DilatedResNetConfig
from hadr.training.batches import FrameTensors
from hadr.training.lidf_task import LIDFTask
from hadr.training.loop import train
from hadr.training.task import shared_mean

TOGETHER = 4
RECIPE = replace(MICRO, epochs=3, drop_epoch=2, mirror=0.5, zoom=1.2, clip_norm=50.0)
LIDF_RECIPE = replace(
    RECIPE,
    network="lidf",
    model=LIDFConfig(
        backbone=DilatedResNetConfig(depths=(1, 1, 1, 1), widths=(8, 8, 8, 8)),
        decoder_widths=(16,),
        voxel_width=8,
        first_share=0.4,
    ),
)
"""One epoch of the first stage, two of the refinement."""


def uneven_frames() -> FrameTensors:
    """Six little frames whose glasses have very different numbers of pixels."""
    frames = little_frames()
    mask = frames.object_mask.clone()
    for number in range(len(frames)):
        mask[number, 9 + number % 7 :] = False
    inputs = replace(frames.inputs, mask=mask)
    return replace(frames, inputs=inputs, object_mask=mask)


@dataclass(frozen=True)
class NormConfig:
    """The configuration of a net that has none."""

    def to_dict(self) -> dict[str, Any]:
        """Nothing."""
        return {}


class NormTask:
    """A little net with batch normalisation that predicts depth from colour."""

    network = "norm"

    def build(self) -> nn.Module:
        """Two convolutions."""
        return nn.Sequential(
            nn.Conv2d(3, 4, 3, padding=1, bias=False),
            nn.BatchNorm2d(4),
            nn.ReLU(),
            nn.Conv2d(4, 1, 1),
        )

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """Mean absolute error over the glasses' pixels."""
        error = (model(batch.inputs.color)[:, 0] - batch.true_depth).abs() * batch.object_mask
        return {"loss": shared_mean(error.sum(), batch.object_mask.sum())}

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """Mean of the prediction in evaluation mode, which shows the running statistics."""
        with torch.no_grad():
            return {"mean": float(model(frames.inputs.color).mean())}


def histories(processes: int) -> dict[str, list[dict[str, float]]]:
    """Train the nets with so many processes."""
    fabric = Fabric(accelerator="cpu", devices=processes)
    fabric.launch()
    batch_size = TOGETHER // processes
    recipe = replace(RECIPE, batch_size=batch_size)
    lidf = replace(LIDF_RECIPE, batch_size=batch_size)
    frames = uneven_frames()
    tasks = (("hadr", recipe, None), ("norm", recipe, NormTask()), ("lidf", lidf, LIDFTask(lidf)))
    found = {
        name: train(of, frames, frames, task=task, progress=False, fabric=fabric).history
        for name, of, task in tasks
    }
    return found if fabric.is_global_zero else {}


if __name__ == "__main__":
    torch.set_num_threads(1)
    if found := histories(int(sys.argv[1])):
        Path(sys.argv[2]).write_text(json.dumps(found), encoding="utf-8")
