"""Notebooks of a course: the student's, the teacher's, and the tests that give the marks.

Both notebooks carry nbgrader's cell metadata, schema version 3. The teacher's is a *source* of
nbgrader: its solutions stand between ``### BEGIN SOLUTION`` and ``### END SOLUTION``, and what
makes a wrong answer cost its marks between ``### BEGIN HIDDEN TESTS`` and ``### END HIDDEN
TESTS``. The student's is what nbgrader releases from it. For otter-grader each exercise has a
test file in its exception-based format.
"""

import ast
import re
from collections.abc import Callable, Mapping
from typing import Any

from hadr.press.course.chapter import Chapter, Exercise, last_call
from hadr.press.notebook_twins import KERNELSPEC

NBGRADER_SCHEMA = 3
STUB = "# your result goes in place of the three dots"
"""Stands where a solution was; nbgrader is told to put the same words there."""
RUN_TIME_LINE = re.compile(r"^\*\*Measured run time:\*\*[^\n]*\n*", flags=re.MULTILINE)


def variable_of(label: str) -> str:
    """Name of the variable that holds an exercise's answer: ``ex-03-1`` has ``answer_03_1``."""
    return re.sub(r"\W", "_", re.sub(r"^ex-", "answer-", label))


def student_answer(exercise: Exercise) -> str:
    """The cell in which a student writes."""
    return f"{_waiting_cell(exercise)}\n{STUB}"


def _waiting_cell(exercise: Exercise) -> str:
    *before, last = exercise.answer.splitlines() or [""]
    if last != "answer = ...":
        raise ValueError(
            f"{exercise.label}: its answer cell must end with 'answer = ...', got {last!r}"
        )
    return "\n".join([*before, f"{variable_of(exercise.label)} = ..."])


def solution_answer(exercise: Exercise) -> str:
    """The same cell with the solution filled in, between nbgrader's marks."""
    variable = variable_of(exercise.label)
    *before, last = exercise.solution
    call = last_call(last, exercise.label)
    result = ast.get_source_segment(last, call.args[0])
    lines = last.splitlines()[: call.lineno - 1]
    code = "\n\n".join([*before, "\n".join([*lines, f"{variable} = {result}"])])
    return f"{_waiting_cell(exercise)}\n### BEGIN SOLUTION\n{code}\n### END SOLUTION"


def check_cell(exercise: Exercise, *, hidden_test: bool) -> str:
    """The check of an exercise, which shows its verdict."""
    lines = _verdict(exercise)
    if hidden_test:
        lines += ["### BEGIN HIDDEN TESTS", "assert verdict, verdict", "### END HIDDEN TESTS"]
    return "\n".join(["# Run this cell: it checks your answer.", *lines, "display(verdict)"])


def _verdict(exercise: Exercise) -> list[str]:
    """The check's lines; its `answer` is the exercise's own, open where its cell did not end."""
    call = last_call(exercise.check, exercise.label)
    own = f'answer = globals().get("{variable_of(exercise.label)}", ...)'
    lines = [own, *exercise.check.splitlines()]
    lines[call.lineno] = f"verdict = {lines[call.lineno]}"
    return lines


def otter_test(exercise: Exercise) -> str:
    """A test file of otter-grader, in its exception-based format: it runs the exercise's check."""
    body = "".join(f"    {line!r},\n" for line in _verdict(exercise))
    return (
        f'"""{exercise.title}"""\n\n'
        "from otter.test_files import test_case\n\n"
        "from hadr.press.exercises import check\n\n"
        "OK_FORMAT = False\n\n"
        f'name = "{exercise.label}"\n'
        f"points = {exercise.marks}\n\n"
        f"CHECK = [\n{body}]\n\n\n"
        f"@test_case(points={exercise.marks}, hidden=False)\n"
        "def test_answer(env):\n"
        "    scope = {**env, 'check': check}\n"
        '    exec("\\n".join(CHECK), scope)\n'
        '    assert scope["verdict"], str(scope["verdict"])\n'
    )


def course_notebook(
    chapter: Chapter, *, solved: bool, preset: str, seed: int, plain: Callable[[str], str]
) -> str:
    """Write a chapter's notebook for a course."""
    import nbformat

    cells: list[Any] = []

    def add(kind: str, source: str, metadata: Mapping[str, Any]) -> None:
        make = nbformat.v4.new_code_cell if kind == "code" else nbformat.v4.new_markdown_cell
        cells.append(make(source, metadata=dict(metadata), id=f"cell-{len(cells):03d}"))

    exercises = {exercise.label: exercise for exercise in chapter.exercises}
    for piece in chapter.pieces:
        exercise = exercises.get(piece.label)
        if exercise is None:
            source = RUN_TIME_LINE.sub("", piece.source)
            if piece.is_code:
                add("code", _with_parameters(source, piece.metadata, preset, seed), piece.metadata)
            else:
                add("markdown", plain(source), {})
        elif piece.kind == "question":
            head = f"### Exercise {exercise.number}: {exercise.title} ({exercise.marks_text})"
            text = f"{head}\n\n{plain(exercise.question)}"
            add("markdown", text, _marked(f"{exercise.label}-question", "markdown"))
        elif piece.kind == "answer":
            text = solution_answer(exercise) if solved else student_answer(exercise)
            marked = _marked(f"{exercise.label}-answer", "code", solution=True)
            add("code", text, marked | (_figure_of(chapter, exercise) if solved else {}))
        elif piece.kind == "check":
            marked = _marked(f"{exercise.label}-check", "code", points=exercise.marks)
            closed = {} if solved else {"jupyter": {"source_hidden": True}}
            add("code", check_cell(exercise, hidden_test=solved), marked | closed)
            if solved:
                add("markdown", f"**Solution.** {plain(exercise.words)}", {})
    about = {"kernelspec": KERNELSPEC, "language_info": {"name": "python"}}
    notebook = nbformat.v4.new_notebook(cells=cells, metadata=about)
    nbformat.validate(notebook)
    return str(nbformat.writes(notebook)).rstrip("\n") + "\n"


def _marked(
    grade_id: str, cell_type: str, *, solution: bool = False, points: int | None = None
) -> dict[str, Any]:
    """Metadata of one cell, as nbgrader's schema 3 wants it."""
    entry: dict[str, Any] = {
        "schema_version": NBGRADER_SCHEMA,
        "grade_id": grade_id,
        "cell_type": cell_type,
        "grade": points is not None,
        "solution": solution,
        "locked": not solution,
        "task": False,
    }
    entry |= {} if points is None else {"points": points}
    return {"nbgrader": entry, "deletable": False} | ({} if solution else {"editable": False})


def _figure_of(chapter: Chapter, exercise: Exercise) -> dict[str, Any]:
    """Alternative text of a figure that the solution draws."""
    own = [p for p in chapter.pieces if p.label == exercise.label and p.kind == "solution"]
    return next(({"mystnb": p.metadata["mystnb"]} for p in own if "mystnb" in p.metadata), {})


def _with_parameters(source: str, metadata: Mapping[str, Any], preset: str, seed: int) -> str:
    if "parameters" not in metadata.get("tags", []):
        return source
    source = re.sub(r'^preset: str = ".*"', f'preset: str = "{preset}"', source, flags=re.MULTILINE)
    return re.sub(r"^seed: int = \d+", f"seed: int = {seed}", source, flags=re.MULTILINE)
