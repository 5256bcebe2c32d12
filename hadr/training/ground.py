"""Learn a depth network's ground from the frames that it was trained on."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import nn

from hadr.camera import FloatArray, resize_depth
from hadr.confidence.calibration import ConfidenceRule, fit_confidence
from hadr.confidence.known_ground import Field, Ground
from hadr.confidence.sight import Observation, Sight, observe
from hadr.corruption import CORRUPTIONS, Corruption, corrupt, erase_mask
from hadr.data.frame import Frame
from hadr.models.network_input import frame_to_input
from hadr.models.networks import NETWORKS
from hadr.training.batches import load_frames
from hadr.training.calibrate import restored_pixels
from hadr.training.checkpoints import kind_of

LEARNED, MEASURED = "depth as in training", "measured depth"


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
    raw depth are looked at with it as well, and there the confidence has a meaning of its own.

    Args:
        model: A depth network.
        size: (width, height) that it runs at, pixels.
        corruption: Of the frames that it learned from.
        depth_range_m: Depths of the object in training, metres.
        training: Frames that it has learned from; some of them are enough.
        validation: Frames that it has not: they set the limit.
        seed: Of the analytic corruption.
    """

    def look(frames: Sequence[Frame]) -> dict[str, list[Observation]]:
        found = defaultdict(list)
        for number, frame in enumerate(frames):
            for field, measured in _depths(
                frame, corruption, np.random.default_rng((seed, number))
            ):
                one = _observe(model, size, corruption, depth_range_m, frame, measured)
                if one is not None:
                    found[field].append(one)
        return found

    learned, checked = look(training), look(validation)
    rule = None
    if len(learned) > 1 and NETWORKS[kind_of(model)].can_say:
        rule = _measured_rule(model, size, corruption, depth_range_m, validation)
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


def _depths(
    frame: Frame, corruption: Corruption, rng: np.random.Generator
) -> Iterator[tuple[str, FloatArray]]:
    """The depths with which a frame is shown, by field: in the glass too."""
    if not CORRUPTIONS[corruption].captured:
        config = CORRUPTIONS[corruption]
        yield (
            LEARNED,
            corrupt(
                frame.depth, frame.object_mask, frame.camera, rng, config, frame.background_depth
            ),
        )
    if frame.raw_depth is not None:
        yield MEASURED, frame.raw_depth


def _observe(
    model: nn.Module,
    size: tuple[int, int],
    corruption: Corruption,
    depth_range_m: tuple[float, float],
    frame: Frame,
    measured: FloatArray,
) -> Observation | None:
    """Show the network a frame; None where no pixel of the glass is left at its size."""
    mask = frame.object_mask
    given = erase_mask(measured, mask) if CORRUPTIONS[corruption].erase else measured
    inputs = frame_to_input(frame.color, given, mask, frame.keypoints, frame.camera, size)
    if not inputs.mask.any():
        return None
    small = np.nan_to_num(resize_depth(measured, *size))
    with torch.inference_mode():
        return observe(model, NETWORKS[kind_of(model)].sees, inputs, small, depth_range_m)


def _measured_rule(
    model: nn.Module,
    size: tuple[int, int],
    corruption: Corruption,
    depth_range_m: tuple[float, float],
    validation: Sequence[Frame],
) -> ConfidenceRule:
    """What the network's confidence means on the frames that have raw depth."""
    shown: Corruption = "erased" if CORRUPTIONS[corruption].erase else "sensor"
    measured = [frame for frame in validation if frame.raw_depth is not None]
    pixels = restored_pixels(model, load_frames(measured, size, shown), depth_range_m)
    assert pixels.signal is not None  # for the type checker: the caller looks
    return fit_confidence(pixels.signal, pixels.error_m, frames=len(measured))
