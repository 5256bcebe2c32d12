"""What a depth network's confidence means: fitted on validation frames, and measured.

`hadr calibrate` adds three things to the record of a checkpoint and leaves its weights alone:

* ``learned_range``: the depths at which training has shown the object;
* ``confidence``: how the spread that the network predicts becomes the probability that a restored
  depth is right to 2 cm, fitted on validation frames. A network that predicts no distribution of
  depth (`hadr.models.networks`) cannot say how sure it is, and gets none;
* ``ground``: what the training frames were like (`hadr.confidence.known_ground`). On others the
  confidence does not hold, and is not given.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from hadr.camera import FloatArray, resize_depth
from hadr.confidence.calibration import (
    ConfidenceRule,
    fit_confidence,
    learned_range,
    reliability,
    signal_of,
    sparsification,
    within_learned,
)
from hadr.confidence.known_ground import Field, Ground
from hadr.confidence.sight import Observation, Sight, observe
from hadr.corruption import CORRUPTIONS, Corruption, corrupt, erase_mask
from hadr.data.frame import Frame
from hadr.models.network_input import frame_to_input
from hadr.models.networks import NETWORKS
from hadr.training.checkpoints import kind_of
from hadr.training.evaluation import predict
from hadr.training.frames.batches import FrameTensors, load_frames

LEARNED, MEASURED = "depth as in training", "measured depth"
DRAWS = 200
"""Bootstrap draws of whole holds, for standard errors."""


@dataclass(frozen=True)
class RestoredPixels:
    """What a network restored on some frames, pixel by pixel, where the truth is known.

    Attributes:
        signal: What the network says of its answer, shape (N,); None where it cannot say.
        error_m: Restored minus true depth in metres, shape (N,).
        frame: Number of each pixel's frame, shape (N,).
        coverage: Share of the object's pixels with a known truth that were restored, 0..1.
    """

    signal: FloatArray | None
    error_m: FloatArray
    frame: NDArray[np.int64]
    coverage: float


def restored_pixels(
    model: nn.Module,
    frames: FrameTensors,
    depth_range_m: tuple[float, float] | None = None,
    batch_size: int = 8,
) -> RestoredPixels:
    """Restore frames; collect error and signal of each restored pixel of the object."""
    outputs, truth = predict(model, frames, batch_size), frames.true_depth
    depth = torch.cat([output.depth.cpu() for output in outputs])
    within = torch.cat([within_learned(output, depth_range_m).cpu() for output in outputs])
    scorable = frames.object_mask & (truth > 0)
    kept, signal = scorable & within, None
    if NETWORKS[kind_of(model)].can_say:
        signal = torch.cat([signal_of(output).cpu() for output in outputs])[kept].numpy()
    return RestoredPixels(
        signal=signal,
        error_m=(depth - truth)[kept].double().numpy(),
        frame=kept.nonzero()[:, 0].numpy(),
        coverage=int(kept.sum()) / max(int(scorable.sum()), 1),
    )


def measure_confidence(
    rule: ConfidenceRule, pixels: RestoredPixels, holds: Sequence[str]
) -> dict[str, Any]:
    """Measure how honest a confidence is on pixels of frames that it was not fitted on.

    The hold that each frame shows is for standard errors: frames of one hold are alike.
    Gives numbers by name: lengths in metres; RMSE of all pixels and of those that remain when a
    tenth is dropped (the least sure, or the worst: the oracle), and the curves themselves.
    """
    if pixels.signal is None:
        raise ValueError("these pixels are of a network that cannot say how sure it is")
    sure = rule(pixels.signal)
    right = np.abs(pixels.error_m) < rule.calibration.tolerance_m
    order = rule.ordering(pixels.signal)
    curve, bins = sparsification(order, pixels.error_m), reliability(sure, right)
    tenth = int(np.flatnonzero(np.isclose(curve.dropped, 0.1))[0])

    rng = np.random.default_rng(0)
    _, of = np.unique(np.asarray(holds)[pixels.frame], return_inverse=True)
    rows = [np.flatnonzero(of == hold) for hold in range(of.max() + 1)]
    gains = []
    for _ in range(DRAWS):
        drawn = np.concatenate([rows[n] for n in rng.integers(len(rows), size=len(rows))])
        again = sparsification(order[drawn], pixels.error_m[drawn], (0.0, 0.1))
        gains.append(again.rmse_m[0] - again.rmse_m[1])
    return {
        "frames": len(np.unique(pixels.frame)),
        "holds": len(rows),
        "pixels": len(pixels.error_m),
        "coverage": pixels.coverage,
        "share_right": float(right.mean()),
        "mean_confidence": float(sure.mean()),
        "expected_calibration_error": bins.expected_error,
        "rmse_m": curve.random_rmse_m,
        "rmse_at_90_m": float(curve.rmse_m[tenth]),
        "gain_at_90_m": curve.random_rmse_m - float(curve.rmse_m[tenth]),
        "gain_at_90_standard_error_m": float(np.std(gains)),
        "oracle_rmse_at_90_m": float(curve.oracle_rmse_m[tenth]),
        "reliability": {"said": bins.said, "true": bins.true, "count": bins.count},
        "sparsification": {
            "dropped": curve.dropped,
            "rmse_m": curve.rmse_m,
            "oracle_rmse_m": curve.oracle_rmse_m,
        },
    }


def calibrate(
    model: nn.Module, train: FrameTensors, validation: FrameTensors, source: str
) -> dict[str, Any]:
    """Make the first two additions to the record of a depth network's checkpoint.

    Some of the frames that it has learned from, at its size, are enough; it has not learned from
    those of validation, which `source` names. Gives ``learned_range`` and, for a network that can
    say, ``confidence``.
    """
    seen = train.true_depth[train.object_mask]
    near, far = learned_range(seen.numpy())
    additions: dict[str, Any] = {"learned_range": {"depth_m": [near, far], "frames": len(train)}}
    if NETWORKS[kind_of(model)].can_say:
        pixels = restored_pixels(model, validation, (near, far))
        assert pixels.signal is not None  # for the type checker
        rule = fit_confidence(pixels.signal, pixels.error_m, frames=len(validation))
        additions["confidence"] = {
            **rule.to_dict(),
            "fitted_on": {"frames": len(validation), "pixels": len(pixels.error_m), "of": source},
        }
    return additions


def learn_ground(
    model: nn.Module,
    size: tuple[int, int],
    corruption: Corruption,
    depth_range_m: tuple[float, float],
    training: Sequence[Frame],
    validation: Sequence[Frame],
    seed: int = 0,
) -> dict[str, Any]:
    """Make the ground of a depth network, for its checkpoint's record.

    A network that learned from computed depth will be asked about a camera's. So frames that have
    raw depth are looked at with it as well, and there the confidence has a meaning of its own. Some
    of the frames that it learned from are enough; those of validation set the limit. The size is
    (width, height) that it runs at, the range that of the objects' depth in training, metres.
    """
    kind, config = NETWORKS[kind_of(model)], CORRUPTIONS[corruption]

    def depths(frame: Frame, rng: np.random.Generator) -> Iterator[tuple[str, FloatArray]]:
        """The depths with which a frame is shown, by field: in the glass too."""
        if not config.captured:
            seen = (frame.depth, frame.object_mask, frame.camera, rng, config)
            yield LEARNED, corrupt(*seen, frame.background_depth)
        if frame.raw_depth is not None:
            yield MEASURED, frame.raw_depth

    def look(frames: Sequence[Frame]) -> dict[str, list[Observation]]:
        """Show the network all frames but those of whose glass no pixel is left at its size."""
        found = defaultdict(list)
        for number, frame in enumerate(frames):
            mask = frame.object_mask
            for field, measured in depths(frame, np.random.default_rng((seed, number))):
                given = erase_mask(measured, mask) if config.erase else measured
                inputs = frame_to_input(
                    frame.color, given, mask, frame.keypoints, frame.camera, size
                )
                if not inputs.mask.any():
                    continue
                small = np.nan_to_num(resize_depth(measured, *size))
                with torch.inference_mode():
                    one = observe(model, kind.sees, inputs, small, depth_range_m, frame.color, mask)
                found[field].append(one)
        return found

    learned, checked = look(training), look(validation)
    rule = None
    if len(learned) > 1 and kind.can_say:
        measured = [frame for frame in validation if frame.raw_depth is not None]
        shown = load_frames(measured, size, "erased" if config.erase else "sensor")
        pixels = restored_pixels(model, shown, depth_range_m)
        assert pixels.signal is not None  # for the type checker
        rule = fit_confidence(pixels.signal, pixels.error_m, frames=len(measured))
    seen = np.stack([one.seen for field in learned.values() for one in field])
    sight = Sight.fit(seen)
    fields = {}
    for name, observations in learned.items():
        fields[name] = Field.fit(
            [sight.with_strangeness(one) for one in observations],
            [sight.with_strangeness(one) for one in checked[name]],
            rule if name == MEASURED else None,
        )
    counts = {"training": len(training), "validation": len(validation)}
    return {**Ground(fields, sight).to_dict(), "frames": counts}
