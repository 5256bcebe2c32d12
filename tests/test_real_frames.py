"""The table of real frames: its script on cases made by hand, and on the frames where they are."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from hadr.camera import Intrinsics
from hadr.camera_file import load_intrinsics
from hadr.records.result_file import read_result_file
from hadr.restoration import restore

REPOSITORY = Path(__file__).resolve().parents[1]
RESULTS = REPOSITORY / "results" / "real" / "cleargrasp_d435.json"


@pytest.fixture(scope="module")
def script(load_benchmark) -> ModuleType:
    return load_benchmark("cameras/real_frames")


def test_a_stand_in_hand_keeps_its_form_and_holds_the_glass_at_the_tables_depth(script) -> None:
    camera = Intrinsics(100.0, 120.0, 79.5, 59.5, 160, 120)
    glass = np.zeros(camera.shape, bool)
    glass[50:71, 100:121] = True  # its middle is the pixel (110, 60)
    known = np.full(camera.shape, 0.8, np.float32)
    known[:, :60] = 2.0  # a wall, far from the glass
    known[glass] = 0
    relative = np.random.default_rng(0).normal(0, 0.04, (21, 3))
    hand = script.place_beside(relative, glass, known, camera)
    moved = hand - relative
    np.testing.assert_allclose(moved, np.broadcast_to(moved[0], (21, 3)), atol=1e-12)
    expected = ((110 - 79.5) / 100 * 0.8, (60 - 59.5) / 120 * 0.8, 0.8)
    np.testing.assert_allclose(moved[0], expected, atol=1e-6)


def test_glasses_are_the_parts_of_the_mask_without_specks(script) -> None:
    mask = np.zeros((100, 100), bool)
    mask[10:40, 10:40] = mask[60:90, 60:90] = True
    mask[50, 50] = True
    assert [int(part.sum()) for part in script.glasses(mask)] == [900, 900]


def test_scores_inside_where_measured_and_outside(script) -> None:
    truth = np.full((10, 10), 0.5, np.float32)
    truth[0] = 0  # unknown
    raw = truth + np.float32(0.01)
    raw[0] = 0
    mask = np.zeros((10, 10), bool)
    mask[4:6] = True
    raw[4] = 0
    depth = raw.copy()
    depth[4], depth[5] = 0.54, 0.52
    found = script.score(depth, raw, truth, mask)
    assert found["rmse_m"] == pytest.approx(np.sqrt((0.04**2 + 0.02**2) / 2), rel=1e-4)
    assert found["where_measured"]["rmse_m"] == pytest.approx(0.02, rel=1e-4)
    assert found["coverage"] == 1
    outside = found["outside"]
    assert outside["changed_pixels"] == 0
    assert outside["rmse_m"] == outside["raw_rmse_m"] == pytest.approx(0.01, rel=1e-4)
    depth[9, 9] = 0.9
    assert script.score(depth, raw, truth, mask)["outside"]["changed_pixels"] == 1


def test_the_mean_over_hands_keeps_its_range(script) -> None:
    names = ("rmse_m", "rel", "mae_m", "delta_105", "delta_110", "delta_125", "coverage")
    rows = [
        {**dict.fromkeys(names, value), "where_measured": dict.fromkeys(names, 2 * value)}
        | {"pixels": 7, "outside": {}}
        for value in (0.1, 0.4)
    ]
    mean = script.mean_row(rows)
    assert (mean["rmse_m"], mean["rmse_low_m"], mean["rmse_high_m"]) == (0.25, 0.1, 0.4)
    assert mean["where_measured"]["mae_m"] == 0.5
    assert mean["hands"] == 2


def test_the_kept_table_is_whole_and_nothing_changes_outside_the_mask() -> None:
    kept = read_result_file(RESULTS)
    scenes = kept.provenance["scenes"]
    assert len(scenes) == 2
    for row in kept.rows:
        assert row["outside"]["changed_pixels"] == 0
        assert row["outside"]["rmse_m"] == row["outside"]["raw_rmse_m"]
    for scene, lessons in scenes.items():
        assert "needs 21 hand keypoints" in lessons["note_of_restore"]
        methods = {row["method"] for row in kept.rows if row["scene"] == scene}
        learned = {
            f"{network}{of}, stand-in hand"
            for network in ("HADR", "HADR-plus")
            for of in ("", " of the handover")
        }
        assert methods == {"raw", "inpainting", "nearest"} | learned


@pytest.mark.parametrize("scene", ["000000080", "000000130"])
def test_the_kept_table_is_what_the_frames_give(script, realdata, scene) -> None:
    folder = realdata / "cleargrasp_d435"
    color, raw, truth, mask = script.read_scene(folder, scene)
    camera = load_intrinsics(folder / "camera_intrinsics.yaml")
    result = restore(color, raw, camera, mask)
    np.testing.assert_array_equal(result.depth[~mask], raw[~mask])
    kept = read_result_file(RESULTS)
    for method, depth in (("raw", raw), (result.method, result.depth)):
        found = script.score(depth, raw, truth, mask)
        stored = kept.row(method=method, scene=scene)
        assert found["rmse_m"] == pytest.approx(stored["rmse_m"], rel=1e-6)
        assert found["where_measured"]["rmse_m"] == pytest.approx(
            stored["where_measured"]["rmse_m"], rel=1e-6
        )
