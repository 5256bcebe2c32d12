"""Stage the executed chapters beside the book's pages, build the HTML book, and check the way.

A launch link works only where a page's source is the notebook at the repository's own path, so
the staged book holds ``notebooks/NN_name.ipynb`` exactly as the repository does. What a page
without a kernel cannot show is taken out on the way; the executed notebooks stay as they are.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import yaml

from hadr.experiments.steps import seconds_text
from hadr.press import chapters, paper_report, report
from hadr.press.chapters import ChapterRun, read_notebook
from hadr.press.course.chapter import read_chapters
from hadr.press.course.teaching import chapters_text, plans_text
from hadr.press.found import found_rules, found_table
from hadr.press.notebook_twins import repository
from hadr.records.output_folder import check_removable, make_output_folder
from hadr.records.provenance import machine_text
from hadr.records.result_file import read_sealed
from hadr.records.writing import PART, whole_folder, write_whole

RUNTIME_TOKEN = "*stands here in the built book*"
REPORTS: dict[str, Callable[[Path], str]] = {
    "{{REPORT}}": lambda results: "\n".join(
        paper_report.report(results / size, results / "paper_tables.json", size)
        for size in ("imagenet", "mini")
    ),
    "{{FOUND}}": found_table,
    "{{FOUND_RULES}}": found_rules,
    "{{CONDITIONS}}": lambda results: report.conditions_table(results / "mini"),
    "{{CONDITIONS_IMAGENET}}": lambda results: report.conditions_table(results / "imagenet"),
    "{{CONDITIONS_UNKNOWN}}": lambda results: report.conditions_table(
        results / "imagenet", "unknown_predicted"
    ),
    "{{CONDITIONS_ABLATION}}": lambda results: report.conditions_table(
        results / "imagenet", "ablation_predicted"
    ),
    "{{CONDITIONS_LONGER}}": lambda results: report.conditions_table(results / "longer"),
    "{{REAL}}": lambda results: report.real_table(results / "real" / "cleargrasp_d435.json"),
    "{{SWITCHES}}": lambda results: report.switches_table(results / "training" / "switches.json"),
    "{{TUNING}}": lambda results: captioned(
        report.tuning_table(results / "mini" / "tuning.json"),
        "RMSE on validation frames (cm) after each trial, the best of each network in bold.",
    ),
    "{{SPEED}}": lambda results: report.speed_table(results / "speed" / "side_by_side.json"),
    "{{GENERATION}}": lambda results: report.generation_text(results / "generation"),
    "{{LEDGER_EFFECTS}}": lambda results: report.ledger_effects(results / "mini"),
    "{{LEDGER_TABLE}}": lambda results: report.ledger_table(results / "mini" / "ledger.json"),
    "{{TEACHING_PLANS}}": lambda results: plans_text(read_chapters(results.parent)),
    "{{TEACHING_CHAPTERS}}": lambda results: chapters_text(
        read_chapters(results.parent), lambda chapter: f"notebooks/{chapter.name}.ipynb"
    ),
}
"""Words on pages in whose place stands what is made from the result files or the chapters."""
COSTS = "images/frame_costs.svg"
"""A picture that a page shows, drawn when it is staged."""
TABLE_BEGIN = "<!-- run times: begin (written by `make readme-times`) -->"
TABLE_END = "<!-- run times: end -->"
CONTROL = "A control, for a running kernel: the rocket button above opens the chapter with one"
CHECK = "Check of your answer, for a running kernel (it holds the solution)"
FOLDS = {
    "<video": "these films",
    "<iframe": "this moving figure",
    "image/png": "this figure",
    r"\|:?-{2,}": "this table",
    "text/markdown": "this text",
    "text/html": "this table",
    "'stream'": "these numbers",
}
"""What the code of a folded cell makes, by a pattern in its outputs, the first that is there."""
_WIDGET_VIEW = "application/vnd.jupyter.widget-view+json"


def _entry(notebook: Path) -> str:
    """A chapter's number, and its first heading as a link."""
    cells = [cell.source for cell in read_notebook(notebook).cells if cell.cell_type == "markdown"]
    found = re.search(r"^# +(.+)$", "\n".join(cells), flags=re.MULTILINE)
    title = found[1].strip() if found else notebook.stem
    return f"{int(notebook.name[:2])}. [{title}](notebooks/{notebook.name})"


def stage_notebook(notebook: Any, run_time: str) -> Any:
    """Make an executed notebook ready for a page without a kernel, in place.

    Papermill's injected parameters, text on stderr, and outputs and state of widgets are dropped.
    """
    cells = []
    for cell in notebook.cells:
        tags = cell.metadata.get("tags", [])
        if "injected-parameters" in tags:
            continue
        cells.append(cell)
        if cell.cell_type != "code":
            cell.source = cell.source.replace(RUNTIME_TOKEN, run_time)
            continue
        told = [] if "interactive" in tags else [
            output for output in cell.outputs
            if output.get("name") != "stderr" and _WIDGET_VIEW not in output.get("data", {})
        ]  # fmt: skip
        cell.outputs = _captioned_films(told)
        _caption_table(cell)
        _name_fold(cell)
        cells += _beside_a_figure(cell)
    notebook.cells = cells
    notebook.metadata.pop("widgets", None)
    notebook.metadata.pop("papermill", None)
    return notebook


