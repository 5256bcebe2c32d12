"""The teacher's page: plans for 2, 6 and 12 hours, goals, marks and common mistakes.

Goals and mistakes are read from the chapters, so the page says what the notebooks say: a common
mistake is what a check cell answers to a plausible wrong result.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pandas as pd

from hadr.figures.tables.results import markdown
from hadr.press.course.chapter import Chapter, hints
from hadr.press.course.graded import STUB


@dataclass(frozen=True)
class Block:
    """A stretch of a lesson: numbers of the chapters that it uses, labels of its exercises."""

    minutes: int
    chapters: tuple[int, ...]
    what: str
    exercises: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plan:
    """A course of so many hours without breaks: lessons, each a row of blocks."""

    hours: int
    aim: str
    sessions: tuple[tuple[Block, ...], ...]


PLANS = (
    Plan(
        2,
        "why a depth camera fails on glass, and why the hand that holds it is the clue",
        (
            (
                Block(15, (0,), "the problem, and one frame restored in five lines"),
                Block(25, (1,), "three ways in which depth goes wrong", ("ex-01-1",)),
                Block(35, (3,), "the hole as a multiple-choice question", ("ex-03-1",)),
                Block(25, (5,), "the wrist's frame: what stays as the camera moves", ("ex-05-1",)),
                Block(20, (8,), "what a good number means, and what it hides", ("ex-08-1",)),
            ),
        ),
    ),
    Plan(
        6,
        "the whole method, from a corrupted frame to a number that can be trusted",
        (
            (
                Block(20, (0,), "the problem, and one frame restored", ("ex-00-1",)),
                Block(50, (1,), "real, simulated and analytic errors", ("ex-01-1", "ex-01-2")),
                Block(50, (2,), "how frames are made; a split that leaks", ("ex-02-1", "ex-02-3")),
            ),
            (
                Block(55, (3,), "rays, voxels and pairs", ("ex-03-1", "ex-03-2")),
                Block(30, (4,), "what the network knows about a pair", ("ex-04-1",)),
                Block(35, (5,), "what the hand adds", ("ex-05-1", "ex-05-2")),
            ),
            (
                Block(45, (6,), "losses, and a network that learns", ("ex-06-1", "ex-06-2")),
                Block(45, (8, 9), "metrics, and the table beside the paper's", ("ex-08-2",)),
                Block(30, (10, 12), "what the robot does with it, as a demonstration"),
            ),
        ),
    ),
    Plan(
        12,
        "the method and the handover, with an experiment of one's own",
        (
            (
                Block(40, (0,), "the problem; frames, units, tools", ("ex-00-1", "ex-00-2")),
                Block(80, (1,), "how depth goes wrong", ("ex-01-1", "ex-01-2", "ex-01-3")),
            ),
            (
                Block(80, (2,), "the data and their splits", ("ex-02-1", "ex-02-2", "ex-02-3")),
                Block(40, (3,), "the grid, and the walk of a ray through it", ("ex-03-1",)),
            ),
            (
                Block(55, (3,), "offsets, depth, and what cannot be restored",
                      ("ex-03-2", "ex-03-3")),
                Block(65, (4,), "the 511 numbers of a pair", ("ex-04-1", "ex-04-2", "ex-04-3")),
            ),
            (
                Block(50, (5,), "hand features", ("ex-05-1", "ex-05-2", "ex-05-3")),
                Block(70, (6, 7), "training, and what of it to rely on",
                      ("ex-06-1", "ex-06-2", "ex-07-1")),
            ),
            (
                Block(75, (8, 9), "metrics and comparison", ("ex-08-1", "ex-08-2", "ex-08-3")),
                Block(45, (10,), "which grasp one would like to be offered",
                      ("ex-10-1", "ex-10-2", "ex-10-3")),
            ),
            (
                Block(35, (11,), "following the hand", ("ex-11-1", "ex-11-2")),
                Block(50, (12,), "the handover", ("ex-12-1", "ex-12-3")),
                Block(35, (13,), "Attempts, and how sure they make us", ("ex-13-1", "ex-13-2")),
            ),
        ),
    ),
)  # fmt: skip


def plans_text(chapters: Sequence[Chapter]) -> str:
    """The plans as Markdown tables; exercises are named by number and title."""
    exercises = [exercise for chapter in chapters for exercise in chapter.exercises]
    titles = {each.label: f"{each.number} {each.title}" for each in exercises}
    parts = []
    for plan in PLANS:
        rows = []
        for number, session in enumerate(plan.sessions, start=1):
            for block in session:
                done = "; ".join(titles.get(label, label) for label in block.exercises)
                words = f"{block.what} ({', '.join(map(str, block.chapters))})"
                rows.append([str(number), str(block.minutes), words, done or "none"])
        head = ["session", "minutes", "what (chapter)", "exercises in class"]
        table = markdown(pd.DataFrame(rows, columns=head), "lrl")
        parts.append(f"### {plan.hours} hours\n\nAim: {plan.aim}.\n\n{table}")
    return "\n\n".join(parts)


def chapters_text(chapters: Sequence[Chapter], link: Callable[[Chapter], str]) -> str:
    """Goals, exercises, marks and common mistakes of each chapter, as Markdown with links."""
    parts = []
    for chapter in chapters:
        total = sum(exercise.marks for exercise in chapter.exercises)
        lines = [
            f"### {chapter.number}. [{chapter.title}]({link(chapter)})",
            "After it, a student can",
            "\n".join(f"- {goal};" for goal in chapter.goals)[:-1] + ".",
            f"Exercises, {total} marks, and the mistakes that their checks know:",
        ]
        listed = []
        for exercise in chapter.exercises:
            head = f"- **{exercise.number} {exercise.title}** ({exercise.marks_text})"
            listed.append("\n".join([head, *(f"  - {hint}" for hint in hints(exercise))]))
        parts.append("\n\n".join([*lines, "\n".join(listed)]))
    return "\n\n".join(parts)


FOLDER = """\
# Teaching with this book

