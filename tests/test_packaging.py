"""The dependencies are named alike in pyproject.toml, environment.yml and constraints.txt."""

import ast
import importlib.metadata
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[1]
CONDA_NAMES = {"pytorch": "torch", "matplotlib-base": "matplotlib"}
CONDA_ONLY = {"python", "make", "pip"}
#: An extra of its own environment: MediaPipe brings an OpenCV that collides with the headless one.
APART = {"mediapipe"}
#: The physical world: importing it needs the extra "handover".
PHYSICAL = {
    "hadr.simulation.robot.arm_model",
    "hadr.simulation.robot.arm_motion",
    "hadr.simulation.robot.motion_limits",
    "hadr.simulation.robot.physical_arm",
    "hadr.simulation.world.physics",
    "hadr.simulation.world.model",
    "hadr.simulation.world.letting_go",
}
ON_PHYSICAL = {
    "hadr.simulation.trials.trial",
    "hadr.simulation.trials.experiment",
}
#: What comes with a dependency that is named.
COMES_WITH = {
    "drjit": "mitsuba",
    "ipython": "ipykernel",
    "nbclient": "papermill",
}


def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def pyproject_requirements():
    table = project()
    lines = list(table["dependencies"])
    for name, extra in table["optional-dependencies"].items():
        lines += [] if name in APART else extra
    return {canonicalize_name(r.name): r.specifier for r in map(Requirement, lines)}


def conda_requirements():
    content = yaml.safe_load((ROOT / "environment.yml").read_text(encoding="utf-8"))
    lines = []
    for entry in content["dependencies"]:
        lines += entry["pip"] if isinstance(entry, dict) else [entry]
    found = {}
    for requirement in map(Requirement, lines):
        name = CONDA_NAMES.get(requirement.name, requirement.name)
        if name not in CONDA_ONLY:
            found[canonicalize_name(name)] = requirement.specifier
    return found


def constraints():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [Requirement(line) for line in lines if line.strip() and not line.startswith("#")]
    return {canonicalize_name(pin.name): pin.specifier for pin in pins}


def test_conda_and_pyproject_name_the_same_dependencies():
    wanted = pyproject_requirements()
    conda = conda_requirements()
    assert set(conda) == set(wanted)
    assert {name: str(conda[name]) for name in conda} == {n: str(wanted[n]) for n in wanted}


def test_conda_asks_for_the_same_python():
    content = yaml.safe_load((ROOT / "environment.yml").read_text(encoding="utf-8"))
    pythons = [line for line in content["dependencies"] if str(line).startswith("python>")]
    assert pythons == [f"python{project()['requires-python']}"]


def test_every_dependency_is_pinned_inside_its_range():
    pins = constraints()
    for name, allowed in pyproject_requirements().items():
        assert name in pins, f"{name} is not in constraints.txt"
        (pin,) = pins[name]
        assert pin.operator == "=="
        assert Version(pin.version) in allowed, f"{name} {pin.version} is not in {allowed}"


def test_constraints_are_exact_and_without_what_must_stay_out():
    pins = constraints()
    assert all(str(pin).startswith("==") and "+" not in str(pin) for pin in pins.values())
    assert pins["torch"] == SpecifierSet("==2.13.0")
    unwanted = [n for n in pins if n in {"torchvision", "pyrender", "opencv-python", "hadr"}]
    unwanted += [n for n in pins if n.startswith(("nvidia-", "cuda-", "triton"))]
    assert unwanted == []


def test_pins_admit_the_oldest_python_that_is_promised():
    """A patch release matters: some packages ask for 3.11.5, and a long-lived system has 3.11.2."""
    oldest = project()["requires-python"].removeprefix(">=") + ".0"
    refusing = {}
    for name in constraints():
        try:
            wanted = importlib.metadata.metadata(name).get("Requires-Python")
        except importlib.metadata.PackageNotFoundError:
            continue
        if wanted and oldest not in SpecifierSet(wanted):
            refusing[name] = wanted
    assert refusing == {}


def imported_by(path, *, on_import=False):
    """Packages that a module imports, or only those that importing the module asks for."""
    names = set()
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    if on_import:
        nodes = ast.parse(path.read_text(encoding="utf-8")).body
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names - set(sys.stdlib_module_names) - {"hadr", "__future__"}


@pytest.mark.parametrize("on_import", [True, False], ids=["on import", "when called"])
def test_everything_the_library_imports_is_a_dependency(on_import):
    """Importing a module needs the base alone; functions, and `PHYSICAL`, may need an extra."""
    lines = list(project()["dependencies"])
    extras = project()["optional-dependencies"]
    if not on_import:
        for extra in extras.values():
            lines += extra
    declared = {canonicalize_name(Requirement(r).name) for r in lines}
    physics = {canonicalize_name(Requirement(r).name) for r in extras["handover"]}
    declared |= {name for name, parent in COMES_WITH.items() if parent in declared}
    packages = importlib.metadata.packages_distributions()
    missing = {}
    for path in sorted((ROOT / "hadr").rglob("*.py")):
        for name in imported_by(path, on_import=on_import):
            allowed = declared | (physics if module_name(path) in PHYSICAL else set())
            if allowed.isdisjoint(map(canonicalize_name, packages.get(name, [name]))):
                missing.setdefault(name, []).append(path.name)
    assert missing == {}


def module_name(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def test_only_the_attempts_stand_on_the_physical_world():
    """Chapters, film and command can be imported where the extra "handover" is not installed."""
    asked = {}
    for path in (ROOT / "hadr").rglob("*.py"):
        found = asked[module_name(path)] = set()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
    needing = set(PHYSICAL)
    while more := {name for name, found in asked.items() if found & needing} - needing:
        needing |= more
    assert needing == PHYSICAL | ON_PHYSICAL


def test_the_tests_extra_brings_what_the_handover_needs():
    extras = project()["optional-dependencies"]
    assert set(extras["handover"]) <= set(extras["test"])


def test_version_is_the_same_everywhere():
    import hadr

    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert hadr.__version__ == project()["version"] == citation["version"]
