"""The house rule on imports: three rings, inward only; inside a ring, down the list."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import hadr

PACKAGE = Path(__file__).resolve().parents[1] / "hadr"

#: From the innermost on. A module may import from its own room and from those before it.
METHOD = (
    "records",
    "camera",
    "metrics",
    "corruption",
    "ray_voxels",
    "hand",
    "data",
    "frame_io",
    "camera_file",
    "models",
    "confidence",
    "rivals",
    "frame_checks",
    "training",
    "trained_finders",
    "trained_networks",
    "restoration",
    "handover",
)
WORKSHOPS = ("synthesis", "simulation", "experiments")
PRESS = ("figures", "press")
ROOMS = (*METHOD, *WORKSHOPS, *PRESS, "cli")
#: Packages that `import hadr` and the method must not load.
HEAVY = ("matplotlib", "mitsuba", "mujoco", "manifold3d", "hadr.synthesis", "hadr.figures")


def modules() -> list[Path]:
    return sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def imported_rooms(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import in line {node.lineno}"
            targets = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        inner = [t.split(".")[1] for t in targets if t.startswith("hadr.")]
        names |= {hadr.FRONT_DOOR.get(name, name).split(".")[0] for name in inner}
    return names & set(ROOMS)


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def test_each_module_lies_in_a_ring() -> None:
    assert {room(path) for path in modules()} == set(ROOMS)


@pytest.mark.parametrize("path", modules(), ids=lambda p: p.relative_to(PACKAGE).as_posix())
def test_imports_run_inward(path: Path) -> None:
    outer = {name for name in imported_rooms(path) if ROOMS.index(name) > ROOMS.index(room(path))}
    assert not outer, f"{path.relative_to(PACKAGE)} imports from outside: {sorted(outer)}"


def fresh(code: str) -> str:
    """What a new interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_the_front_door_is_light_and_opens() -> None:
    heavy = (*HEAVY, "torch", "cv2", "scipy", "numpy")
    loaded = f"[name for name in {heavy} if name in sys.modules]"
    assert fresh(f"import hadr, sys; print({loaded})") == "[]"
    for name, module in hadr.FRONT_DOOR.items():
        assert getattr(hadr, name).__module__ == f"hadr.{module}"
        assert name in dir(hadr)
    with pytest.raises(AttributeError, match="module 'hadr' has no attribute 'restroe'"):
        _ = hadr.restroe


def test_a_classical_restoration_loads_no_torch() -> None:
    assert fresh("import sys, hadr; hadr.restore; print('torch' in sys.modules)") == "False"


def test_the_method_loads_neither_workshop_nor_press() -> None:
    inner = [
        ".".join(("hadr", *path.relative_to(PACKAGE).with_suffix("").parts))
        for path in modules()
        if room(path) in METHOD and path.stem not in ("__init__", "mediapipe_hand")
    ]
    code = (
        f"import hadr, sys, importlib\nfor name in {inner}: importlib.import_module(name)\n"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    assert fresh(code) == "[]"
