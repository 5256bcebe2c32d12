"""Every file in results/ has a command: `hadr reproduce`, or the one that the book's page names."""

import re
import shlex
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from hadr.cli import parse_options
from hadr.experiments.tables import FILES
from hadr.figures.tables.benchmarks import draw_frame_costs
from hadr.records.result_file import read_sealed

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "book" / "results.md").read_text(encoding="utf-8")
ROWS = [
    line.strip("| ").split(" | ") for line in PAGE.splitlines() if re.match(r"\| `[\w/-]+\.", line)
]
APART = [
    (re.findall(r"`([\w/-]+\.\w+)`", files), re.findall(r"`([a-z]+ [^`]+)`", how))
    for files, how in ROWS
]
# the two others are younger than the trainings of these files
MADE = [name for name in FILES if name not in ("ablation_predicted", "unknown_predicted")]
BY_REPRODUCE = {
    *(f"mini/{name}.json" for name in (*MADE, "handover", "run_times")), "tiny/run_times.json",
    *(f"imagenet/{name}.json" for name in (*MADE, "run_times")),
    *(f"longer/{name}.json" for name in ("known", "unknown", "segmentation", "keypoints")),
}  # fmt: skip


def test_every_result_file_is_made_by_reproduce_or_stands_in_the_table() -> None:
    files = [file for files, _ in APART for file in files]
    folder = ROOT / "results"
    paths = [path for path in folder.rglob("*") if path.is_file() and "LICENSE" not in path.name]
    assert sorted([*files, *BY_REPRODUCE]) == sorted(
        p.relative_to(folder).as_posix() for p in paths
    )


@pytest.mark.parametrize(
    ("files", "commands"), APART, ids=lambda listed: listed[0] if listed else ""
)
def test_commands_exist_take_these_options_and_write_the_files(
    files: list[str], commands: list[str]
) -> None:
    script, last = "", ""
    for command in commands:
        program, *words = shlex.split(command)
        last = command
        if program == "hadr":
            parse_options(words[0], words[1:])
            continue
        path = ROOT / words[0]
        script = path.read_text(encoding="utf-8")
        for shared in ("finished_runs", "measuring"):
            if f"from {shared} import" in script:
                script += path.with_name(f"{shared}.py").read_text(encoding="utf-8")
        options = [word for word in words[1:] if word.startswith("--")]
        assert [option for option in options if f'"{option}"' not in script] == []
    for file in map(Path, files if commands else ()):
        named = file.name in script or f'"{file.stem}"' in script or file.stem in last
        told = f"--json results/{file.with_suffix('.json')}" in last
        assert told or ("--json" not in last and named)


def test_the_cost_of_a_frame_has_a_bar_for_each_engine_and_size_as_long_as_its_time() -> None:
    measured = read_sealed(ROOT / "results" / "generation" / "benchmark.json")["seconds_a_frame"]
    figure, ax = plt.subplots()
    draw_frame_costs(ax, measured)
    names = [label.get_text() for label in ax.get_yticklabels()]
    for place, row in enumerate(measured):
        bars = [bar for bar in ax.patches if round(bar.get_y() + bar.get_height() / 2) == place]
        whole = max(bar.get_x() + bar.get_width() for bar in bars)
        assert whole == pytest.approx(row["cpu_seconds_a_frame"], abs=0.02)
        assert names[place].startswith(f"{row['engine']}, {row['width']}x{row['height']} (")
    plt.close(figure)
