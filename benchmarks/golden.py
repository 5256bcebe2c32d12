"""Show that a change of structure changes no result: record what the code computes, compare later.

    python benchmarks/golden.py record build/golden.json
    python benchmarks/golden.py compare build/golden.json --only depth training

A record is one SHA-256 a result, and beside it (`.npz`) all texts and some values of each array, so
that `compare` can say how a result differs. Bytes depend on the processor: use one machine. Of the
pages of a built book (`--book`) times, dates, commits and names of modules do not count.
"""

import os

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import argparse
import hashlib
import json
import re
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
KEPT = 2048  # values of an array
Results = Iterator[tuple[str, Any]]
"""Names with their values: bytes, texts, arrays, or what JSON can hold."""


def _below(folder: str | Path) -> list[tuple[str, Path]]:
    found = sorted(path for path in Path(folder).rglob("*") if path.is_file())
    return [(str(path.relative_to(folder)), path) for path in found]


def _fields(name: str, rows: Iterable[Any], *fields: str) -> Results:
    """Fields of things in a row, such as the moments of a path, as arrays."""
    for field in fields:
        yield f"{name} {field}", np.array([np.asarray(getattr(row, field)) for row in rows])


def generated(*words: str) -> Results:
    """All files that `hadr generate` writes, and the values of its images."""
    import cv2

    from hadr.cli import main

    with tempfile.TemporaryDirectory() as folder:
        size = ("--frames", "6", "--width", "128", "--height", "72", "--workers", "1")
        if status := main(["generate", "--out", folder, *size, *words]):
            raise RuntimeError(f"hadr generate {' '.join(words)} exited with {status}")
        for name, path in _below(folder):
            yield name, path.read_text("utf-8") if path.suffix == ".json" else path.read_bytes()
            if path.suffix in (".png", ".jpg"):
                yield f"{name} values", cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            elif path.suffix == ".npy":
                yield f"{name} values", np.load(path)


def hand() -> Results:
    """Meshes of two recorded poses, the hand's motions, and tracking them through noise."""
    from hadr.data.samples import samples_dir
    from hadr.hand import forward_kinematics, keypoints_from_skeleton
    from hadr.handover.tracking import hand_motion
    from hadr.simulation.world.hand_motions import KINDS, SeededMotion
    from hadr.synthesis.hand.mesh import hand_mesh
    from hadr.synthesis.recordings.recording import find_recordings, read_recording

    rng = np.random.default_rng(0)
    for path in find_recordings(samples_dir() / "recordings")[:60:59]:
        recording = read_recording(path)
        skeleton = forward_kinematics(recording.angles[0], recording.shape)
        mesh = hand_mesh(skeleton, recording.shape)
        yield from _fields(f"{path.stem} mesh", [mesh.surface], "vertices", "faces", "normals")
        yield from _fields(path.stem, [recording], "time", "angles", "wrist_from_object")
        yield from _fields(path.stem, [mesh], "albedo", "gloss")
        keypoints = keypoints_from_skeleton(skeleton.joints)
        for kind in KINDS:
            motion = SeededMotion(kind, np.array([0.6, 0.0, 0.3]), seed=5)
            poses = np.array([motion.moved(time) for time in np.arange(0.0, 6.0, 0.1)])
            yield f"{path.stem} moved, {kind}", poses
            seen = keypoints @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
            seen += rng.normal(0, 0.004, seen.shape)
            seen[:, 5:9, 2] += 0.03  # a finger moves by itself
            for robust in (False, True):
                followed = [hand_motion(keypoints, now, robust=robust) for now in seen]
                name = f"{path.stem} followed, {kind}, robust {robust}"
                yield from _fields(name, followed, "current_from_initial", "residual")


