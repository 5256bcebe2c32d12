"""`hadr calibrate`: teach a depth network's checkpoint what its confidence means."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from hadr.corruption import Corruption
from hadr.models.networks import NETWORKS
from hadr.records.option_words import FILE, FOLDER, ID, LARGEST_SEED, check_range
from hadr.records.output_folder import check_file, check_free
from hadr.records.provenance import provenance
from hadr.records.result_file import digest, write_result_file

if TYPE_CHECKING:
    from hadr.data.folders import FrameSource

_WHAT = "Confidence of"
"""How the file of measured numbers begins."""
RANGE_FRAMES = 600
"""At most so many training frames, evenly taken, are read for range and ground."""

LEAST_FRAMES = 10
"""So many frames each split needs for it: a confidence is fitted on some thousand pixels, which are
much alike in a frame."""

EPILOG = """
examples
  hadr calibrate runs/plus/last.safetensors data_samples/frames frames
  The frames of an object that was held out of the training measure it:
    hadr calibrate runs/plus/last.safetensors data_samples/frames \\
        --test-objects 0004 0007 --out confidence.json

exit status
  0 done   1 the disk is full   2 unusable checkpoint or data, or a wrong call"""


@dataclass(frozen=True)
class Options:
    """Calibrate a depth network's checkpoint.

    Fit what its confidence means on validation frames (of HADR-plus; the other networks
    cannot say how sure they are), note the depths that training has shown and what its
    frames were like, and write all of it into the checkpoint's record. Its weights stay.
    """

    checkpoint: tyro.conf.Positional[Annotated[Path, FILE]]
    """A .safetensors file that `hadr train` wrote."""
    data: tyro.conf.Positional[Annotated[tuple[Path, ...], FOLDER]]
    """Folders in TransHand's layout that it was trained on."""
    objects: Annotated[tuple[str, ...] | None, ID] = None
    """These objects only."""
    test_objects: Annotated[tuple[str, ...] | None, ID] = None
    """Of split test take these objects, such as those held out of the training."""
    corruption: Corruption = "oracle"
    """How the depth of the frames is corrupted."""
    seed: int = 0
    """Seed of the analytic corruption."""
    only_ground: bool = False
    """Note what the training frames were like and leave all else in the record: for a
    checkpoint of whose training frames only a part is at hand."""
    out: Annotated[Path | None, FILE] = None
    """Write what was measured as JSON into this file."""


def _check_beside(checkpoint: Path) -> None:
    """Check that the file in whose place the record is written is one, if there is a file."""
    beside, found = checkpoint.with_suffix(".json"), None
    if not beside.exists():
        return
    with contextlib.suppress(ValueError):
        found = json.loads(beside.read_text(encoding="utf-8"))
    if not isinstance(found, dict) or not {"network", "sha256"} <= found.keys():
        raise ValueError(
            f"{beside} is no checkpoint's record, but the place of that of {checkpoint.name}: "
            "move it away"
        )


def _check_learned(options: Options, learned: dict[str, Any], given: str) -> None:
    """Check that the network has learned from these frames, if its record says from which."""
    from hadr.data.folders import data_digest
    from hadr.data.splits import OBJECT_IDS, UNKNOWN_OBJECTS

    experiment, objects = learned.get("experiment", "known"), set(options.objects or OBJECT_IDS)
    other = "frames_sha256" if learned.get("frames_sha256", given) != given else ""
    if "sha256" in learned:  # of `hadr reproduce`
        if learned["sha256"] != digest([data_digest(folder) for folder in options.data]):
            other = "sha256"
        elif experiment == "by-frame" or (objects & set(UNKNOWN_OBJECTS) and experiment != "known"):
            other = f"experiment {experiment!r}"
    if not other:
        return
    words = (
        f"{options.checkpoint.name} has learned from other frames than those of "
        f"{', '.join(map(str, options.data))} (its record's {other} is not theirs)"
    )
    if not options.only_ground:
        raise ValueError(
            f"{words}: name the folders of its training in their order, and the same --objects; or "
            "--only-ground, for a part of them"
        )
    print(f"note           {words}; the ground is right if they are a part of them")


