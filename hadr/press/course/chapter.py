"""A chapter as a course sees it: its goals, its exercises with their cells, and its plain Markdown.

A chapter's notebook marks an exercise with the book's own fences: ``{exercise-start}`` and
``{exercise-end}`` around the question, a cell in which ``answer = ...`` waits for the reader, a
cell that ends with ``check(answer, ...)``, and ``{solution-start}`` to ``{solution-end}`` around
the solution, whose last line is ``check(RESULT, ...)``.
"""

import ast
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

Kind = Literal["prose", "code", "question", "answer", "check", "solution"]

_FENCE = re.compile(
    r"^(?P<ticks>`{3,})\{(?P<gate>exercise|solution)-(?P<end>start|end)\}[ \t]*(?P<words>[^\n]*)\n"
    r"(?P<options>(?::[\w-]+:[^\n]*\n)*)(?P=ticks)[ \t]*$",
    flags=re.MULTILINE,
)
_GOALS = re.compile(
    r"^\*\*You will be able to\*\*:?\s*\n((?:\s*\n|[-*] .*\n|  .*\n)+)", re.MULTILINE
)
_CITE = re.compile(r"\{cite(?::\w+)?\}`([^`]+)`")
_DOC = re.compile(r"\{doc\}`(?:([^`<]+?)\s*<([^`>]+)>|([^`]+))`")
_NUMBER = re.compile(r"(^|\. )?\{numref\}`[^`]+`", re.MULTILINE)
_UNSEEN = re.compile(r"^(\([\w-]+\)=|% .*)\n+", re.MULTILINE)
_INNER = re.compile(r"\[([^\]]+)\]\(<?#([^>)]+)>?\)")
_TABLE = re.compile(r"^:::\{table\} (.+)\n(?::name: .+\n)?\n(?s:(.+?))^:::$", re.MULTILINE)
_PAGE = re.compile(r"\]\(\.\./([\w/-]+\.md)(#[\w-]+)?\)")
_WORTH = {
    1: "00-1 01-1 01-2 01-3 02-2 04-2 05-2 06-1 06-3 07-1 08-1 08-4 09-1 10-1 10-3 11-1 11-2 12-1 "
    "13-1 13-2",
    3: "03-3 08-3 11-3 12-3",
}
MARKS = {f"ex-{name}": marks for marks, listed in _WORTH.items() for name in listed.split()}
"""Exercises that are not worth two marks: one for pencil and paper, three for a small experiment of
one's own."""


@dataclass(frozen=True)
class Piece:
    """A stretch of a chapter: one code cell, or prose between two fences.

    The label is the exercise's; it is empty outside of exercises.
    """

    kind: Kind
    source: str
    metadata: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""
    is_code: bool = False


@dataclass(frozen=True)
class Exercise:
    """One exercise of a chapter: question and words of the solution as Markdown, cells as code.

    The label, such as ``ex-03-1``, is that of the book, and the number, such as ``3.1``, the one
    that its pages show.
    """

    label: str
    number: str
    title: str
    question: str
    answer: str
    check: str
    words: str
    solution: tuple[str, ...]

    @property
    def marks(self) -> int:
        """What a right answer is worth."""
        return MARKS.get(self.label, 2)

    @property
    def marks_text(self) -> str:
        """The marks in words: ``1 mark``, ``2 marks``."""
        return "1 mark" if self.marks == 1 else f"{self.marks} marks"


@dataclass(frozen=True)
class Chapter:
    """A chapter of the book, taken apart; its name is such as ``03_ray_voxels``."""

    name: str
    title: str
    goals: tuple[str, ...]
    pieces: tuple[Piece, ...]
    exercises: tuple[Exercise, ...]

    @property
    def number(self) -> int:
        """The chapter's number in the book."""
        return int(self.name[:2])


