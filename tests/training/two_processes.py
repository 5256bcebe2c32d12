"""Trains a micro HADR and a micro LIDF, which has batch norm, alone and in two processes.

python tests/training/two_processes.py OUT.json
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import psutil
import torch
from lightning_fabric import Fabric
from torch import Tensor, nn

sys.path.insert(0, str(Path(__file__).parent))

from conftest import MICRO, little_frames

from hadr.rivals.lidf import DilatedResNetConfig, LIDFConfig
from hadr.training.frames.batches import FrameTensors
from hadr.training.loop import train
from hadr.training.processes import OneMachine
from hadr.training.tasks.task import Task

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


def double(part: Any) -> Any:
    """Frames, or what a network is given of them, with numbers of 64 bits."""
    return replace(
        part,
        **{
            name: value.double()
            for name, value in vars(part).items()
            if isinstance(value, Tensor) and value.is_floating_point()
        },
    )


@dataclass
class InDouble:
    """A task in double precision, where only a mistake shows and not the order of a sum."""

    inner: Task

    def build(self) -> nn.Module:
        """The network with numbers of 64 bits."""
        return self.inner.build().double()

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """The inner task's."""
        batch = replace(double(batch), inputs=double(batch.inputs))
        return self.inner.losses(model, batch, epoch, generator)

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """The inner task's."""
        frames = replace(double(frames), inputs=double(frames.inputs))
        return self.inner.validate(model, frames, batch_size)


def histories(fabric: Fabric) -> dict[str, list[dict[str, float]]]:
    """Train the nets in this process, or with others."""
    batch_size = TOGETHER // fabric.world_size
    recipe = replace(RECIPE, batch_size=batch_size)
    lidf = replace(LIDF_RECIPE, batch_size=batch_size)
    frames = uneven_frames()
    return {
        of.network: train(
            of, frames, frames, task=InDouble(Task(of)), progress=False, fabric=fabric
        ).history
        for of in (recipe, lidf)
    }


if __name__ == "__main__":
    torch.set_num_threads(1)
    found = {}
    if "LOCAL_RANK" not in os.environ:  # else this is the second process, started by the first
        found["alone"] = histories(Fabric(accelerator="cpu", devices=1))
    out = Path(sys.argv[1])
    fabric = Fabric(accelerator="cpu", strategy=OneMachine(out.with_name("meeting")), devices=2)
    fabric.launch()
    links = psutil.Process().net_connections("inet")
    found["listens on"] = sorted({x.laddr.ip for x in links if x.status == psutil.CONN_LISTEN})
    found["together"] = histories(fabric)
    if fabric.is_global_zero:
        out.write_text(json.dumps(found), encoding="utf-8")
