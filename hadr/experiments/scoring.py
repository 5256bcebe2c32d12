"""One protocol for all systems: their depth at one common size, on the true mask's pixels.

Each system restores at its own resolution; its depth is enlarged between the restored pixels and
scored against the true depth, which is brought to the common size by the nearest pixel, as the
published evaluation does (ledger, row 15). So a pixel that a system leaves out takes a depth from
the restored ones around it; in a frame without any it counts as the depth 0 that stands in the
image. The scores over the pixels that the system did restore stand beside, with their share, the
coverage: a small error there is worth as much as its coverage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import nn

from hadr.camera import BoolArray, FloatArray
from hadr.experiments.averages import standard_error
from hadr.metrics import METRICS, DepthMetrics, frame_metrics, mean_over_frames, pooled
from hadr.models.network_input import enlarge_restored
from hadr.models.networks import NETWORKS
from hadr.training.evaluation import CLASSICAL, predict
from hadr.training.frames.batches import FrameTensors
from hadr.training.frames.predicted import NEED_HAND, hand_known

EVALUATION_SIZE = (224, 126)
"""(width, height) at which all systems are scored, pixels."""


@dataclass(frozen=True)
class Scores:
    """The scores of one system on some frames.

    Attributes:
        stems: Name of each frame.
        frames: Each frame's metrics; a pixel that is 0 in the depth counts as that.
        restored: Each frame's metrics over the pixels that were restored, not filled; their
            ``coverage`` is the share of these.
        pooled: Metrics over the pixels of all frames, as in `frames`; its ``coverage`` is the share
            of them that were restored.
    """

    stems: tuple[str, ...]
    frames: tuple[DepthMetrics, ...]
    restored: tuple[DepthMetrics, ...]
    pooled: DepthMetrics

    def columns(self, holds: Sequence[str] | None = None) -> dict[str, Any]:
        """The columns of a table: per-frame means, and below ``pooled`` and ``restored`` more.

        The standard error is over the holds of the frames, or the frames where they are left out.
        """
        mean, alone = mean_over_frames(self.frames), mean_over_frames(self.restored)
        error = standard_error([m.rmse_m for m in self.frames], holds or self.stems)
        return {
            **{name: getattr(mean, name) for name in METRICS},
            "rmse_standard_error_m": error,
            "coverage": alone.coverage,
            "frames": len(self.frames),
            "pooled": {name: getattr(self.pooled, name) for name in METRICS},
            "restored": {name: getattr(alone, name) for name in METRICS},
        }

    def per_frame(self) -> dict[str, list[Any]]:
        """The RMSE of each frame in metres, with its name."""
        return {"stems": list(self.stems), "rmse_m": [m.rmse_m for m in self.frames]}


def score_depth(
    depth: FloatArray, truth: FrameTensors, restored: BoolArray | None = None
) -> Scores:
    """Score depth images (N, H, W), metres, 0 = not restored, at the size of the truth.

    Frames without a pixel of the object are left out; ValueError where none is left. `restored` (N,
    H, W) bool says where the depth is the system's own and not filled from around it; where there
    is any, if left out.
    """
    true, masks = truth.true_depth.numpy(), truth.object_mask.numpy()
    own = depth if restored is None else np.where(restored, depth, 0)
    if depth.shape != true.shape:
        raise ValueError(f"depth has shape {depth.shape}, the true depth {true.shape}")
    shown = [n for n in range(len(truth)) if (masks[n] & (true[n] > 0)).any()]
    if not shown:
        raise ValueError(f"none of the {len(truth)} frames shows an object")
    alone = tuple(frame_metrics(own[n], true[n], masks[n]) for n in shown)
    whole = pooled(((depth[n], true[n], masks[n]) for n in shown), missing="zero")
    return Scores(
        stems=tuple(truth.stems[n] for n in shown),
        frames=tuple(frame_metrics(depth[n], true[n], masks[n], missing="zero") for n in shown),
        restored=alone,
        pooled=replace(whole, coverage=sum(m.pixels for m in alone) / whole.pixels),
    )


def score_network(model: nn.Module, given: FrameTensors, truth: FrameTensors) -> Scores:
    """Let a network restore frames, and score it; arguments, errors as `restored_depth`."""
    depth, restored = restored_depth(model, given, truth)
    return score_depth(depth, truth, restored)


def restored_depth(
    model: nn.Module, given: FrameTensors, truth: FrameTensors
) -> tuple[FloatArray, BoolArray]:
    """Let a depth network restore frames, and enlarge its depth to the truth's size.

    `given` are the frames at the network's own size, `truth` the same ones at the evaluation size;
    ValueError where they are others. Where no hand is known, a network that needs one restores
    nothing. Gives z-depth in metres, 0 where none is, and where it is the network's own, both (N,
    H, W).
    """
    if given.stems != truth.stems:
        raise ValueError("the frames at the network's size are not those at the evaluation size")
    shape = tuple(truth.true_depth.shape[1:])
    lost = torch.zeros(len(given), dtype=torch.bool)
    if type(model).__name__ in [NETWORKS[kind].network for kind in NEED_HAND]:
        lost = ~hand_known(given.inputs)
        # it is shown some hand or other there, and what it says is left out
        keypoints = torch.where(lost[:, None, None], 1.0, given.inputs.keypoints)
        given = replace(given, inputs=replace(given.inputs, keypoints=keypoints))
    outputs = predict(model, given)
    depth = np.concatenate([output.depth.cpu().numpy() for output in outputs])
    known = np.concatenate([output.restored.cpu().numpy() for output in outputs]) & (depth > 0)
    known[lost.numpy()] = False
    large = np.zeros((len(given), *shape), np.float32)
    restored = np.zeros((len(given), *shape), bool)
    for number, asked in enumerate(given.inputs.mask.cpu().numpy()):
        (large[number],), restored[number] = enlarge_restored(
            depth[number][None], known[number], asked, shape
        )
    return large, restored


def cheap_depth(truth: FrameTensors, method: str) -> FloatArray:
    """Depth (N, H, W), metres, by one of `hadr.training.evaluation.CLASSICAL`."""
    restorer = CLASSICAL[method]
    return np.stack([restorer(truth, number) for number in range(len(truth))])


def score_cheap(truth: FrameTensors, method: str) -> Scores:
    """Score one of `CLASSICAL` by the networks' rule: it answers in the mask that it is given.

    Where the true mask goes beyond, a pixel takes the depth of those around it.
    """
    depth = cheap_depth(truth, method)
    own = truth.inputs.mask.numpy() & (depth > 0)
    filled = [
        enlarge_restored(image[None], known, known, known.shape)[0][0]
        for image, known in zip(depth, own, strict=True)
    ]
    return score_depth(np.stack(filled), truth, own)


def hand_offset(train: FrameTensors) -> float:
    """How far behind the hand's median depth the glass lies, metres: the mean over frames."""
    depth, true = cheap_depth(train, "hand-median"), train.true_depth.numpy()
    seen = train.object_mask.numpy() & (true > 0)
    behind = [(true[n] - depth[n])[seen[n]].mean() for n in range(len(train)) if seen[n].any()]
    return float(np.mean(behind))
