"""`hadr calibrate`: teach a depth network's checkpoint what its confidence means.

Adds three things to the record of a checkpoint and leaves its weights alone:

* ``learned_range``: the depths at which training has shown the object;
* ``confidence``: how the spread that the network predicts becomes the probability that a restored
  depth is right to 2 cm, fitted on validation frames. A network that predicts no distribution of
  depth (`hadr.models.networks`) cannot say how sure it is, and gets none;
* ``ground``: what the training frames were like (`hadr.known_ground`). On others the confidence
  does not hold, and is not given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numpy.typing import NDArray
from torch import nn

from hadr.camera import FloatArray
from hadr.confidence import (
    ConfidenceRule,
    Signal,
    fit_confidence,
    learned_range,
    reliability,
    signal_of,
    sparsification,
    within_learned,
)
from hadr.corruption import CORRUPTIONS, Corruption
from hadr.data.folders import FrameSource, open_folder
from hadr.models.networks import NETWORKS
from hadr.records.output_folder import check_writable
from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file
from hadr.training.batches import FrameTensors, load_frames
from hadr.training.checkpoints import kind_of, load_checkpoint, update_record
from hadr.training.evaluation import predict
from hadr.training.ground import learn_ground

RANGE_FRAMES = 600
"""At most so many training frames, evenly taken, are read for the range of depths."""


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
    signal: Signal = "candidates",
    batch_size: int = 8,
) -> RestoredPixels:
    """Restore frames; collect error and signal of each restored pixel of the object."""
    sure = NETWORKS[kind_of(model)].can_say
    errors, numbers, signals = [], [], []
    first, scorable = 0, 0
    for output in predict(model, frames, batch_size):
        count = len(output.depth)
        truth = frames.true_depth[first : first + count]
        scored = frames.object_mask[first : first + count] & (truth > 0)
        scorable += int(scored.sum())
        kept = scored & within_learned(output, depth_range_m).cpu()
        errors.append((output.depth.cpu() - truth)[kept].numpy().astype(np.float64))
        numbers.append(kept.nonzero()[:, 0].numpy() + first)
        if sure:
            signals.append(signal_of(output, signal).cpu()[kept].numpy())
        first += count
    error = np.concatenate(errors)
    return RestoredPixels(
        signal=np.concatenate(signals) if sure else None,
        error_m=error,
        frame=np.concatenate(numbers),
        coverage=len(error) / max(scorable, 1),
    )


def measure_confidence(
    rule: ConfidenceRule, pixels: RestoredPixels, *, draws: int = 200
) -> dict[str, Any]:
    """Measure how honest a confidence is on some frames, and what it knows.

    Args:
        rule: The confidence.
        pixels: Pixels of other frames than those it was fitted on.
        draws: Bootstrap draws of whole frames, for the standard errors.

    Returns:
        Numbers by name: lengths in metres; RMSE of all pixels and of those that remain when a
        tenth is dropped (the least sure, or the worst: the oracle), their means over all shares
        dropped, and the curves themselves.
    """
    if pixels.signal is None:
        raise ValueError("these pixels are of a network that cannot say how sure it is")
    sure = rule(pixels.signal)
    right = np.abs(pixels.error_m) < rule.calibration.tolerance_m
    order = rule.ordering(pixels.signal)
    curve, bins = sparsification(order, pixels.error_m), reliability(sure, right)
    tenth = int(np.flatnonzero(np.isclose(curve.dropped, 0.1))[0])

    rng = np.random.default_rng(0)
    frames, place = np.unique(pixels.frame, return_inverse=True)
    rows = [np.flatnonzero(place == number) for number in range(len(frames))]
    gains, gaps = [], []
    for _ in range(draws):
        drawn = np.concatenate([rows[n] for n in rng.integers(len(frames), size=len(frames))])
        again = sparsification(order[drawn], pixels.error_m[drawn], (0.0, 0.1))
        gains.append(again.rmse_m[0] - again.rmse_m[1])
        gaps.append(reliability(sure[drawn], right[drawn]).expected_error)
    return {
        "frames": len(frames),
        "pixels": len(pixels.error_m),
        "coverage": pixels.coverage,
        "share_right": float(right.mean()),
        "mean_confidence": float(sure.mean()),
        "expected_calibration_error": bins.expected_error,
        "expected_calibration_error_standard_error": float(np.std(gaps)),
        "rmse_m": curve.random_rmse_m,
        "rmse_at_90_m": float(curve.rmse_m[tenth]),
        "gain_at_90_m": curve.random_rmse_m - float(curve.rmse_m[tenth]),
        "gain_at_90_standard_error_m": float(np.std(gains)),
        "oracle_rmse_at_90_m": float(curve.oracle_rmse_m[tenth]),
        "mean_rmse_m": float(curve.rmse_m.mean()),
        "oracle_mean_rmse_m": float(curve.oracle_rmse_m.mean()),
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
    """Make the first two additions to a checkpoint's record.

    Args:
        model: A depth network.
        train: Frames that it has learned from, at its size; some of them are enough.
        validation: Frames that it has not learned from.
        source: What the validation frames are, for the record.

    Returns:
        The keys ``learned_range`` and, for a network that can say, ``confidence``.
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


