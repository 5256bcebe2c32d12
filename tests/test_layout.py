"""The house rule on imports: one way, down the floors; a module never imports from above."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "hadr"

#: From the outermost room down. A module may import from its own floor and from those below.
FLOORS: tuple[tuple[str, ...], ...] = (
    ("cli",),
    ("reproduce", "book", "notebook_twins", "course"),
    ("chapter_record", "private_kernel"),
    ("restore_frame", "restore_report"),
    ("experiments",),
    ("plotting", "widgets"),
    ("handover",),
    ("perception", "restoration", "depth_network", "frame_checks"),
    ("training",),
    ("models",),
    ("data",),
    ("synthesis",),
    ("hand",),
    ("dense_pairing",),
    ("ray_voxels",),
    ("corruption", "corruption_examples", "corruption_statistics"),
    ("metrics", "confidence", "confidence_rule"),
    ("frame_io",),
    ("camera",),
    ("result_file",),
    (
        "caches",
        "checkout",
        "dependencies",
        "exercises",
        "markdown",
        "output_folder",
        "provenance",
    ),
)
FLOOR_OF = {name: floor for floor, names in enumerate(FLOORS) for name in names}


def modules() -> list[Path]:
    return sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def imported_floors(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import in line {node.lineno}"
            targets = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        names |= {t.split(".")[1] for t in targets if t.startswith("hadr.")}
    return names & set(FLOOR_OF)


def test_each_module_has_a_floor() -> None:
    rooms = {p.relative_to(PACKAGE).parts[0].removesuffix(".py") for p in modules()}
    assert rooms == set(FLOOR_OF)


@pytest.mark.parametrize("path", modules(), ids=lambda p: p.relative_to(PACKAGE).as_posix())
def test_imports_run_down_the_floors(path: Path) -> None:
    own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    above = {name for name in imported_floors(path) if FLOOR_OF[name] < FLOOR_OF[own]}
    assert not above, f"{path.relative_to(PACKAGE)} imports from a floor above: {sorted(above)}"