def run(options: Options) -> int:
    """Run `hadr calibrate`."""
    from hadr.confidence.calibration import ConfidenceRule
    from hadr.data.folder_checks import check_data
    from hadr.training.calibrate import calibrate, learn_ground, measure_confidence, restored_pixels
    from hadr.training.checkpoints import (
        kind_of,
        load_checkpoint,
        trained_corruption,
        update_record,
    )
    from hadr.training.frames.batches import load_frames

    check_range("seed", options.seed, 0, LARGEST_SEED)

    def check() -> None:
        check_file(options.out, what=_WHAT)
        check_free(options.out)
        check_free(options.checkpoint)

    check()
    model, meta = load_checkpoint(options.checkpoint)
    _check_beside(options.checkpoint)
    name, kind = options.checkpoint.name, kind_of(model)
    if NETWORKS[kind].answer != "depth":
        raise ValueError(f"{name} holds a network of kind {kind!r}, which restores no depth")
    learned = trained_corruption(meta)
    if learned != options.corruption:
        raise ValueError(
            f"{name} was trained with corruption {learned!r}; a calibration with "
            f"{options.corruption!r} would speak of other pictures than it restores"
        )
    if options.only_ground and "learned_range" not in meta:
        raise ValueError(f"{name} was never calibrated: leave --only-ground out")
    size = int(meta["width"]), int(meta["height"])
    tested = options.test_objects or options.objects
    given = check_data(options.data, ("train", "val"), options.objects)
    alike = tested == options.objects
    check_data(options.data, ("train", "val", "test") if alike else ("test",), tested)
    learned_from, held_back, unseen = (
        _frames(options, split, objects)
        for split, objects in (
            ("train", options.objects), ("val", options.objects), ("test", tested)
        )
    )  # fmt: skip
    for split, source in (("train", learned_from), ("val", held_back)):
        if len(source) < LEAST_FRAMES:
            raise ValueError(
                f"split {split} has {len(source)} frames of it, expected {LEAST_FRAMES} or more: "
                "what is fitted on fewer says nothing of others"
            )
    _check_learned(options, meta.get("data") or {}, given)
    additions: dict[str, Any] = {}
    if not options.only_ground:
        train, validation, test = (
            load_frames(frames, size, options.corruption, options.seed)
            for frames in (learned_from, held_back, unseen)
        )
        words = f"split val of {len(options.data)} folder(s), corruption {options.corruption}"
        additions = calibrate(model, train, validation, words)
    near, far = (additions or meta)["learned_range"]["depth_m"]
    additions["ground"] = learn_ground(
        model, size, options.corruption, (near, far), learned_from, held_back, options.seed
    )
    check()  # another run may have begun there meanwhile
    update_record(options.checkpoint, additions)
    print(f"learned range  {near:.3f} to {far:.3f} m")
    print(f"ground         of {', '.join(additions['ground']['fields'])}")
    if options.only_ground:
        return 0
    if not NETWORKS[kind].can_say:
        unwritten = f"; {options.out} is not written" if options.out else ""
        print(f"confidence     a network of kind {kind} cannot say how sure it is{unwritten}")
        return 0
    rule = ConfidenceRule.from_dict(additions["confidence"])
    rows = []
    for split, source, frames in (("val", held_back, validation), ("test", unseen, test)):
        pixels = restored_pixels(model, frames, (near, far))
        found = measure_confidence(rule, pixels, source.holds(frames.stems))
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
            f"{_WHAT} {name}, fitted on the frames of split val and "
            f"measured on those and on split test{of}: pixels of the object that were restored, at "
            f"{size[0]}x{size[1]}. 'Right' is an error below {rule.calibration.tolerance_m} m. "
            "Standard errors are those of a bootstrap over holds."
        )
        write_result_file(options.out, what, rows, provenance())
    return 0


def _frames(options: Options, split: str, objects: Sequence[str] | None) -> FrameSource:
    """The frames of a split; of many for training some, evenly taken."""
    from hadr.data.folders import FrameSource, open_folder

    source = FrameSource([open_folder(folder, split, objects) for folder in options.data])
    if split == "train" and len(source) > RANGE_FRAMES:
        step = len(source) / RANGE_FRAMES
        source = FrameSource(source.folders, [int(step * n) for n in range(RANGE_FRAMES)])
    return source
