"""Put the small checkpoints into data_samples/checkpoints, calibrated, with their records.

    hadr reproduce --preset imagenet --data NEAR --out OUT \\
        --only known/hadr-long known/hadr-plus-long known/unet-hand
    hadr train --network hand-keypoints --preset imagenet --data NEAR \\
        --start-from data_samples/checkpoints/hand-keypoints-handover.safetensors \\
        --out OUT/nets/hand-keypoints
    python benchmarks/samples/bundle_checkpoints.py --made OUT --data NEAR \\
        --only hadr-imagenet hadr-plus-imagenet hand-keypoints-imagenet

    python benchmarks/handover/handover_frames.py --out CAMERA
    for network in unet-hand hadr hadr-plus hand-keypoints segmentation; do
        hadr train --network $network --preset imagenet --data CAMERA --corruption erased \\
            --start-from FILE --out OUT/handover/$network
    done  # with all options: data_samples/checkpoints/README.md
    python benchmarks/samples/bundle_checkpoints.py --made OUT --data CAMERA \\
        --only unet-hand-handover hadr-handover hadr-plus-handover \\
        hand-keypoints-handover segmentation-imagenet

NEAR is what `hadr generate --preset mini --no-sensor --frames 3000` makes. The last epoch's weights
are taken, which was fixed beforehand, and stored as 8-bit integers. Depth networks are calibrated
on validation frames; what that measured goes to results/confidence. What NEAR's frames are like is
then replaced by what the samples are like, which have a sensor's depth, too.
"""

import argparse
import json
import tempfile
from pathlib import Path

from hadr.cli import main as hadr
from hadr.data.samples import samples_dir, write_manifest
from hadr.experiments.protocol import Experiment, open_part
from hadr.models.networks import DEPTH_NETWORKS
from hadr.records.checkout import checkout_root
from hadr.synthesis.glass.objects import OBJECTS
from hadr.training.checkpoints import Stored, load_checkpoint, save_checkpoint, update_record

STORED: Stored = "int8"
SOURCES: dict[str, tuple[str, Experiment | None]] = {
    "hadr-imagenet": ("runs/known/hadr-long/seed-0", "known"),
    "hadr-plus-imagenet": ("runs/known/hadr-plus-long/seed-0", "known"),
    "hand-keypoints-imagenet": ("nets/hand-keypoints", None),
    "unet-hand-handover": ("handover/unet-hand", None),
    "hadr-handover": ("handover/hadr", None),
    "hadr-plus-handover": ("handover/hadr-plus", None),
    "hand-keypoints-handover": ("handover/hand-keypoints", None),
    "segmentation-imagenet": ("handover/segmentation", None),
}
"""Folder of the training of each checkpoint; of a depth network, the experiment it belongs to."""
GIVEN = {
    "hand-keypoints": "{depth}; true hand mask",
    "segmentation": "none: colour alone",
}
"""What a network was given; the others are `DEPTH_GIVEN`."""
DEPTH_GIVEN = "{depth}; {keypoints}"
DEPTHS = {
    False: ("oracle: depth erased in the object's mask", "true keypoints"),
    True: ("erased: measured depth, none in the object's mask", "keypoints with an error of 4 mm"),
}
"""Depth and keypoints, also of the handover's camera."""