def _captioned_films(outputs: Sequence[Any]) -> list[Any]:
    """Each film as a figure: the words displayed before it are its caption and its spoken name."""
    shown: list[Any] = []
    for output in outputs:
        html = output.get("data", {}).get("text/html", "")
        words = shown[-1].get("data", {}).get("text/markdown", "") if shown else ""
        if words and "<video" in html:
            shown.pop()
            name = escape(re.sub(r"[*_`]", "", words))
            caption = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", escape(words))
            html = html.replace("<video", f'<video aria-label="Film: {name}"', 1)
            caption = f"<figcaption>{caption}</figcaption>"
            output["data"]["text/html"] = f'<figure class="film">{html}{caption}</figure>'
        shown.append(output)
    return shown


def captioned(table: str, caption: str, name: str = "") -> str:
    """A Markdown table with a caption, to be numbered; a note below the table joins the caption."""
    rows, _, note = table.partition("\n\n")
    words = " ".join(f"{caption} {note}".split())
    return "\n".join(
        [f":::{{table}} {words}", *([f":name: {name}"] if name else []), "", rows, ":::"]
    )


def _caption_table(cell: Any) -> None:
    """Give the table that a cell shows the caption in its metadata, beside a figure's."""
    for data in (output.get("data", {}) for output in cell.outputs):
        if (text := data.get("text/markdown", "")).startswith("|"):
            if "table" not in cell.metadata.get("mystnb", {}):
                raise ValueError(f"this cell's table has no caption: {cell.source}")
            data["text/markdown"] = captioned(text, **cell.metadata["mystnb"]["table"])


def _beside_a_figure(cell: Any) -> list[Any]:
    """A cell of its own for what a figure's cell shows besides, which else were a figure, too."""
    import nbformat

    kept = [output for output in cell.outputs if "image/png" in output.get("data", ["image/png"])]
    others = [output for output in cell.outputs if output not in kept]
    if "figure" not in cell.metadata.get("mystnb", {}) or not others:
        return []
    cell.outputs = kept
    source = "# nothing is shown of a cell without a source"
    more = {"id": f"{cell.id}-beside", "metadata": {"tags": ["remove-input"]}, "outputs": others}
    return [nbformat.v4.new_code_cell(source, **more)]


def _name_fold(cell: Any) -> None:
    """Fold what a page cannot run, and let each fold say what is in it."""
    tags, metadata = cell.metadata.get("tags", []), cell.metadata
    made = str([(output.output_type, output.get("data")) for output in cell.outputs])
    if re.search(r"\bcheck\(\s*answer\b", cell.source):
        words, tags = CHECK, [*tags, "hide-cell"]
    elif "interactive" in tags:
        words, tags = CONTROL, [*tags, "hide-input"]
    elif "parameters" in tags:
        words = "Code: what can be set"
    else:
        fits = (words for kind, words in FOLDS.items() if re.search(kind, made))
        words = f"Code: {next(fits, 'what comes next needs')}"
    if any(tag.startswith("hide-") for tag in tags):
        shown = {"code_prompt_show": words, "code_prompt_hide": words} | metadata.get("mystnb", {})
        metadata.update(tags=tags, mystnb=shown)


def stage_book(book: Path, runs: Sequence[ChapterRun], target: Path) -> Path:
    """Copy the book's pages and the executed chapters into a build folder."""
    with whole_folder(target, "hadr book", partial(check_removable, target)) as staged:
        make_output_folder(staged)
        _stage(book, runs, staged)
    return target


def _stage(book: Path, runs: Sequence[ChapterRun], target: Path) -> None:
    import nbformat

    left_out = shutil.ignore_patterns("_build", ".*")
    shutil.copytree(book, target, ignore=left_out, dirs_exist_ok=True)
    for film in (book.parent / "data_samples" / "handover").glob("success.*"):
        shutil.copy(film, target / "_static")  # the first page shows it
    (target / "notebooks").mkdir()
    for run in runs:
        measured = f"{seconds_text(run.duration_s)} ({machine_text()})"
        staged = stage_notebook(read_notebook(run.notebook), measured)
        nbformat.write(staged, target / "notebooks" / run.notebook.name)
    titles = {run.name: _entry(run.notebook) for run in runs}
    words = {
        "{{RUNTIME_TABLE}}": chapters.run_time_table(runs, titles),
        RUNTIME_TOKEN: seconds_text(sum(run.duration_s for run in runs)),
        "{{REPOSITORY}}": repository(book)["url"],
        "{{MACHINE}}": machine_text(),
    }
    pages = {page: page.read_text(encoding="utf-8") for page in target.glob("*.md")}
    results = book.parent / "results"
    for token, make in REPORTS.items():
        if any(token in text for text in pages.values()):
            words[token] = make(results)
    if any(COSTS in text for text in pages.values()):
        _draw_costs(results / "generation" / "benchmark.json", target / COSTS)
    for page, text in pages.items():
        for token, word in words.items():
            text = text.replace(token, word)
        if left := re.search(r"\{\{[A-Z_]+\}\}", text):
            raise ValueError(f"{page.name} has {left.group()}, which nothing fills")
        page.write_text(text, encoding="utf-8")
    _drop_absent_chapters(target)


