"""Every exercise of every chapter: its check tells right from plausibly wrong from open.

Executing whole chapters takes minutes, so each exercise runs in what it needs: the cells of its
chapter that define the names which its own cells read, and so on backwards.
"""

import ast
import contextlib
import io
import symtable
from pathlib import Path

import matplotlib
import pytest

from hadr.press.course.chapter import hints, read_chapter
from hadr.press.course.graded import check_cell, solution_answer, student_answer, variable_of
from hadr.press.exercises import check

NOTEBOOKS = sorted((Path(__file__).resolve().parents[3] / "notebooks").glob("[0-9]*.ipynb"))
CHAPTERS = {path.stem: read_chapter(path) for path in NOTEBOOKS}
ANSWERS = (ast.Assign, ast.AnnAssign, ast.FunctionDef, ast.Import, ast.ImportFrom)
EXERCISES = [(name, e) for name, chapter in CHAPTERS.items() for e in chapter.exercises]


class Names(ast.NodeVisitor):
    """What one statement reads from outside, and which objects it changes in place."""

    def __init__(self, statement):
        table = symtable.symtable(ast.unparse(statement), "<cell>", "exec")
        self.makes = {s.get_name() for s in table.get_symbols() if s.is_assigned()}
        self.makes |= {s.get_name() for s in table.get_symbols() if s.is_imported()}
        self.makes |= {t.get_name() for t in table.get_children() if t.get_type() == "function"}
        self.reads = {s.get_name() for s in table.get_symbols() if s.is_referenced()}
        inner = list(table.get_children())
        while inner:
            one = inner.pop()
            inner += one.get_children()
            self.reads |= {s.get_name() for s in one.get_symbols() if s.is_global()}
        self.changes = set()
        self.visit(statement)

    def visit_Subscript(self, node):
        self.changed(node)

    def visit_Attribute(self, node):
        self.changed(node)

    def changed(self, node):
        inner = node
        while isinstance(inner, ast.Subscript | ast.Attribute):
            inner = inner.value
        if isinstance(inner, ast.Name) and not isinstance(node.ctx, ast.Load):
            self.changes.add(inner.id)
        self.generic_visit(node)

    def visit_Expr(self, node):
        """A method called for its effect, such as ``rows.append(row)``, changes its object."""
        call = node.value
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute):
            inner = call.func.value
            while isinstance(inner, ast.Subscript):
                inner = inner.value
            if isinstance(inner, ast.Name):
                self.changes.add(inner.id)
        self.generic_visit(node)


def needed_statements(sources, targets):
    """The statements of the cells ``sources`` on which the cells ``targets`` depend, in order.

    All are walked backwards with the set of names that are still asked for. A plain assignment
    answers for its names; a change in place is kept, and its name stays asked for. Loop
    variables are answered for inside of their loop.
    """
    live = set()
    chosen = []
    statements = [(s, False) for source in sources for s in ast.parse(source).body]
    statements += [(s, True) for target in targets for s in ast.parse(target).body]
    for statement, is_target in reversed(statements):
        names = Names(statement)
        if not (is_target or (names.makes | names.changes) & live):
            continue
        if not is_target:
            chosen.append(statement)
        if isinstance(statement, ANSWERS):
            live -= names.makes
        inside = set()
        if isinstance(statement, ast.For):
            loops = [n for n in ast.walk(statement) if isinstance(n, ast.For)]
            inside = {
                n.id for loop in loops for n in ast.walk(loop.target) if isinstance(n, ast.Name)
            }
        live |= names.reads - inside
    return chosen[::-1]


def run_cell(source, scope):
    """Run a cell and give the value of its last expression."""
    body = ast.parse(source).body
    with contextlib.redirect_stdout(io.StringIO()):
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), "<cell>", "exec"), scope)
        if last is not None:
            return eval(compile(ast.Expression(last.value), "<cell>", "eval"), scope)


def state_for(chapter, exercise):
    """The names that an exercise needs, as its chapter has made them when it begins."""
    scope = {"__name__": "chapter", "display": lambda shown: shown}
    before = []
    for piece in chapter.pieces:
        if piece.label == exercise.label:
            break
        if (
            piece.is_code
            and not piece.label
            and "interactive" not in piece.metadata.get("tags", ())
        ):
            before.append(piece.source)
    targets = [exercise.answer, exercise.check, *exercise.solution]
    for statement in needed_statements(before, targets):
        run_cell(ast.unparse(statement), scope)
    return scope


@pytest.fixture(params=EXERCISES, ids=lambda pair: pair[1].label)
def case(request):
    matplotlib.use("agg")
    name, exercise = request.param
    return exercise, state_for(CHAPTERS[name], exercise)


def test_right_open_and_plausibly_wrong(case):
    exercise, scope = case
    variable = variable_of(exercise.label)
    told = []

    def spy(answer, expected, **options):
        told.append(list(options.get("wrong", ())))
        return check(answer, expected, **options)

    run_cell(student_answer(exercise), scope)
    assert scope[variable] is ...
    asked = check_cell(exercise, hidden_test=False)
    assert run_cell(asked, scope | {"check": spy}).status == "open"

    plausible = told[-1]
    assert plausible, "the check knows no plausible wrong answer"
    assert [hint for _, hint in plausible] == list(hints(exercise))
    for value, hint in plausible:
        verdict = run_cell(asked, scope | {variable: value})
        assert (verdict.status, verdict.message) == ("wrong", hint), value

    graded = check_cell(exercise, hidden_test=True)
    with pytest.raises(AssertionError, match="Not answered yet"):
        run_cell(graded, dict(scope))
    run_cell(solution_answer(exercise), scope)  # before the check: it needs nothing from it
    verdict = run_cell(graded, scope)
    assert str(verdict).startswith("✓ Right")