def bundle(name: str, made: Path, data: list[Path], folder: Path) -> None:
    """Write one checkpoint: weights, record, calibration."""
    source, experiment = SOURCES[name]
    small = folder / f"{name}.safetensors"
    camera = source.startswith("handover/")
    save_checkpoint(small, *load_checkpoint(made / source / "last.safetensors"), stored=STORED)
    model, record = load_checkpoint(small)
    depth, keypoints = DEPTHS[camera]
    where = "before the robot" if camera else "of TransHand-mini"
    if name.endswith("-imagenet"):
        where += " and of TransHand-mini, both editions" if camera else ", second edition"
    if camera:
        parts, objects = record["data"]["frames"], tuple(OBJECTS)
    else:
        of = experiment or "known"
        parts = {part: len(open_part(data, of, part)) for part in ("train", "val")}
        names = open_part(data, of, "train").names
        objects = tuple(sorted({name.partition("/")[0] for name in names}))
    row = made / source / "row.json"  # a frame without a pixel of the glass is left out
    if row.exists():
        parts["train"] = json.loads(row.read_text(encoding="utf-8"))["training_frames"]
    elif "frames" in record["data"]:
        parts = record["data"]["frames"]
    history = record["history"]
    validation = {
        key.removeprefix("validation_"): value
        for key, value in history[-1].items()
        if key.startswith("validation_")
    }
    update_record(
        small,
        {
            "name": name,
            "provenance": f"preset {record['preset']['name']}, epoch {record['epochs']} of "
            f"{record['preset']['epochs']}, trained on {parts['train']} frames of "
            f"{len(objects)} objects " + where,
            "corruption": GIVEN.get(record["network"], DEPTH_GIVEN).format(
                depth=depth, keypoints=keypoints
            ),
            "data": {**record["data"], "frames": parts, "objects": list(objects)},
            "training": {
                "selected": "the last epoch, fixed beforehand: no frame was used for the choice",
                "epochs": record["epochs"],
                "seconds": sum(row["seconds"] for row in history),
            },
            "validation": validation,
            "weights": {"number": sum(p.numel() for p in model.parameters()), "stored": STORED},
        },
    )
    if record["network"] in DEPTH_NETWORKS:
        result = checkout_root() / "results" / "confidence" / f"{name}.json"
        only = ["--corruption", "erased"] if camera else []
        command = ["calibrate", str(small), *map(str, data), "--out", str(result), *only]
        ground = ["calibrate", str(small), str(samples_dir() / "frames"), "--only-ground"]
        for words in [command] if camera else [command, ground]:
            if hadr(words) != 0:
                raise SystemExit(f"hadr {' '.join(words)} failed")
    print(f"{name}: {small.stat().st_size / 1e6:.1f} MB", flush=True)


def readme_table(folder: Path) -> str:
    """Set what the bundled checkpoints are and what they reach on validation frames."""
    lines = [
        "| checkpoint | weights | size (MB) | trained on | minutes (one core, or GPU) "
        "| on validation frames |",
        "|:--|--:|--:|:--|--:|:--|",
    ]
    for name in SOURCES:
        if not (folder / f"{name}.json").exists():
            continue
        record = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        size = (folder / f"{name}.safetensors").stat().st_size / 1e6
        gpu = " (GPU)" * (record["made_with"].get("device", "cpu") != "cpu")
        seen, data = record["validation"], record["data"]
        lines.append(
            f"| `{name}` | {record['weights']['number']:,} | {size:.1f} | "
            f"{data['frames']['train']:,} frames of {len(data['objects'])} objects | "
            f"{record['training']['seconds'] / 60:.0f}{gpu} | {reached(seen)} |"
        )
    return "\n".join(lines)


def reached(validation: dict[str, float]) -> str:
    """Say in words what a network reaches."""
    if "rmse_m" in validation:
        return (
            f"RMSE {100 * validation['rmse_m']:.2f} cm, MAE {100 * validation['mae_m']:.2f} cm, "
            f"δ1.05 {validation['delta_105']:.1f} %"
        )
    if "keypoints_m" in validation:
        return (
            f"mean distance {1000 * validation['keypoints_m']:.1f} mm, "
            f"{100 * validation['within_20mm']:.0f} % within 2 cm"
        )
    return (
        f"intersection over union: glass {validation['object_iou']:.3f}, "
        f"hand and arm {validation['hand_iou']:.3f}"
    )


def main() -> None:
    """Write all checkpoints, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--made", type=Path, required=True, help="OUT of the trainings")
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument("--only", nargs="+", choices=tuple(SOURCES), default=list(SOURCES))
    args = parser.parse_args()
    target = samples_dir() / "checkpoints"
    with tempfile.TemporaryDirectory(dir=target) as scratch:
        for name in args.only:
            bundle(name, args.made, args.data, Path(scratch))
        for path in sorted(Path(scratch).iterdir()):
            path.replace(target / path.name)
    readme = target / "README.md"
    begin, end = "<!-- checkpoints -->", "<!-- end checkpoints -->"
    before, rest = readme.read_text(encoding="utf-8").split(begin)
    after = rest.split(end)[1]
    readme.write_text(f"{before}{begin}\n{readme_table(target)}\n{end}{after}", encoding="utf-8")
    write_manifest()


if __name__ == "__main__":
    main()