def _draw_costs(measured: Path, picture: Path) -> None:
    """Draw what a generated frame costs, as a vector picture."""
    import matplotlib.pyplot as plt

    from hadr.figures.panels import use_style
    from hadr.figures.tables.benchmarks import draw_frame_costs

    with plt.rc_context():
        use_style()
        figure, ax = plt.subplots(figsize=(8.2, 3.3))
        draw_frame_costs(ax, read_sealed(measured)["seconds_a_frame"])
        figure.savefig(picture, facecolor="white", metadata={"Date": None})
        plt.close(figure)


def _drop_absent_chapters(target: Path) -> None:
    """Take chapters that were not executed (``--only``) out of the staged table of contents."""
    path = target / "_toc.yml"
    contents = yaml.safe_load(path.read_text(encoding="utf-8"))
    for part in contents.get("parts", []):
        part["chapters"] = [
            entry
            for entry in part["chapters"]
            if any((target / f"{entry['file']}{end}").exists() for end in ("", ".md", ".ipynb"))
        ]
    contents["parts"] = [part for part in contents.get("parts", []) if part["chapters"]]
    path.write_text(yaml.safe_dump(contents, sort_keys=False), encoding="utf-8")


def build_html(staged: Path, output: Path, *, strict: bool) -> Path:
    """Build the HTML book with Jupyter Book; where strict, a warning is an error.

    The book that is there from another time stays until the new one is whole.
    """
    if importlib.util.find_spec("jupyter_book") is None:
        raise RuntimeError("Jupyter Book is not installed here: pip install -e '.[book]'")
    program = "from jupyter_book.cli.main import main; main()"
    command = [sys.executable, "-P", "-c", program, "build", str(staged)]
    draft = output / f"{PART}book"  # a killed run's is swept with the build folder
    command += ["--path-output", str(draft), "--all"]
    command += ["-W", "--keep-going", "-n"] if strict else []
    environment = os.environ | {"PYDEVD_DISABLE_FILE_VALIDATION": "1", "NO_COLOR": "1"}
    output.mkdir(parents=True, exist_ok=True)
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        log = chapters.without_ansi(done.stdout + done.stderr)
        (output / "build.log").write_text(log, encoding="utf-8")
        if done.returncode != 0 or not (draft / "_build" / "html" / "index.html").exists():
            wanted = re.compile(r"WARNING:|ERROR:|CRITICAL:|Exception|Error:")
            lines = [line for line in log.splitlines() if wanted.search(line)]
            told = "\n".join(lines[-40:] or log.splitlines()[-40:])
            raise RuntimeError(
                f"the book did not build:\n{told}\nall of it: {output / 'build.log'}"
            )
        shutil.rmtree(output / "_build", ignore_errors=True)
        (draft / "_build").rename(output / "_build")
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return output / "_build" / "html" / "index.html"


def update_readme(readme: Path, table: str) -> None:
    """Replace the table of run times between its two markers."""
    before, begin, rest = readme.read_text(encoding="utf-8").partition(TABLE_BEGIN)
    _, end, after = rest.partition(TABLE_END)
    if not end:
        raise ValueError(f"{readme} has no lines {TABLE_BEGIN!r} and {TABLE_END!r}")
    write_whole(readme, f"{before}{begin}\n{table}\n{end}{after}")


def readme_table(build: Path, root: Path) -> str:
    """The chapters with the run times of the last ``make book``: all, of one machine, at tiny."""
    path = build / "results.json"
    try:
        measured = read_sealed(path)
    except (FileNotFoundError, ValueError) as error:
        raise type(error)(f"{error}: run `make book` first") from error
    if (preset := measured["parameters"]["preset"]) != "tiny":
        raise ValueError(f"{path} has times of preset {preset}, README those of tiny")
    timed = measured["chapters"]
    notebooks = chapters.chapter_paths(root / "notebooks")
    missing = [notebook.stem for notebook in notebooks if notebook.stem not in timed]
    if missing:
        raise ValueError(f"{path} has no time of {', '.join(missing)}: run `make book` first")
    machines = sorted({timed[notebook.stem]["machine"] for notebook in notebooks})
    if len(machines) > 1:
        raise ValueError(f"{path} has times of {' and of '.join(machines)}: run `make book` again")
    runs = [ChapterRun(notebook, timed[notebook.stem]["duration_s"]) for notebook in notebooks]
    titles = {notebook.stem: _entry(notebook) for notebook in notebooks}
    return f"{chapters.run_time_table(runs, titles)}\n\nMeasured on {machines[0]}."
