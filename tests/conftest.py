"""Fixtures that every part of the suite shares."""

import copy
import importlib
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import settings

if "PYTEST_XDIST_WORKER" in os.environ:
    # Two workers share two cores: one thread each, set before a library reads it.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """As ``--dist loadfile``, but what all pages look like on a phone is a work unit of its own."""
    from xdist.scheduler import LoadFileScheduling

    class ByDevice(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file, _, test = nodeid.partition("::")
            return f"{file}::phone" if "phone" in test.partition("[")[2] else file

    return ByDevice(config, log)


REALDATA = Path(__file__).resolve().parents[2] / "shared" / "realdata"


@pytest.fixture(scope="session")
def realdata() -> Path:
    """The folder of real recordings, beside the project; they are not part of it."""
    if not REALDATA.is_dir():
        pytest.skip(
            "real recordings not found: put ClearGrasp's D435 scenes, the RealSense calibrations "
            "and the UR5 reference into ../shared/realdata, beside the project's folder"
        )
    return REALDATA


@pytest.fixture(scope="session")
def load_benchmark() -> Callable[[str], ModuleType]:
    """Import a script below the folder `benchmarks`, which is no package, by its path there."""

    def load(path: str) -> ModuleType:
        folder, name = path.split("/")
        sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks" / folder))
        try:
            return importlib.import_module(name)
        finally:
            sys.path.pop()

    return load


HOLDS = (("0010", 922), ("0006", 920), ("0006", 921))
"""Objects and holds of which the first usually succeeds; rounding may end an attempt otherwise."""


@pytest.fixture(scope="session")
def whole() -> object:
    """An attempt with perfect depth that succeeds, from the first picture to the goal."""
    from hadr.simulation.trials.trial import Trial, run_trial

    for object_id, hold in HOLDS:
        run = run_trial(Trial(object_id, hold, "perfect"))
        if run.outcome.verdict == "success":
            return run
    pytest.fail(f"no attempt succeeds, of {HOLDS}")


@pytest.fixture(scope="session")
def in_double() -> Callable[..., tuple[object, object]]:
    """Gives a copy of a network, and frames, with numbers of 64 bits.

    What then differs by more than 1e-12 is no rounding, whatever the processor.
    """

    def exact(network, inputs):
        wide = {name: v.double() for name, v in vars(inputs).items() if v.is_floating_point()}
        return copy.deepcopy(network).double(), replace(inputs, **wide)

    return exact


@pytest.fixture(scope="session")
def noise_frames() -> Callable[..., object]:
    """Builds frames of noise: (height, width, count, hand); half of the mask's depth is missing.

    Where a hand is asked for, it is at 0.55 m in the first of two frames and at 0.7 m in the other.
    """
    import torch

    from hadr.models.network_input import HADRInput

    def build(height: int = 18, width: int = 32, count: int = 2, hand: bool = False) -> HADRInput:
        generator = torch.Generator().manual_seed(0)
        mask = torch.zeros(count, height, width, dtype=torch.bool)
        mask[:, 4:12, 10:20] = True
        depth = 0.4 + 0.6 * torch.rand(count, height, width, generator=generator)
        depth[:, 4:12, 10:15] = 0
        camera = 0.94 * width, 0.94 * width, (width - 1) / 2, (height - 1) / 2
        keypoints, uv = torch.zeros(count, 21, 3), torch.zeros(count, 21, 2)
        if hand:
            keypoints = 0.02 * torch.randn(2, 21, 3, generator=generator)
            keypoints[..., 2] += torch.tensor([0.55, 0.7])[:, None]
            uv = width / 2 * torch.rand(2, 21, 2, generator=generator)
        color = torch.rand(count, 3, height, width, generator=generator)
        return HADRInput(color, depth, mask, torch.tensor([camera] * count), keypoints, uv)

    return build


TOP = """
from typing import TYPE_CHECKING
import hadr.table
if TYPE_CHECKING:
    from hadr.typed import VALUE
else:
    VALUE = None
PAGE = "page.html"
def work():
    'What it does.'
    from hadr.part import inner
"""


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small library in place of hadr, for `hadr.records.dependencies`: `top` leads to `deep`."""
    root = tmp_path / "library"
    files = {
        "__init__.py": "",
        "top.py": TOP,
        "part/__init__.py": "",
        "part/inner.py": "import hadr.deep\n",
        "part/other.py": "VALUE = 1\n",
        "deep.py": "import hadr.records.provenance\nVALUE = 1\n",
        "provenance.py": "VALUE = 1\n",
        "table.py": 'NETWORKS = {"a": ("hadr.named", "A")}\n',
        "named.py": "VALUE = 1\n",
        "beside.py": "VALUE = 1\n",
        "typed.py": "VALUE = 1\n",
        "page.html": "<p>old",
        "other.html": "<p>old",
    }
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    monkeypatch.setattr("hadr.records.dependencies.LIBRARY", root)
    return root


# A check passes twice or never: the same examples each time, and however long they take.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("random", deadline=None)  # pytest --hypothesis-profile=random
settings.load_profile("same")
