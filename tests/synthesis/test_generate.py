import argparse

import numpy as np
import pytest

from hadr.data.transhand import TransHand, frame_log_path
from hadr.synthesis.generate import (
    add_arguments,
    frame_recipe,
    generate,
    render_frame,
    run,
)

SIZE = {"width": 64, "height": 36, "quality": "fast"}


def contents(root):
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in root.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def six(tmp_path_factory):
    root = tmp_path_factory.mktemp("six")
    generate(root, 6, objects=["0000", "0004"], **SIZE)
    return root


def test_the_same_seed_gives_the_same_bytes_whatever_the_number_and_the_workers(six, tmp_path):
    generate(tmp_path, 8, objects=["0000", "0004"], workers=2, **SIZE)
    first, longer = contents(six), contents(tmp_path)
    assert len(first) == 6 * 8 + 1  # eight files a frame, and the settings
    for name, data in first.items():
        assert longer[name] == data, name


def test_a_run_goes_on_where_it_ended(six, tmp_path):
    generate(tmp_path, 3, objects=["0000", "0004"], **SIZE)
    recipe = frame_recipe(1, objects=["0000", "0004"])
    frame_log_path(tmp_path, recipe.split, recipe.object_id, recipe.stem).unlink()
    report = generate(tmp_path, 6, objects=["0000", "0004"], **SIZE)
    assert (report.written, report.kept) == (4, 2)
    assert contents(tmp_path) == contents(six)
    assert "4 frames written, 2 kept" in str(report)


def test_another_seed_gives_other_frames():
    recipe = frame_recipe(0)
    first, other = (render_frame(recipe, seed=s, **SIZE) for s in (0, 1))
    assert np.abs(first.depth - other.depth).mean() > 0.01


def test_two_frames_of_a_hold_share_the_hand_in_the_wrist_frame_only():
    a, b = (render_frame(frame_recipe(i, objects=["0000"]), **SIZE) for i in (0, 1))
    assert a.hold_id == b.hold_id
    lengths = [np.linalg.norm(f.keypoints - f.keypoints[0], axis=1) for f in (a, b)]
    np.testing.assert_allclose(lengths[0], lengths[1], atol=1e-9)
    assert np.abs(a.keypoints - b.keypoints).max() > 0.02


def test_size_changes_pixels_not_geometry():
    small = render_frame(frame_recipe(3), width=64, height=36, quality="fast")
    large = render_frame(frame_recipe(3), width=128, height=72, quality="fast")
    np.testing.assert_allclose(small.keypoints, large.keypoints, atol=1e-12)
    np.testing.assert_array_equal(small.world_from_camera, large.world_from_camera)


def test_splits_by_frame_holding_and_object():
    by_hold = [frame_recipe(i, objects=["0000"]) for i in range(40)]
    holds = {}
    for recipe in by_hold:
        holds.setdefault(recipe.hold_number, set()).add(recipe.split)
    assert all(len(s) == 1 for s in holds.values())
    assert [r.split for r in by_hold].count("train") == 28
    by_object = [frame_recipe(i, split_by="object") for i in range(16)]
    assert {r.object_id for r in by_object if r.split == "test"} == {"0004", "0007"}
    by_frame = [frame_recipe(i, split_by="frame").split for i in range(1000)]
    assert by_frame.count("train") == pytest.approx(700, abs=50)
    assert by_frame.count("test") == pytest.approx(100, abs=35)


def test_the_command_writes_frames(tmp_path, capsys):
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    line = f"{tmp_path} -n 2 --width 64 --height 36 --quality fast --depth png --jpeg 90"
    assert run(parser.parse_args(line.split())) == 0
    assert "2 frames written" in capsys.readouterr().out
    frame = TransHand(tmp_path, "train")[0]
    assert frame.color.shape == (36, 64, 3)


def test_errors(tmp_path):
    with pytest.raises(ValueError, match="n_frames and workers must be positive, got 0 and 1"):
        generate(tmp_path, 0)
    with pytest.raises(ValueError, match="no object '0002'"):
        generate(tmp_path, 1, objects=["0002"])
    with pytest.raises(
        ValueError, match="split_by must be 'holding', 'frame' or 'object', got 'x'"
    ):
        generate(tmp_path, 1, split_by="x")
    with pytest.raises(ValueError, match="quality must be 'fast' or 'fine', got 'nice'"):
        render_frame(frame_recipe(0), quality="nice")
    with pytest.raises(ValueError, match="at least 16x9 pixels, got 4x4"):
        render_frame(frame_recipe(0), width=4, height=4)