Written by `hadr course`; `course.json` says from which chapters, and holds each file's checksum.

- `student/`: the notebooks for students. Solutions are taken out, check cells are kept. A student
  writes in place of the three dots and runs the cell below, which says right, wrong or open.
- `solutions/`: the same notebooks with the solutions filled in.
- `tests/NN_name/`: one test file per exercise for otter-grader.
- `slides/`, unless `--no-slides` left them out: one reveal.js deck per chapter. Open
  `slides/index.html`; no network is needed. `S` opens the speaker's view with notes, `?print-pdf`
  behind the address makes a page to print.
- `nbgrader_config.py`: the settings that nbgrader needs for these notebooks.

## Marks by machine

**nbgrader.** The notebooks carry nbgrader's cell metadata (schema 3). In the folder of an
nbgrader course, copy `nbgrader_config.py` there and the notebooks of `solutions/` to
`source/glass/`; `nbgrader generate_assignment glass` then makes the release from them, and
`nbgrader autograde glass` gives the marks: a check that does not say "right" raises in a hidden
test. Hand out the notebooks of that release, which nbgrader knows again, not those of `student/`.

**otter-grader.** For one chapter,
`otter generate -t tests/03_ray_voxels -o autograder.zip` makes the autograder, and
`otter check notebook.ipynb -t tests/03_ray_voxels` shows the marks at once. Each test runs the
exercise's own check on what the notebook leaves behind; the library must be installed there.

The check cells are for learning. JupyterLab shows them closed in `student/`, but whoever opens one
finds the expected answer. For an exam, ask for the way to the answer, or change the numbers in
`solutions/` before the release is made.
"""

NBGRADER_CONFIG = f"""\
c = get_config()  # noqa: F821

# What stands in place of a solution. The line "answer_... = ..." above it stays.
c.ClearSolutions.code_stub = {{"python": "{STUB}"}}
# Seconds for the longest cell of the longest chapter, with room for slow machines.
c.ExecutePreprocessor.timeout = 900
"""


def instructor_text(chapters: Sequence[Chapter], every: Sequence[Chapter]) -> str:
    """The page that lies beside the notebooks of some chapters; the plans are of every chapter."""
    told = chapters_text(chapters, lambda chapter: f"student/{chapter.name}.ipynb")
    some = "" if len(chapters) == len(every) else "They are of all chapters of the book.\n\n"
    return f"{FOLDER}\n## Plans\n\n{some}{plans_text(every)}\n\n## The chapters\n\n{told}\n"