def read_chapter(path: Path) -> Chapter:
    """Take a notebook apart."""
    import nbformat

    notebook = nbformat.read(path, 4)
    pieces, titles = _pieces(notebook.cells, path.name)
    prose = "\n\n".join(piece.source for piece in pieces if piece.kind == "prose")
    title = re.search(r"^# +(.+)$", prose, flags=re.MULTILINE)
    goals = _GOALS.search(prose + "\n")
    if title is None or goals is None:
        missing = "title" if title is None else "list under '**You will be able to**'"
        raise ValueError(f"{path.name} has no {missing}")
    listed = re.split(r"^[-*] ", goals.group(1), flags=re.MULTILINE)[1:]
    return Chapter(
        name=path.stem,
        title=title.group(1).strip(),
        goals=tuple(" ".join(goal.split()).rstrip(".;") for goal in listed),
        pieces=tuple(pieces),
        exercises=tuple(
            _exercise(pieces, label, f"{int(path.stem[:2])}.{place}", words, path.name)
            for place, (label, words) in enumerate(titles.items(), start=1)
        ),
    )


def read_chapters(root: Path) -> list[Chapter]:
    """Take all chapters of a checkout apart, in the book's order."""
    return [read_chapter(path) for path in sorted((root / "notebooks").glob("[0-9][0-9]_*.ipynb"))]


def _pieces(cells: Sequence[Any], name: str) -> tuple[list[Piece], dict[str, str]]:
    pieces: list[Piece] = []
    titles: dict[str, str] = {}
    kind: Kind = "prose"
    label = ""
    for cell in cells:
        if cell.cell_type == "code":
            pieces.append(Piece(_code_kind(kind, label, pieces), cell.source, dict(cell.metadata),
                                label, True))  # fmt: skip
            continue
        position = 0
        for fence in _FENCE.finditer(cell.source):
            _add_prose(pieces, kind, cell.source[position : fence.start()], label)
            position = fence.end()
            if fence["end"] == "end":
                kind = "prose"
                label = label if fence["gate"] == "exercise" else ""
            elif fence["gate"] == "exercise":
                found = re.search(r"^:label: *(\S+)", fence["options"], flags=re.MULTILINE)
                if found is None:
                    raise ValueError(f"{name}: the exercise {fence['words']!r} has no label")
                kind, label = "question", found.group(1)
                titles[label] = fence["words"].strip()
            else:
                kind, label = "solution", fence["words"].strip()
        _add_prose(pieces, kind, cell.source[position:], label)
    return pieces, titles


def _code_kind(kind: Kind, label: str, before: Sequence[Piece]) -> Kind:
    """Between question and solution stand the cell for the answer and then the check."""
    if kind != "prose" or not label:
        return "code" if kind == "prose" else kind
    answered = any(piece.kind == "answer" and piece.label == label for piece in before)
    return "check" if answered else "answer"


def _add_prose(pieces: list[Piece], kind: Kind, text: str, label: str) -> None:
    if text.strip():
        inside = label if kind in ("question", "solution") else ""
        pieces.append(Piece(kind, text.strip(), {}, inside))


def _exercise(pieces: Sequence[Piece], label: str, number: str, title: str, name: str) -> Exercise:
    by_kind: dict[str, list[str]] = {}
    for piece in (piece for piece in pieces if piece.label == label):
        key = "code" if piece.kind == "solution" and piece.is_code else piece.kind
        by_kind.setdefault(key, []).append(piece.source)
    for part in ("question", "answer", "check", "solution"):
        if part not in by_kind:
            raise ValueError(f"{name}: the exercise {label} has no {part}")
    if len(by_kind["check"]) > 1 or not by_kind.get("code"):
        raise ValueError(
            f"{name}: the exercise {label} needs one check cell and a solution with code; it has "
            f"{len(by_kind['check'])} and {len(by_kind.get('code', []))}"
        )
    last_call(by_kind["check"][0], f"{name}: the check cell of {label}")
    last_call(by_kind["code"][-1], f"{name}: the solution of {label}")
    return Exercise(
        label=label,
        number=number,
        title=title,
        question="\n\n".join(by_kind["question"]),
        answer=by_kind["answer"][0],
        check=by_kind["check"][0],
        words="\n\n".join(by_kind["solution"]),
        solution=tuple(by_kind["code"]),
    )


