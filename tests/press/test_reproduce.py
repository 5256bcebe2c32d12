"""Running notebooks with papermill: parameters in, results and times out, failures told well."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import nbformat
import numpy as np
import pytest

from hadr.experiments.reproduction_plan import seconds_text as estimate
from hadr.press import reproduce
from hadr.press.reproduce import ChapterError, ChapterRun
from hadr.records.provenance import plain, write_json, write_results
from hadr.records.result_file import read_result_file

RESULTS = """from hadr.records.provenance import write_results
kept = write_results(out_dir, "00_good", {"seed": seed, "preset": preset})"""


def notebook_of(*sources, parameters="preset: str = 'x'\nseed: int = 9\nout_dir: str = ''"):
    first = nbformat.v4.new_code_cell(parameters, metadata={"tags": ["parameters"]})
    cells = [nbformat.v4.new_markdown_cell("# Title"), first]
    cells += [nbformat.v4.new_code_cell(source) for source in sources]
    return nbformat.v4.new_notebook(cells=cells)


@pytest.fixture
def folder(tmp_path):
    nbformat.write(notebook_of("1 + 1", RESULTS), tmp_path / "00_good.ipynb")
    bad = notebook_of("value = 'before'\nprint(value)", "ratio = 1 / 0", "never = 1")
    nbformat.write(bad, tmp_path / "01_bad.ipynb")
    return tmp_path


def test_parameters_reach_the_notebook_and_results_come_back(folder, tmp_path, monkeypatch):
    home = tmp_path / "home"
    home.mkdir()
    kernel = home / ".local" / "share" / "jupyter" / "kernels" / "python3"
    kernel.mkdir(parents=True)  # a user's own python3 kernel, which must not be taken
    (kernel / "kernel.json").write_text('{"argv": ["/does/not/exist"], "display_name": "x"}')
    monkeypatch.setenv("HOME", str(home))
    told = []
    paths = reproduce.chapter_paths(folder, ["0"])
    runs = reproduce.run_notebooks(paths, tmp_path / "out", preset="mini", seed=4, say=told.append)
    assert [run.name for run in runs] == ["00_good"]
    assert 0 < runs[0].duration_s < 120
    assert len(told) == 1
    assert "00_good" in told[0]
    results = json.loads(runs[0].results.read_text())
    assert results["results"] == {"seed": 4, "preset": "mini"}
    assert results["provenance"]["versions"]["numpy"] == np.__version__
    assert nbformat.read(folder / "00_good.ipynb", 4).cells[2].outputs == []
    assert nbformat.read(runs[0].notebook, 4).cells[3].outputs[0]["data"]["text/plain"] == "2"
    collected = reproduce.keep_results(tmp_path / "out", paths, "mini", 4, told.append)
    assert collected["parameters"] == {"preset": "mini", "seed": 4}
    assert "CPU cores" in collected["machine"]
    assert collected["chapters"]["00_good"]["results"] == {"seed": 4, "preset": "mini"}
    assert collected["chapters"]["00_good"]["duration_s"] == round(runs[0].duration_s, 3)


def test_a_failure_names_notebook_cell_and_traceback_and_keeps_the_rest(folder, tmp_path):
    paths = reproduce.chapter_paths(folder, ["01"])
    with pytest.raises(ChapterError) as caught:
        reproduce.run_notebooks(paths, tmp_path / "out", say=lambda line: None)
    text = str(caught.value)
    assert "01_bad.ipynb failed in cell " in text
    assert "    ratio = 1 / 0" in text
    assert "ZeroDivisionError: division by zero" in text
    assert "\x1b" not in text
    kept = tmp_path / "out" / "executed" / "01_bad.ipynb"
    assert str(kept) in text
    assert "before" in nbformat.writes(nbformat.read(kept, 4))


def test_a_kernel_that_dies_is_told_with_its_cell(tmp_path):
    source = notebook_of("import os\nos._exit(1)", "never = 1")
    nbformat.write(source, tmp_path / "00_dies.ipynb")
    with pytest.raises(ChapterError, match=r"00_dies.ipynb failed in cell \d") as caught:
        reproduce.run_notebooks([tmp_path / "00_dies.ipynb"], tmp_path, say=lambda line: None)
    assert "os._exit(1)" in str(caught.value)
    assert "died" in str(caught.value).lower()


def test_what_a_widgets_function_prints_is_output_of_its_cell(tmp_path):
    """Only so is nothing sent on the socket on which the cell's reply is awaited."""
    widget = "import ipywidgets\nipywidgets.interactive(lambda x: print(f'drawn at {x}'), x=(3, 3))"
    nbformat.write(notebook_of(widget), tmp_path / "00_widget.ipynb")
    (run,) = reproduce.run_notebooks([tmp_path / "00_widget.ipynb"], tmp_path / "out")
    printed, widget = nbformat.read(run.notebook, 4).cells[-1].outputs
    assert "drawn at 3" in printed.text
    assert "application/vnd.jupyter.widget-view+json" in widget.data


