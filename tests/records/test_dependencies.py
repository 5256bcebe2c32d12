"""The rule on what a result depends on: code without its words, followed through all imports."""

import ast
from pathlib import Path

import pytest

from hadr.records import dependencies
from hadr.records.dependencies import code_digest, modules_behind, named_modules

PACKAGE = Path(__file__).resolve().parents[2] / "hadr"


def test_what_is_behind_a_module(library):
    assert modules_behind("hadr.top") == {
        "hadr.top", "hadr.part", "hadr.part.inner", "hadr.deep", "hadr.table", "hadr.named",
    }  # fmt: skip
    assert modules_behind("hadr.top", without=("hadr.table",)) == {
        "hadr.top", "hadr.part", "hadr.part.inner", "hadr.deep",
    }  # fmt: skip
    assert modules_behind("hadr.part.other") == {"hadr.part.other"}
    with pytest.raises(KeyError, match=r"hadr\.lost"):
        modules_behind("hadr.lost")


CHANGES = {
    "comment": ("deep.py", "VALUE = 1", "# a word\nVALUE = 1  # another", False),
    "docstrings": ("deep.py", "VALUE = 1", "'Words.'\nVALUE = 1\n'What it is.'", False),
    "docstring of a function": ("top.py", "What it does", "What it is for", False),
    "layout": ("deep.py", "VALUE = 1", "\n\nVALUE = (\n    1\n)", False),
    "code of the module": ("top.py", "def work()", "def work(more=1)", True),
    "constant of what an imported one imports": ("deep.py", "1", "2", True),
    "imported within a function": ("part/inner.py", "hadr.deep", "hadr.deep as deep", True),
    "named in a table": ("named.py", "1", "2", True),
    "package": ("part/__init__.py", "", "VALUE = 2", True),
    "template": ("page.html", "old", "new", True),
    "which template": ("top.py", "page.html", "other.html", True),
    "template that nobody names": ("other.html", "old", "new", False),
    "unrelated": ("beside.py", "1", "2", False),
    "unrelated in the same package": ("part/other.py", "1", "2", False),
    "bookkeeping": ("provenance.py", "1", "2", False),
    "for type checkers alone": ("typed.py", "1", "2", False),
    "in its place where nobody checks types": ("top.py", "VALUE = None", "VALUE = 1", True),
}


@pytest.mark.parametrize(("file", "old", "new", "counts"), CHANGES.values(), ids=CHANGES)
def test_what_changes_the_digest(library, file, old, new, counts):
    before = code_digest("hadr.top")
    text = (library / file).read_text()
    assert old in text
    (library / file).write_text(text.replace(old, new) if old else new)
    assert (code_digest("hadr.top") != before) == counts
    (library / file).write_text(text)
    assert code_digest("hadr.top") == before


def test_code_names_modules_as_a_module_does(library):
    code = "from hadr.part import inner\nimport numpy\nrun('hadr.beside')"
    assert named_modules(code) == {"hadr.part", "hadr.part.inner", "hadr.beside"}
    assert named_modules("x = 1") == set()
    assert named_modules("%magic") == set(dependencies._modules())  # it may lead anywhere


def test_all_data_of_the_package_belong_to_a_module():
    files = {
        path
        for path in PACKAGE.rglob("*")
        if path.is_file() and path.suffix not in (".py", ".pyc") and path.name != "py.typed"
    }
    named = set()
    for path in dependencies._modules().values():
        words = dependencies._prune(ast.parse(path.read_text(encoding="utf-8")))
        named |= {path.with_name(file.name) for file in files if file.name in words}
    assert named == files


def test_a_module_is_parsed_once(library, monkeypatch):
    before = code_digest("hadr.top")
    monkeypatch.setattr(dependencies.ast, "parse", None)
    assert code_digest("hadr.top") == before