def last_call(source: str, what: str) -> ast.Call:
    """The call of ``check`` with which a cell must end; ``what`` is how an error names the cell."""
    match ast.parse(source).body:
        case [*_, ast.Expr(ast.Call(ast.Name("check"), [_, *_]) as call)]:
            return call
    raise ValueError(f"{what} must end with check(...), got {source.splitlines()[-1:]}")


def hints(exercise: Exercise) -> tuple[str, ...]:
    """What the check says to plausible wrong answers, read from its code, which is not run.

    The sentences stand as the second of two in a pair, in ``wrong=`` itself or in a list that has
    a name of its own.
    """
    tree = ast.parse(exercise.check)
    call = last_call(exercise.check, exercise.label)
    given = (node for node in tree.body if isinstance(node, ast.Assign))
    named = {name.id: n.value for n in given for name in n.targets if isinstance(name, ast.Name)}
    listed = next((word.value for word in call.keywords if word.arg == "wrong"), None)
    if isinstance(listed, ast.Name):
        listed = named.get(listed.id)
    found: list[str] = []
    for pair in listed.elts if isinstance(listed, ast.List | ast.Tuple) else ():
        hint = pair.elts[1] if isinstance(pair, ast.Tuple) and len(pair.elts) == 2 else pair
        if isinstance(hint, ast.Name):
            hint = named.get(hint.id, hint)
        if not (isinstance(hint, ast.Constant) and isinstance(hint.value, str)):
            raise ValueError(
                f"{exercise.label}: wrong= must list pairs (value, 'sentence'), "
                f"got {ast.unparse(pair)}"
            )
        found.append(hint.value)
    return tuple(found)


def short_citations(bibliography: str) -> dict[str, str]:
    """How prose names the works of a BibTeX file's text: ``Yu et al., 2024`` by key."""
    names = {}
    for entry in re.split(r"^@", bibliography, flags=re.MULTILINE)[1:]:
        key = re.match(r"\w+\{([^,\s]+),", entry)
        authors = re.search(r"^\s*author\s*=\s*\{(.+)\},?\s*$", entry, flags=re.MULTILINE)
        year = re.search(r"^\s*year\s*=\s*\{?(\d{4})", entry, flags=re.MULTILINE)
        if key is None:
            continue
        people = re.split(r"\s+and\s+", authors.group(1)) if authors else [key.group(1)]
        family = [re.sub(r"[{}\\'\"^~`]", "", person.split(",")[0]) for person in people]
        who = {1: family[0], 2: " and ".join(family[:2])}.get(len(family), f"{family[0]} et al.")
        names[key.group(1)] = f"{who}, {year.group(1)}" if year else who
    return names


def plain_markdown(text: str, citations: Mapping[str, str], pages: str) -> str:
    """Turn the book's Markdown into such as Jupyter shows without extensions."""

    def cited(found: re.Match[str]) -> str:
        keys = [key.strip() for key in found.group(1).split(",")]
        return "(" + "; ".join(citations.get(key, key) for key in keys) + ")"

    def linked(found: re.Match[str]) -> str:
        target = found.group(2) or found.group(3)
        words = found.group(1) or Path(target).name
        if target.startswith("../"):
            return f"[{words}]({pages}/{Path(target).name}.md)"
        return f"[{words}]({target}.ipynb)"

    def numbered(found: re.Match[str]) -> str:
        return "the table" if found.group(1) is None else f"{found.group(1)}The table"

    def within(found: re.Match[str]) -> str:
        """Rows of the ledger and the glossary's terms have pages; what has none loses its link."""
        words, target = found.groups()
        if target.startswith("ledger-"):
            return f"[{words}]({pages}/ledger.md)"
        known = not re.search(r"[-.]", target)
        return f"[{words}]({pages}/glossary.md)" if known else str(words)

    text = _INNER.sub(within, _UNSEEN.sub("", _NUMBER.sub(numbered, text)))
    text = _TABLE.sub(r"*\1*\n\n\2", text)
    text = _DOC.sub(linked, _CITE.sub(cited, text))
    return _PAGE.sub(lambda found: f"]({pages}/{found.group(1)}{found.group(2) or ''})", text)