def ur5() -> Results:
    """The UR5's kinematics, a rehearsed handover, and an attempt in the physical world."""
    from hadr.handover.grasping.selection import GraspSelection
    from hadr.handover.poses import camera_at
    from hadr.handover.simulated_ur5 import SimulatedUR5
    from hadr.handover.ur5 import forward_kinematics, inverse_kinematics
    from hadr.handover.workflow import Handover
    from hadr.simulation.trials.rehearsal import MovingHand, rehearse, rehearsed_scene
    from hadr.simulation.trials.trial import Trial, run_trial

    joints = np.random.default_rng(0).uniform(-2, 2, (20, 6))
    flanges = np.array([forward_kinematics(row) for row in joints])
    yield "forward kinematics", flanges
    yield "inverse kinematics", np.concatenate([inverse_kinematics(pose) for pose in flanges])
    camera = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))
    selection = GraspSelection(np.random.default_rng(3), camera[:3, 3])
    handover = Handover(SimulatedUR5(), selection, camera)
    moments = rehearse(handover, MovingHand(rehearsed_scene(), camera, seed=3))
    yield from _fields("rehearsal", moments, "joints", "tool")
    yield "rehearsal opening", np.array([m.gripper_width for m in moments])
    yield "rehearsal glass", np.array([m.base_from_object for m in moments])
    yield "rehearsal to_hand", np.array([m.hand_distance for m in moments])
    run = run_trial(Trial("0004", 902, condition="perfect"))
    seen = ("joints", "gripper_width", "base_from_wrist", "base_from_object", "hand_force")
    yield from _fields("attempt", run.states, *seen)
    yield "attempt outcome", {k: str(v) for k, v in vars(run.outcome).items() if "wall" not in k}
    for name, changes in (("rehearsal", handover.transitions), ("attempt", run.transitions)):
        told = [f"{c.time:.3f} {c.before.value} -> {c.after.value}: {c.reason}" for c in changes]
        yield f"{name} transitions", told


def depth() -> Results:
    """What each bundled checkpoint makes of four test frames."""
    from hadr.data.samples import open_samples, samples_dir
    from hadr.restoration import Restorer

    frames, folder = [open_samples("test")[i] for i in (0, 13, 26, 39)], samples_dir()
    for network in sorted(map(str, (folder / "checkpoints").glob("*.safetensors"))):
        for frame in frames:
            restoring = re.sub("segmentation|hand-keypoints", "hadr-plus", network)
            restorer = Restorer("auto", restoring)
            given = {"mask": frame.object_mask, "keypoints": frame.keypoints}
            if "segmentation" in network:
                restorer = Restorer("auto", restoring, segmentation=network)
                given = {"keypoints": frame.keypoints}
            elif "hand-keypoints" in network:
                restorer = Restorer("auto", restoring, keypoint_network=network)
                given = {"mask": frame.object_mask, "hand_mask": frame.hand_mask}
            found = restorer(frame.color, frame.raw_depth, frame.camera, **given)
            name = f"{Path(network).stem} {frame.object_id}/{frame.stem}"
            yield from _fields(name, [found], "depth", "confidence", "restored", "mask")
            yield f"{name} notes", list(found.notes)


def training() -> Results:
    """What training is given, and two epochs of each network at its smallest."""
    from hadr.corruption import CORRUPTIONS
    from hadr.data.samples import open_samples
    from hadr.models.networks import NETWORKS
    from hadr.training.frames.batches import load_frames
    from hadr.training.loop import train
    from hadr.training.presets import preset

    some, few = ([open_samples(s)[i] for i in range(5, 95, 12)] for s in ("train", "val"))
    for corruption in CORRUPTIONS:
        read = load_frames(few, (128, 72), corruption).inputs
        yield from _fields(corruption, [read], *(field.name for field in fields(read)))
    short = {"epochs": 2, "drop_epoch": 1, "batch_size": 4, "true_voxel_epochs": 1}
    for network in NETWORKS:
        recipe = replace(preset("tiny", network), augment=True, average_decay=0.9, **short)
        frames = [load_frames(part, recipe.size) for part in (some, few)]
        trained = train(recipe, *frames, seed=1, progress=False)
        weights = [weight.double().numpy() for weight in trained.model.state_dict().values()]
        yield f"{network} weights", sorted(_digest(weight) for weight in weights)
        yield f"{network} sums of weights", np.sort([np.abs(weight).sum() for weight in weights])
        history = [{k: v for k, v in row.items() if k != "seconds"} for row in trained.history]
        yield f"{network} history", history