def test_command_line_returns_2_and_prints_the_failure(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(reproduce, "checkout_root", lambda: tmp_path / "root")
    (tmp_path / "root").mkdir()
    (tmp_path / "root" / "notebooks").symlink_to(folder)
    out = tmp_path / "out"
    assert reproduce.main(["--only", "1", "--out", str(out)]) == 2
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert not (out / "results.json").exists()
    assert reproduce.main(["--only", "77", "--out", str(out)]) == 2
    assert "no chapter begins with it; the chapters are 00_good, 01_bad" in capsys.readouterr().err


def test_the_plan_is_printed_first_and_what_is_finished_is_not_repeated(
    folder, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(reproduce, "checkout_root", lambda: tmp_path / "root")
    (tmp_path / "root").mkdir()
    (tmp_path / "root" / "notebooks").symlink_to(folder)
    out = tmp_path / "out"
    words = ["--only", "0", "--out", str(out)]
    assert reproduce.main(words) == 0
    said = capsys.readouterr().out
    assert said.index("1 of 1 steps are left") < said.index("[ 1/1] 00_good")
    times = {row["step"]: row for row in read_result_file(out / "run_times.json").rows}
    before = nbformat.read(out / "executed" / "00_good.ipynb", 4).metadata.papermill.end_time
    assert reproduce.main(words) == 0
    said = capsys.readouterr().out
    assert "all of 1 steps are done" in said
    assert "(was there)" in said
    after = nbformat.read(out / "executed" / "00_good.ipynb", 4).metadata.papermill.end_time
    assert after == before
    again = {row["step"]: row for row in read_result_file(out / "run_times.json").rows}
    assert again == times
    collected = json.loads((out / "results.json").read_text())
    assert collected["chapters"]["00_good"]["results"] == {"seed": 0, "preset": "tiny"}
    nbformat.write(
        notebook_of("2", RESULTS.replace("00_good", "02_more")), folder / "02_more.ipynb"
    )
    assert reproduce.main(["--only", "2", "--out", str(out)]) == 0
    merged = json.loads((out / "results.json").read_text())["chapters"]
    assert merged["00_good"] == collected["chapters"]["00_good"]
    assert list(merged) == ["00_good", "02_more"]
    assert "has 2 of 3 chapters" in capsys.readouterr().out  # the third one fails
    assert reproduce.main([*words, "--seed", "1"]) == 0
    assert "1 of 1 steps are left" in capsys.readouterr().out


def test_a_chapter_that_failed_is_not_finished(folder, tmp_path):
    paths = reproduce.chapter_paths(folder, ["0"])
    said = []
    reproduce.run_notebooks(paths, tmp_path / "out", say=said.append, resume=True)
    nbformat.write(notebook_of("1 / 0"), paths[0])
    for _ in range(2):
        with pytest.raises(ChapterError):
            reproduce.run_notebooks(paths, tmp_path / "out", say=said.append, resume=True)
    assert len(said) == 1


def test_dry_run_executes_nothing(tmp_path, capsys):
    out = tmp_path / "out"
    assert reproduce.main(["--dry-run", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "preset tiny, seed 0" in said
    assert "known/hadr-plus/seed-0" in said
    assert "07_metrics" in said
    assert "handover/perfect" in said
    assert "steps are left: about" in said
    assert not out.exists()


@pytest.mark.parametrize(
    ("wishes", "said", "unsaid"),
    [
        (
            ["known/hadr"],
            ["known/hadr/seed-0", "everything goes to"],
            ["known/hadr-plus", "07_metrics", "handover/"],
        ),
        (["tables"], ["unknown/raw/seed-0", "known/hadr-long/seed-0"], ["07_metrics", "handover/"]),
        (["chapters"], ["07_metrics"], ["known/", "handover/"]),
        (["handover"], ["handover/raw", "1 of 1 attempts"], ["known/", "07_metrics"]),
        (["3", "raw"], ["03_ray", "known/raw", "unknown/raw"], ["07_metrics", "nearest"]),
    ],
)
def test_only_chooses_chapters_and_runs(tmp_path, capsys, wishes, said, unsaid):
    assert reproduce.main(["--dry-run", "--only", *wishes, "--out", str(tmp_path / "out")]) == 0
    found = capsys.readouterr().out
    assert [text for text in said if text not in found] == []
    assert [text for text in unsaid if text in found] == []


def test_tables_of_a_large_preset_need_data(tmp_path, capsys):
    words = ["--preset", "mini", "--only", "tables", "--out", str(tmp_path / "out")]
    assert reproduce.main(words) == 2
    assert "hadr generate --preset mini --out DIR" in capsys.readouterr().err
    assert reproduce.main([*words, "--jobs", "0", "--data", str(tmp_path)]) == 2
    assert reproduce.main([*words, "--data", str(tmp_path / "nowhere")]) == 2
    assert "there is no data folder" in capsys.readouterr().err


@pytest.mark.parametrize("data", [[], ["--data", "nowhere"]])
def test_a_large_preset_is_planned_without_its_data(tmp_path, capsys, monkeypatch, data):
    monkeypatch.chdir(tmp_path)
    words = ["--dry-run", "--preset", "mini", "--out", "out", *data]
    assert reproduce.main(words) == 0
    said = capsys.readouterr().out
    steps = {line.split("  ")[1]: line for line in said.splitlines() if line.startswith("  ")}
    assert "4,000 frames" in steps["hadr generate --preset mini"]
    made = json.loads((reproduce.checkout_root() / "results/generation/mini_run.json").read_text())
    assert f" {estimate(made['seconds'])} " in steps["hadr generate --preset mini"]
    assert steps["hadr generate --preset mini"].endswith(data[-1] if data else "DIR, a data folder")
    assert "12 epochs" in steps["known/hadr/seed-0"]
    assert "?" not in steps["known/hadr/seed-0"]
    assert "handover/hadr-plus" in steps
    assert "the data are not there: all of this is planned for the 4,000 frames" in said
    assert "hadr generate --preset mini --out DIR" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("wish", "names"),
    [
        ([], ["00_a", "03_b", "10_c"]),
        (["3"], ["03_b"]),
        (["03", "10"], ["03_b", "10_c"]),
        (["10_c", "0"], ["00_a", "10_c"]),
    ],
)
def test_choosing_chapters(tmp_path, wish, names):
    for name in ("00_a", "03_b", "10_c"):
        (tmp_path / f"{name}.ipynb").write_text("{}")
    (tmp_path / "scratch.ipynb").write_text("{}")
    assert [path.stem for path in reproduce.chapter_paths(tmp_path, wish)] == names


def test_choosing_from_nothing(tmp_path):
    with pytest.raises(ValueError, match=r"no notebook named NN_name.ipynb in "):
        reproduce.chapter_paths(tmp_path)


def test_an_empty_wish_is_refused(tmp_path):
    (tmp_path / "01_ray.ipynb").write_text("{}")
    with pytest.raises(ValueError, match="empty word"):
        reproduce.chapter_paths(tmp_path, [""])


def test_write_results_without_a_folder_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    content = write_results("", "03_x", {"rmse_m": np.float32(0.5)}, preset="tiny")
    assert content["chapter"] == "03_x"
    assert content["results"] == {"rmse_m": 0.5}
    assert content["parameters"] == {"preset": "tiny"}
    assert list(tmp_path.iterdir()) == []


@dataclass(frozen=True)
class Row:
    name: str
    value: np.ndarray


def test_plain_takes_what_chapters_measure():
    torch = pytest.importorskip("torch")
    told = {
        "array": np.arange(3, dtype=np.int64),
        "scalar": np.float64(0.25),
        "nan": [math.nan, np.inf],
        "row": Row("a", np.eye(2)),
        "path": Path("a/b"),
        3: (True, None),
        "tensor": torch.tensor([1.5]),
        "flag": np.bool_(True),
    }
    assert plain(told) == {
        "array": [0, 1, 2],
        "scalar": 0.25,
        "nan": [None, None],
        "row": {"name": "a", "value": [[1.0, 0.0], [0.0, 1.0]]},
        "path": "a/b",
        "3": [True, None],
        "tensor": [1.5],
        "flag": True,
    }


def test_plain_names_what_it_cannot_hold():
    with pytest.raises(TypeError, match=r"results.a\[1\] is a set, which JSON cannot hold"):
        plain({"a": [1, {2}]})


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "results.json"
    write_json(path, {"a": 1})
    with pytest.raises(TypeError, match="is a set"):
        write_json(path, {"a": {1}})
    assert json.loads(path.read_text()) == {"a": 1}
    assert [item.name for item in tmp_path.iterdir()] == ["results.json"]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.84, "0.8 s"), (9.96, "10 s"), (14.4, "14 s"), (59.7, "1 min 00 s"), (125, "2 min 05 s")],
)
def test_durations_for_readers(seconds, text):
    assert reproduce.seconds_text(seconds) == text


def test_table_of_run_times():
    runs = [ChapterRun("00_a", 1.0, Path(), None), ChapterRun("01_b", 70.0, Path(), None)]
    table = reproduce.run_time_table(runs, {"00_a": "[A](a)"}).splitlines()
    assert table[2:] == ["| [A](a) | 1.0 s |", "| 01_b | 1 min 10 s |", "| together | 1 min 11 s |"]
