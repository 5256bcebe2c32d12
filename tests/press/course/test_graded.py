"""Notebooks for a course. nbgrader and otter-grader are not needed to run these tests: what they
read is written down here from their documentation."""

import builtins
import json
import re
import symtable
import sys
import types

import jsonschema
import nbformat
import pytest

from hadr.press.course.chapter import read_chapter
from hadr.press.course.graded import (
    STUB,
    check_cell,
    course_notebook,
    otter_test,
    solution_answer,
    student_answer,
    variable_of,
)
from hadr.press.course.teaching import NBGRADER_CONFIG

#: nbgrader's cell metadata, version 3, by its documentation.
NBGRADER_CELL = {
    "type": "object",
    "required": ["schema_version", "grade", "locked", "solution"],
    "additionalProperties": False,
    "properties": {
        "schema_version": {"const": 3},
        "grade": {"type": "boolean"},
        "locked": {"type": "boolean"},
        "solution": {"type": "boolean"},
        "task": {"type": "boolean"},
        "grade_id": {"type": "string", "pattern": r"^[a-zA-Z0-9_\-]+$"},
        "points": {"type": "number", "minimum": 0},
        "cell_type": {"enum": ["raw", "code", "markdown"]},
    },
}


def notebook_of(chapter, *, solved, **options):
    options = {"preset": "tiny", "seed": 0, "plain": str, **options}
    return nbformat.reads(course_notebook(chapter, solved=solved, **options), 4)


def marked(notebook):
    return {c.metadata.nbgrader.grade_id: c for c in notebook.cells if "nbgrader" in c.metadata}


def released(notebook):
    """What nbgrader makes of a source: the regions between its marks go, a stub comes."""
    for cell in notebook.cells:
        cell.source = re.sub(
            r"### BEGIN SOLUTION\n.*?### END SOLUTION", STUB, cell.source, flags=re.DOTALL
        )
        cell.source = re.sub(
            r"### BEGIN HIDDEN TESTS\n.*?### END HIDDEN TESTS\n", "", cell.source, flags=re.DOTALL
        )
    return notebook


def test_student_and_solution_cells(small):
    (exercise,) = small.exercises
    assert variable_of("ex-03-1") == "answer_03_1"
    assert student_answer(exercise) == f"three = 3\nanswer_07_1 = ...\n{STUB}"
    solved = solution_answer(exercise)
    assert "answer_07_1 = twice(three)" in solved
    assert "check(" not in solved
    scope = {}
    exec(solved, scope)
    assert scope["answer_07_1"] == 6


def test_an_answer_cell_that_does_not_wait_is_named(small_notebook):
    chapter = read_chapter(small_notebook(lambda cells: cells[6].update(source="answer = None")))
    with pytest.raises(ValueError, match=r"ex-07-1: its answer cell must end with"):
        student_answer(chapter.exercises[0])


@pytest.mark.parametrize(("answer", "status"), [(6, "right"), (9, "wrong"), (..., "open")])
def test_only_a_right_answer_passes_the_hidden_test(small, answer, status):
    (exercise,) = small.exercises
    shown = []
    scope = {"answer_07_1": answer, "display": shown.append}
    exec("from hadr.press.exercises import check", scope)
    exec(check_cell(exercise, hidden_test=False), scope)  # the student's cell never raises
    assert [verdict.status for verdict in shown] == [status]
    if status == "right":
        exec(check_cell(exercise, hidden_test=True), scope)
    else:
        with pytest.raises(AssertionError):
            exec(check_cell(exercise, hidden_test=True), scope)


def test_an_answer_cell_that_failed_leaves_the_answer_open(small):
    scope = {"answer": 6, "display": lambda shown: None}  # of an exercise before
    exec("from hadr.press.exercises import check", scope)
    exec(check_cell(small.exercises[0], hidden_test=False), scope)
    assert scope["verdict"].status == "open"


def test_the_student_finds_no_solution(small):
    text = nbformat.writes(notebook_of(small, solved=False))
    for secret in ("Add it to itself", "def twice", "BEGIN SOLUTION", "assert", "solution-start"):
        assert secret not in text
        assert secret in nbformat.writes(notebook_of(small, solved=True)) + "solution-start"
    assert "last = 1" in text


def test_parameters_and_run_time(small):
    text = nbformat.writes(notebook_of(small, solved=False, preset="mini", seed=3))
    assert 'preset: str = \\"mini\\"' in text
    assert "seed: int = 3" in text
    assert "Measured run time" not in text


