"""`benchmarks/cameras/sensor_pictures.py`: frames with real, simulated, analytic errors."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from hadr.figures.depth.corruption_examples import read_examples
from hadr.records.result_file import read_sealed

REPOSITORY = Path(__file__).resolve().parents[2]
KEPT = REPOSITORY / "results" / "sensor" / "pictures.npz"


@pytest.fixture(scope="module")
def benchmark_script(load_benchmark) -> ModuleType:
    return load_benchmark("cameras/sensor_pictures")


def test_a_plane_is_found_among_other_points(benchmark_script):
    rng = np.random.default_rng(0)
    normal = np.array([2.0, -1.0, 2.0]) / 3
    flat = rng.uniform(-1, 1, (300, 3))
    flat += (0.7 - flat @ normal)[:, None] * normal + 0.0005 * rng.normal(size=(300, 3))
    other = rng.uniform(-1, 1, (100, 3))
    found, distance, share = benchmark_script.fitted_plane(np.concatenate([flat, other]))
    sign = np.sign(found @ normal)
    np.testing.assert_allclose(sign * found, normal, atol=1e-3)
    assert sign * distance == pytest.approx(0.7, abs=1e-3)
    assert share == pytest.approx(0.75, abs=0.02)


def test_the_kept_frames_are_those_of_the_real_camera(benchmark_script, realdata):
    kept, told = read_examples(KEPT), read_sealed(KEPT.with_suffix(".json"))
    for scene in benchmark_script.WHAT:
        example, known = benchmark_script.real_example(realdata / "cleargrasp_d435", scene)
        stored = kept[f"real-{scene[-3:]}"]
        for name in ("measured", "truth", "background"):
            np.testing.assert_allclose(
                getattr(stored, name), getattr(example, name), atol=0.000252, rtol=0
            )
        np.testing.assert_array_equal(stored.mask, example.mask)
        assert told["tables"][scene[-3:]] == pytest.approx(known, rel=1e-6)


def test_the_kept_file_says_whose_frames_they_are():
    told = read_sealed(KEPT.with_suffix(".json"))
    assert "Apache-2.0" in told["what"]
    assert "ClearGrasp" in told["what"]
    licence = (KEPT.parent / "LICENSE-Apache-2.0.txt").read_text(encoding="utf-8")
    assert "Apache License" in licence
    assert told["provenance"]["commit"]