def results() -> Results:
    """The stored results, and every table that the book makes from them, without its padding."""
    for name, value in _tables():
        if isinstance(value, str):
            value = re.sub(r"(?m)(?<=\|) +(?=[^\n|]*\|)| +(?=\|)", " ", value)
            value = re.sub(r"(?m)(?<=\|)(:?)-+(:?)(?=\|)", r"\1--\2", value)
        yield name, value


def _tables() -> Results:
    from hadr.figures.depth.sensor import sensor_table
    from hadr.figures.tables import benchmarks, comparison
    from hadr.figures.tables import handover as handover_tables
    from hadr.figures.tables.results import results_table
    from hadr.press.book import REPORTS
    from hadr.records.result_file import read_result_file, read_sealed

    for name, path in _below(folder := ROOT / "results"):
        yield name, path.read_bytes()
    for token, text in REPORTS.items():
        yield token, text(folder)
    names = ("known", "unknown", "ablation", "handover", "memory", "errors")
    rows = {n: read_result_file(folder / "mini" / f"{n}.json").rows for n in names}
    own, conditions = rows["known"] + rows["unknown"], rows["handover"]
    tables = {name: rows[name] for name in ("known", "unknown", "ablation")}
    paper = json.loads((folder / "paper_tables.json").read_text(encoding="utf-8"))
    reasons = {name: ("reason", "place") for name in comparison.compared(own, paper, "known")}
    by_heart = read_result_file(folder / "training" / "overfit.json").rows
    yield "results", results_table(own, paper)
    yield "orders", comparison.orders_table(own, paper)
    yield "reasons", comparison.reasons_table(tables, paper, reasons)
    yield "ablation", comparison.ablation_table(rows["ablation"], paper)
    yield "handover", handover_tables.conditions_table(conditions, {})
    yield "handover, pairs", [handover_tables.paired(conditions[0], row) for row in conditions[1:5]]
    yield "by heart", benchmarks.by_heart_table(by_heart)
    yield "memory", comparison.memory_table(rows["memory"])
    yield "averages", comparison.averages_table(own)
    yield "poses", comparison.poses_table(rows["errors"])
    yield "sensor", sensor_table(read_sealed(folder / "sensor" / "comparison.json")["columns"])


LEFT_OUT = ("_", "library", "genindex", "py-modindex", "search", "running")
NO_RESULT = (
    (r"(?m)^\s*(from|import) hadr[^(\n]*(\([^)]*\))?", ""),
    (r"\bhadr(\.\w+)+", "hadr.*"),
    (r"\d+ microseconds.*|\d+ times faster", "TIME"),
    (r"\b\d\.\d+e-1\d\b", "ZERO"),
    (r"\b\d[\d.,]*\s*(ms|s|seconds?|min|minutes?|h|hours?)\b", "TIME"),
    (r"\bTIME( TIME)+", "TIME"),
    (r"\b20\d\d-\d\d-\d\d([T ]\d\d:\d\d(:\d\d)?Z?)?", "DATE"),
    (r"\b(?=[a-f]*\d)(?=\d*[a-f])[0-9a-f]{7,64}\b", "COMMIT"),
    (r"Python 3[\d.]+", "PYTHON"),
)


def pages(book: Path) -> Results:
    """Text of a built book's pages with the pictures' descriptions; code apart from the rest."""
    from bs4 import BeautifulSoup

    for name, path in _below(book):
        if path.suffix != ".html" or name.startswith(LEFT_OUT):
            continue
        article = BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser").article
        for hidden in article(["script", "style"]):
            hidden.decompose()
        for image in article("img"):
            image.replace_with(f"[picture: {image.get('alt', '')}]")
        code = "\n".join(cell.extract().get_text() for cell in article.select(".cell_input"))
        for kind, text in (("text", article.get_text()), ("code", code)):
            for pattern, word in NO_RESULT:
                text = re.sub(pattern, word, text)
            yield f"{name} {kind}", [x for line in text.splitlines() if (x := line.strip())]


