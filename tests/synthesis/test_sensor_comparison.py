"""`benchmarks/cameras/depth_camera.py`: the simulated depth camera beside a real one."""

import json
from dataclasses import asdict
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from hadr.synthesis.textures.families import FAMILIES

REPOSITORY = Path(__file__).resolve().parents[2]
RESULTS = REPOSITORY / "results" / "sensor" / "comparison.json"


@pytest.fixture(scope="module")
def benchmark_script(load_benchmark) -> ModuleType:
    return load_benchmark("cameras/depth_camera")


def test_errors_of_a_picture_made_by_hand(benchmark_script):
    truth = np.full((64, 128), 0.6, np.float32)
    glass = np.zeros(truth.shape, bool)
    glass[20:30, 20:30] = True
    raw = truth + np.float32(0.002)
    raw[glass] = 0.65  # 5 cm behind
    raw[20:25, 20:30] = 0  # half of the glass is missing
    raw[25, 20:25] = 0.58  # a tenth of the rest lies 2 cm in front
    raw[:, 100:] = 0
    truth[:, 90:] = 1.5  # beyond the range that is compared
    found = benchmark_script.errors(raw, truth, glass)
    assert found["glass_pixels"] == 100
    assert found["missing_inside"] == pytest.approx(0.5)
    assert found["bias_median_m"] == pytest.approx(0.05, abs=1e-6)
    assert found["bias_mean_m"] == pytest.approx(0.05 * 0.9 - 0.02 * 0.1, abs=1e-6)
    assert found["behind_1cm_share"] == pytest.approx(0.9)
    assert found["front_1cm_share"] == pytest.approx(0.1)
    assert found["missing_outside"] == 0
    assert found["outside_median_abs_m"] == pytest.approx(0.002, abs=1e-6)
    # The glass and a margin of three pixels on each side do not count as outside.
    assert found["outside_pixels"] == 64 * 90 - 16 * 16


def test_tables_and_walls_wear_wood_cloth_and_stone_alone(benchmark_script):
    camera = benchmark_script.real_camera(64, 36)
    seeds = range(1435, 1447)
    around = [benchmark_script.table_scene(seed, camera).contents.surroundings for seed in seeds]
    numbers = np.concatenate([each.texture for each in around])
    assert {FAMILIES[number % len(FAMILIES)].name for number in numbers} == {
        "wood",
        "plaid",
        "marble",
    }


def test_the_real_column_is_what_the_real_frames_give(benchmark_script, realdata):
    real = benchmark_script.real_frames(realdata / "cleargrasp_d435")
    assert [round(100 * frame["missing_inside"], 1) for frame in real] == [45.4, 74.6]
    assert [round(1000 * frame["bias_median_m"], 1) for frame in real] == [48.3, 16.6]
    kept = json.loads(RESULTS.read_text())["columns"]["real_table"]["each"]
    for frame, stored in zip(real, kept.values(), strict=True):
        for name, value in frame.items():
            assert value == pytest.approx(stored[name], rel=1e-6)


def test_the_kept_table_says_how_it_was_made():
    kept = json.loads(RESULTS.read_text())
    assert kept["seed"] != kept["tuned_on_seed"]
    assert kept["camera"]["baseline"] == 0.05
    assert kept["provenance"]["commit"]
    columns = kept["columns"]
    assert set(columns) == {"real_table", "simulated_table", "simulated_held", "analytic_held"}
    for column in columns.values():
        values = column["each"]
        values = list(values.values()) if isinstance(values, dict) else values
        shares = [frame["missing_inside"] for frame in values]
        assert column["frames"] == len(shares)
        assert column["missing_inside"]["median"] == pytest.approx(np.median(shares))


def test_the_kept_table_is_the_cameras_of_today(benchmark_script):
    """Who changes the camera measures it anew."""
    kept = json.loads(RESULTS.read_text())["camera"]
    today = json.loads(json.dumps(asdict(benchmark_script.StereoCamera())))
    assert kept == today
