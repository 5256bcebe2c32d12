"""Figures outside of `hadr reproduce`: each file of `results/` that it does not write.

The book's page *The paper's tables, and ours* has them as a table: the file, what stands in it, and
the command that makes it.
"""

from __future__ import annotations

from dataclasses import dataclass

from hadr.experiments.tables import FILES
from hadr.records.markdown import markdown_table

BY_REPRODUCE = (
    *(f"mini/{name}.json" for name in FILES),
    "mini/handover.json",
    "tiny/run_times.json",
)
"""What `hadr reproduce` writes, below `results/`: its own OUT/tables, and OUT/run_times.json."""
_RUNS = "--runs OUT/runs --data DIR data_samples/frames"
_SHORTCUTS = (
    "the rows with fewer rays and with ONNX are of shortcuts that the library no longer has; "
    "the file names their commit"
)
_SILENT = (
    "HADR's file and the choice among signals are of a confidence that the library no longer has; "
    "the files name their commit"
)
_BUNDLE = "python benchmarks/bundle_checkpoints.py --made OUT --data"


@dataclass(frozen=True)
class Apart:
    """Files that another command makes.

    Attributes:
        files: Their paths below `results/`.
        what: What was measured.
        commands: What makes them, in order; OUT is the folder of `hadr reproduce`, DIR the data of
            preset mini, CAMERA the frames of the handover's camera, REAL ClearGrasp's real frames,
            ROWS a folder for finished rows. Empty where no command does.
        note: What else is to be known.
    """

    files: tuple[str, ...]
    what: str
    commands: tuple[str, ...]
    note: str = ""


def _script(name: str, file: str, options: str = "") -> tuple[str]:
    """A benchmark that writes one file."""
    words = ["python", f"benchmarks/{name}.py", options, "--json", f"results/{file}"]
    return (" ".join(word for word in words if word),)


def _one(file: str, what: str, name: str, options: str = "", note: str = "") -> Apart:
    return Apart((file,), what, _script(name, file, options), note)


APART = (
    _one("mini/errors.json", "errors taken apart: place, shape, objects, new poses",
         "where_it_fails", _RUNS),
    _one("mini/colors.json", "the same frames with another frame's colours", "colors_of_others",
         _RUNS),
    _one("mini/size_of_hole.json", "the hole made wider and narrower", "size_of_hole", _RUNS),
    _one("mini/memory.json", "what a memory of the training frames is worth", "memory", _RUNS),
    _one("mini/tuning.json", "the trials that each network had", "tune",
         "--data DIR data_samples/frames --out ROWS"),
    _one("mini/hadr-plus-ablation.json", "HADR-plus with one part taken out", "ablate_plus",
         "--data DIR data_samples/frames --out ROWS"),
    _one("mini/handover_depth.json", "how far off the glass is before the handover's camera",
         "handover_depth"),
    Apart(
        ("mini/handover_worse.json",),
        "the handover with a turned camera, and with a faster hand",
        (
            "hadr handover --arms perfect --out build/handover",
            "hadr handover --arms perfect --extrinsics-error 3 --out build/turned",
            "hadr handover --arms perfect --hand-speed 3 --out build/fast",
            "python benchmarks/handover_bundle.py --out build/handover "
            "--worse build/turned build/fast",
        ),
        "the file has three of the six holds, at an earlier commit, which it names; these commands "
        "make all six",
    ),
    Apart(
        ("confidence/hadr-mini.json", "confidence/hadr-mini-unknown.json",
         "confidence/hadr-plus-mini.json"),
        "what the bundled networks' confidence means",
        (f"{_BUNDLE} DIR data_samples/frames --only hadr-plus-mini",),
        _SILENT,
    ),
    Apart(
        ("confidence/hadr-handover.json", "confidence/hadr-plus-handover.json"),
        "the same of the handover's networks",
        (
            "python benchmarks/handover_frames.py --out CAMERA",
            f"{_BUNDLE} CAMERA --only hadr-plus-handover",
        ),
        "the trainings between the two stand at the top of `benchmarks/bundle_checkpoints.py`; "
        + _SILENT,
    ),
    Apart(
        ("real/cleargrasp_d435.json",),
        "two frames of a real camera, restored",
        ("python benchmarks/real_frames.py --real REAL",),
    ),
    Apart(
        ("sensor/comparison.json",),
        "the simulated camera beside the real one",
        ("python benchmarks/depth_camera.py --out results/sensor",),
    ),
    Apart(
        ("sensor/pictures.json", "sensor/pictures.npz"),
        "the depth that chapter 1 draws, real and simulated",
        ("python benchmarks/sensor_pictures.py --real REAL --out results/sensor",),
    ),
    _one("generation/benchmark.json", "what a frame costs", "generate"),
    _one("generation/mini_run.json", "how long the data of preset mini took", "mini_run", "DIR"),
    _one("generation/killed.json", "the generator killed ten times", "kill_generator",
         "--kills 10 --workers 2"),
    _one("training/killed.json", "a training killed ten times", "kill_training", "--kills 10"),
    _one("training/overfit.json", "four frames learned by heart", "overfit"),
    _one("training/paper_step.json", "one step of preset paper: time and memory", "paper_step"),
    _one("speed/side_by_side.json", "time and memory of all methods", "side_by_side"),
    _one("speed/restoration.json", "the parts of a restoration's time", "restoration",
         note=_SHORTCUTS),
    _one("speed/perception.json", "frames a second of the whole perception", "perception",
         note=_SHORTCUTS),
    _one("speed/pairing.json", "pairing rays with voxels", "pairing"),
    _one("speed/grasps.json", "drawing, choosing and following grasps", "grasp_speed"),
    Apart(
        ("paper_tables.json",),
        "the paper's own four tables",
        (),
        "typed from the paper; `tests/test_paper_tables.py` holds it against it",
    ),
)  # fmt: skip
"""All of them, in the order of the table."""


def figures_apart_table() -> str:
    """List the files that `hadr reproduce` does not write.

    Returns:
        Markdown, a line a command's files: file, what, command.
    """
    lines = []
    for one in APART:
        told = [f"`{command}`" for command in one.commands] + ([one.note] if one.note else [])
        files = "<br/>".join(f"`{file}`" for file in one.files)
        lines.append([files, one.what, "<br/>".join(told)])
    return markdown_table(["file in `results/`", "what", "command"], lines, "l")