@pytest.mark.parametrize("solved", [False, True])
def test_metadata_is_nbgraders(small, solved):
    """Its schema, and the rules of its validator that a schema cannot say."""
    notebook = notebook_of(small, solved=solved)
    ids = [c.metadata.nbgrader.grade_id for c in notebook.cells if "nbgrader" in c.metadata]
    assert len(ids) == len(set(ids)) == 3
    for cell in marked(notebook).values():
        entry = json.loads(json.dumps(cell.metadata.nbgrader))
        jsonschema.validate(entry, NBGRADER_CELL)
        assert entry["cell_type"] == cell.cell_type
        assert ("points" in entry) == entry["grade"]
        assert entry["locked"] != entry["solution"]
        if cell.cell_type == "markdown":
            assert not entry["grade"]
            assert not entry["solution"]
    flags = {k: (c.metadata.nbgrader.grade, c.metadata.nbgrader.solution)
             for k, c in marked(notebook).items()}  # fmt: skip
    assert flags == {
        "ex-07-1-question": (False, False),
        "ex-07-1-answer": (False, True),
        "ex-07-1-check": (True, False),
    }
    check = marked(notebook)["ex-07-1-check"].metadata
    assert check.nbgrader.points == 1
    # JupyterLab shows the student's check folded: it holds the expected answer.
    assert check.get("jupyter") == (None if solved else {"source_hidden": True})
    assert "(1 mark)" in marked(notebook)["ex-07-1-question"].source


def test_every_chapter_is_what_nbgrader_releases_from_its_solutions(book):
    for chapter in book:
        student = marked(notebook_of(chapter, solved=False))
        source = marked(released(notebook_of(chapter, solved=True)))
        assert len(student) == 3 * len(chapter.exercises)
        assert {k: c.source for k, c in student.items()} == {k: c.source for k, c in source.items()}
        for cell in student.values():
            jsonschema.validate(json.loads(json.dumps(cell.metadata.nbgrader)), NBGRADER_CELL)


def test_the_settings_for_nbgrader_put_the_same_stub():
    settings = types.SimpleNamespace(
        ClearSolutions=types.SimpleNamespace(), ExecutePreprocessor=types.SimpleNamespace()
    )
    exec(NBGRADER_CONFIG, {"get_config": lambda: settings})
    assert settings.ClearSolutions.code_stub == {"python": STUB}


@pytest.fixture
def otter(monkeypatch):
    """Stands in for otter-grader: the decorator of its exception-based test files."""

    class test_case:  # noqa: N801
        def __init__(self, name=None, points=None, hidden=False, success_message=None,
                     failure_message=None):  # fmt: skip
            self.points, self.hidden = points, hidden

        def __call__(self, function):
            self.function = function
            return self

    module = types.ModuleType("otter.test_files")
    module.test_case = test_case
    monkeypatch.setitem(sys.modules, "otter", types.ModuleType("otter"))
    monkeypatch.setitem(sys.modules, "otter.test_files", module)
    return test_case


def test_a_test_file_for_otter(small, otter):
    scope = {}
    exec(otter_test(small.exercises[0]), scope)  # otter compiles the text and reads its names
    assert (scope["OK_FORMAT"], scope["name"], scope["points"]) == (False, "ex-07-1", 1)
    (case,) = [value for value in scope.values() if isinstance(value, otter)]
    assert (case.points, case.hidden) == (1, False)
    case.function(env={"answer_07_1": 6})
    with pytest.raises(AssertionError, match="That is the square"):
        case.function(env={"answer_07_1": 9})
    with pytest.raises(AssertionError, match="Not answered yet"):
        case.function(env={"answer_07_1": ...})
    with pytest.raises(AssertionError):  # a check of one's own does not help
        case.function(env={"answer_07_1": 9, "check": lambda *_, **__: True})


@pytest.mark.parametrize("solved", [False, True])
def test_no_cell_reads_what_only_a_removed_cell_made(book, solved):
    """Read from the code alone: each name is made in a cell before, or in the cell itself."""
    for chapter in book:
        made = set(dir(builtins)) | {"get_ipython", "display"}
        for cell in notebook_of(chapter, solved=solved).cells:
            if cell.cell_type != "code":
                continue
            tables = [symtable.symtable(cell.source, "<cell>", "exec")]
            made |= {s.get_name() for s in tables[0].get_symbols() if s.is_assigned()}
            made |= {s.get_name() for s in tables[0].get_symbols() if s.is_imported()}
            made |= {s.get_name() for s in tables[0].get_symbols() if s.is_namespace()}
            asked = {s.get_name() for s in tables[0].get_symbols() if s.is_referenced()}
            while tables:
                inner = tables.pop().get_children()
                tables += inner
                asked |= {s.get_name() for t in inner for s in t.get_symbols() if s.is_global()}
            assert asked <= made, (chapter.name, cell.source)