def measured_rule(
    model: nn.Module,
    size: tuple[int, int],
    corruption: Corruption,
    depth_range_m: tuple[float, float],
    validation: FrameSource,
) -> ConfidenceRule | None:
    """Fit what the confidence of a network that learned from computed depth means on a camera's.

    None for a network that learned from a camera's depth, or cannot say how sure it is, and where
    no frame has raw depth.
    """
    if CORRUPTIONS[corruption].captured or not NETWORKS[kind_of(model)].can_say:
        return None
    shown: Corruption = "erased" if CORRUPTIONS[corruption].erase else "sensor"
    measured = [frame for frame in validation if frame.raw_depth is not None]
    if not measured:
        return None
    pixels = restored_pixels(model, load_frames(measured, size, shown), depth_range_m)
    assert pixels.signal is not None  # for the type checker
    return fit_confidence(pixels.signal, pixels.error_m, frames=len(measured))


EPILOG = """
examples
  hadr calibrate runs/plus/last.safetensors data_samples/frames frames
  The frames of an object that was held out of the training measure it:
    hadr calibrate runs/plus/last.safetensors data_samples/frames \\
        --test-objects 0010 --out confidence.json

exit status
  0 done   2 unusable checkpoint or data, or a wrong call"""


@dataclass(frozen=True)
class Options:
    """Calibrate a depth network's checkpoint.

    Fit what its confidence means on validation frames (of HADR-plus; the other networks
    cannot say how sure they are), note the depths that training has shown and what its frames
    were like, and write all of it into the checkpoint's record. Its weights stay.
    """

    checkpoint: tyro.conf.Positional[Path]
    """A .safetensors file that `hadr train` wrote."""
    data: tyro.conf.Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(metavar="DATA [DATA ...]")]
    ]
    """Folders in TransHand's layout that it was trained on."""
    objects: Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="ID [ID ...]")] = None
    """These objects only."""
    test_objects: Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="ID [ID ...]")] = None
    """Of split test take these objects, such as those held out of the training."""
    corruption: Corruption = "oracle"
    """How the depth of the frames is corrupted."""
    seed: int = 0
    """Seed of the analytic corruption."""
    only_ground: bool = False
    """Note what the training frames were like, and leave what the record says else: for a
    checkpoint of whose training frames only a part is at hand."""
    out: Path | None = None
    """Write what was measured as JSON into this file."""


def run(options: Options) -> int:
    """Run `hadr calibrate`."""
    check_writable(options.out)
    if not options.data:
        raise ValueError("name at least one folder in TransHand's layout behind the checkpoint")
    model, meta = load_checkpoint(options.checkpoint)
    name, kind = options.checkpoint.name, kind_of(model)
    if NETWORKS[kind].answer != "depth":
        raise ValueError(f"{name} holds a network of kind {kind!r}, which restores no depth")
    learned = str(meta.get("data", {}).get("corruption", "oracle")).split(":")[0]
    if learned != options.corruption:
        raise ValueError(
            f"{name} was trained with corruption {learned!r}; a calibration with "
            f"{options.corruption!r} would speak of other pictures than it restores"
        )
    size = int(meta["width"]), int(meta["height"])
    tested = options.test_objects or options.objects
    sources = {
        split: _frames(options, split, objects)
        for split, objects in (
            ("train", options.objects), ("val", options.objects), ("test", tested)
        )
    }  # fmt: skip
    train, validation, test = (
        load_frames(frames, size, options.corruption, options.seed) for frames in sources.values()
    )
    source = f"split val of {len(options.data)} folder(s), corruption {options.corruption}"
    additions: dict[str, Any] = (
        {} if options.only_ground else calibrate(model, train, validation, source)
    )
    near, far = (additions or meta)["learned_range"]["depth_m"]
    additions["ground"] = learn_ground(
        model,
        size,
        options.corruption,
        (near, far),
        sources["train"],
        sources["val"],
        measured_rule=measured_rule(model, size, options.corruption, (near, far), sources["val"]),
        seed=options.seed,
    )
    update_record(options.checkpoint, additions)
    print(f"learned range  {near:.3f} to {far:.3f} m")
    print(f"ground         {', '.join(additions['ground']['fields'])}")
    if options.only_ground:
        return 0
    if not NETWORKS[kind].can_say:
        unwritten = f"; {options.out} is not written" if options.out else ""
        print(f"confidence     a network of kind {kind} cannot say how sure it is{unwritten}")
        return 0
    rule = ConfidenceRule.from_dict(additions["confidence"])
    rows = []
    for split, frames in (("val", validation), ("test", test)):
        found = measure_confidence(rule, restored_pixels(model, frames, (near, far)))
        rows.append({"split": split, "network": kind, **found})
        print(
            f"{split:<14} {found['frames']} frames, {100 * found['coverage']:.1f} % restored, RMSE "
            f"{found['rmse_m']:.4f} m; without the least sure tenth {found['rmse_at_90_m']:.4f} m "
            f"(oracle {found['oracle_rmse_at_90_m']:.4f}); calibration error "
            f"{found['expected_calibration_error']:.3f}"
        )
    if options.out:
        of = f" of objects {', '.join(options.test_objects)}" if options.test_objects else ""
        what = (
            f"Confidence of {name}, fitted on the frames of split val and "
            f"measured on those and on split test{of}: pixels of the object that were restored, at "
            f"{size[0]}x{size[1]}. 'Right' is an error below {rule.calibration.tolerance_m} m. "
            "Standard errors are those of a bootstrap over frames, of which two or three show one "
            "hold: somewhat too small."
        )
        write_result_file(options.out, what, rows, provenance())
    return 0


def _frames(options: Options, split: str, objects: Sequence[str] | None) -> FrameSource:
    """The frames of a split; evenly taken ones of many for training."""
    source = FrameSource([open_folder(folder, split, objects) for folder in options.data])
    if split == "train" and len(source) > RANGE_FRAMES:
        step = len(source) / RANGE_FRAMES
        source = FrameSource(source.folders, [int(step * n) for n in range(RANGE_FRAMES)])
    return source