PHOTO = ("--preset", "samples", "--variant", "scalar_rgb", "--samples", "2")
PARTS: dict[str, Any] = {
    "generate-photo": partial(generated, *PHOTO),
    "generate-raycast": partial(generated, "--engine", "raycast", "--sensor", "--seed", "3"),
    **{part.__name__: part for part in (hand, ur5, depth, training, results, pages)},
}


def _digest(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = f"{value.dtype} {value.shape}".encode() + value.tobytes()
    return hashlib.sha256(value.encode() if isinstance(value, str) else value).hexdigest()


def _kept(value: Any) -> Any:
    return np.array(value) if isinstance(value, str) else value.ravel()[:: value.size // KEPT + 1]


def compute(part: str, book: Path) -> dict[str, Any]:
    """The results of a part: bytes, texts or arrays, by name."""
    found = PARTS[part](*([book] if part == "pages" else []))
    usual = (bytes, str, np.ndarray)
    return {n: v if isinstance(v, usual) else json.dumps(v, indent=1) for n, v in found}


def difference(old: Any, value: Any) -> str:
    """How a result differs from what was kept of it."""
    if old is None or isinstance(value, bytes):
        return "other bytes"
    new = _kept(value)
    if old.dtype.kind == "U":
        both = zip(f"{old}\n(end)".splitlines(), f"{new}\n(end)".splitlines(), strict=False)
        return "first\n    - {:.300}\n    + {:.300}".format(*next(x for x in both if x[0] != x[1]))
    if old.shape != new.shape or old.dtype != new.dtype:
        return f"{old.size} kept values of {old.dtype}, now {new.size} of {new.dtype}"
    apart = np.abs(np.nan_to_num(old.astype(float)) - np.nan_to_num(new.astype(float)))
    return f"by at most {apart.max():.3g}, {np.count_nonzero(apart)} of {apart.size} kept values"


def main() -> int:
    """Record or compare; 1 if a result differs or could not be computed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("command", choices=("record", "compare"))
    parser.add_argument("file", type=Path, help="the record, .json; beside it lies a .npz")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--book", type=Path, default=ROOT / "build/html/_build/html")
    args = parser.parse_args()
    digests, kept, wrong = dict[str, Any](), dict[str, Any](), 0
    if args.file.exists():
        digests = json.loads(args.file.read_text(encoding="utf-8"))
        kept = dict(np.load(args.file.with_suffix(".npz")))
    for part in args.only:
        start = time.perf_counter()
        if part == "pages" and not (args.book / "index.html").is_file():
            print(f"pages: left out, there is no built book in {args.book} (make book, or --book)")
            continue
        if args.command == "compare" and part not in digests:
            parser.error(f"{args.file} has no record of {part}")
        try:
            found = compute(part, args.book)
        except Exception as error:  # the other parts are computed all the same
            print(f"{part}: {type(error).__name__}: {error}", flush=True)
            wrong += 1
            continue
        old, new = digests.get(part, {}), {name: _digest(value) for name, value in found.items()}
        seconds = f"{time.perf_counter() - start:.1f} s"
        if args.command == "record":
            print(f"{part}: {len(new)} results, {seconds}", flush=True)
            digests[part] = new
            kept = {n: v for n, v in kept.items() if not n.startswith(f"{part}: ")}
            kept |= {f"{part}: {n}": _kept(v) for n, v in found.items() if type(v) is not bytes}
            continue
        others = [name for name in sorted(old | new) if old.get(name) != new.get(name)]
        print(f"{part}: {len(others)} of {len(old)} results differ, {seconds}", flush=True)
        for name in others:
            told = difference(kept.get(f"{part}: {name}"), found[name]) if name in found else "gone"
            print(f"  {name}: {told if name in old else 'new'}")
        wrong += len(others)
    if args.command == "record":
        args.file.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(args.file.with_suffix(".npz"), **kept)
        args.file.write_text(json.dumps(digests, indent=1) + "\n", encoding="utf-8")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
