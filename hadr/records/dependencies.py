"""What a result depends on: the one rule by which a finished one is believed, or made again.

A chapter, a row of a table and an attempt of the handover are each kept with a checksum of

- their settings, as values: preset, seed, recipe, protocol, the description of an attempt;
- what they read: the notebook, result files, samples, a data folder, bundled networks;
- the code that makes them: `code_digest` of the modules with which it begins.

Where one of these is another than it was, the result is made again, and a training that other code
began is set aside before a new one begins. What is installed beside the library does not count, nor
does what notes where a result comes from (`hadr.records.provenance`, which names both).
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Collection
from functools import cache
from pathlib import Path

LIBRARY = Path(__file__).resolve().parents[1]


def code_digest(*modules: str, without: Collection[str] = ()) -> str:
    """Checksum of the code that modules lead to, whatever its comments and docstrings say.

    It is over the modules, over those that they import, at whatever place, or whose dotted name is
    a string in them, as in a table of networks, and so on; and over the other files of a module's
    folder that it names, such as the template of a page. Not over `hadr.records.provenance`, nor
    over what only the modules `without` lead to: tables of all networks. 64 hexadecimal digits,
    other ones on a Python with another syntax tree; KeyError for an unknown module.
    """
    whole, known = hashlib.sha256(), _modules()
    for name in sorted(modules_behind(*modules, without=without)):
        path = known[name]
        code, words = _read(path.read_text(encoding="utf-8"))
        whole.update(f"{name} {code}\0".encode())
        for file in sorted(path.parent.iterdir()):
            if file.name in words and file.suffix != ".py" and file.is_file():
                digest = hashlib.sha256(file.read_bytes()).hexdigest()
                whole.update(f"{file.name} {digest}\0".encode())
    return whole.hexdigest()


def modules_behind(*modules: str, without: Collection[str] = ()) -> set[str]:
    """The modules that `code_digest` is over; arguments and errors are the same."""
    known, found, left = _modules(), set[str](), list(modules)
    while left:
        name = left.pop()
        if name in found or name in without or name == "hadr.records.provenance":
            continue
        found.add(name)
        _, words = _read(known[name].read_text(encoding="utf-8"))
        left += words & known.keys()
    return found


def named_modules(code: str) -> set[str]:
    """The library's modules that some code imports or names; all of them if it is no Python."""
    try:
        return _prune(ast.parse(code)) & _modules().keys()
    except SyntaxError:
        return set(_modules())


def _modules() -> dict[str, Path]:
    """File of each of the library's modules, by its dotted name."""
    found = {}
    for path in LIBRARY.rglob("*.py"):
        parts = ("hadr", *path.relative_to(LIBRARY).with_suffix("").parts)
        found[".".join(parts).removesuffix(".__init__")] = path
    return found


@cache
def _read(text: str) -> tuple[str, frozenset[str]]:
    """Checksum of a module's code, and the words in it."""
    tree = ast.parse(text)
    words = _prune(tree)
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest(), frozenset(words)


def _prune(tree: ast.AST) -> set[str]:
    """Take out what does nothing; give what the rest imports, and its strings with a dot."""
    found, left = set[str](), [tree]
    while left:
        node = left.pop()
        for part in ("body", "orelse", "finalbody"):
            if isinstance(statements := getattr(node, part, None), list):
                setattr(node, part, [done for each in statements for done in _effective(each)])
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}", *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and "." in node.value:
            found.add(node.value)
        left += ast.iter_child_nodes(node)
    return found


def _effective(statement: ast.stmt) -> list[ast.stmt]:
    """What is run of a statement: nothing of a docstring, nor of what type checkers alone read."""
    match statement:
        case ast.Expr(value=ast.Constant(value=str())):
            return []
        case ast.If(test=ast.Name(id="TYPE_CHECKING"), orelse=otherwise):
            return [done for each in otherwise for done in _effective(each)]
    return [statement]
