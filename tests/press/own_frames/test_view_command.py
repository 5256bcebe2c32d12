"""The page of a restored cloud: what it shows, and what it refuses."""

import base64
import hashlib
import json
import re
import shutil

import cv2
import numpy as np
import pytest

from hadr.cli import main
from hadr.press.own_frames import view_command
from hadr.press.own_frames.view_command import clouds
from hadr.records.result_file import seal_row

HOLE = (slice(10, 30), slice(20, 40))


@pytest.fixture(scope="module")
def restored(tmp_path_factory):
    """A hole in a plane at 0.6 m, filled, with a wall at 3 m in the upper rows."""
    folder = tmp_path_factory.mktemp("view")
    depth = np.full((48, 64), 600, np.uint16)
    depth[:5] = 3000
    depth[HOLE] = 0
    color = np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    for name, image in (("rgb", color), ("depth", depth), ("mask", (depth == 0) * np.uint8(255))):
        cv2.imwrite(str(folder / f"{name}.png"), image)
    (folder / "camera.json").write_text(
        json.dumps({"fx": 80, "fy": 80, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48})
    )
    words = [f"--{name}={folder / f'{name}.png'}" for name in ("rgb", "depth", "mask")]
    words += [f"--intrinsics={folder / 'camera.json'}", f"--out={folder / 'out'}", "--quiet"]
    assert main(["restore", *words]) == 0
    return folder


def test_the_restored_points_are_told_from_the_measured_ones(restored):
    whole, marked, without = clouds(restored / "out")
    assert len(whole.points) - len(without.points) == 400
    assert whole.points[:, 2].max() < 0.7, "the wall is left out"
    np.testing.assert_allclose(whole.center, [-0.015, -0.03, 0.6], atol=1e-6)
    assert whole.spacing == pytest.approx(0.6 / 80)
    picture = cv2.imread(str(restored / "rgb.png"))[..., ::-1]
    middle = np.argmin(np.linalg.norm(whole.points - whole.center, axis=1))
    assert whole.colors[middle].tolist() in picture[18:22, 28:32].reshape(-1, 3).tolist()
    same = (marked.colors == whole.colors).all(axis=1)
    np.testing.assert_array_equal(whole.points[same], without.points)


def test_one_page_is_written_and_opened(restored, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(view_command.webbrowser, "open", lambda uri: asked.append(uri) or True)
    monkeypatch.setenv("DISPLAY", ":0")
    out, page = restored / "out", restored / "out" / "view.html"
    assert main(["view", str(out)]) == 0
    assert asked == [page.as_uri()]
    text = page.read_text()
    assert "<title>hadr view: out</title>" in text
    assert not re.search(r"https?://", text)
    data = json.loads(re.search(r"const DATA = (\{.*?\});\n", text, re.DOTALL).group(1))
    shown = clouds(out)[0]
    stored = data["scenes"][0]["points"]
    grid = np.frombuffer(base64.b64decode(data["arrays"][stored["positions"]]), "<u2")
    points = np.array(stored["low"]) + stored["step"] * grid.reshape(-1, 3)
    x, y, z = shown.points.T
    np.testing.assert_allclose(points, np.stack([x, z, -y], axis=1), atol=1e-5)
    assert main(["view", str(out), "--no-browser"]) == 0  # again, over its own page
    assert len(asked) == 1
    assert "open it in a browser" in capsys.readouterr().out
    again = ["restore", *(f"--{n}={restored / n}.png" for n in ("rgb", "depth", "mask"))]
    again += [f"--intrinsics={restored / 'camera.json'}", f"--out={out}", "--overwrite"]
    page.write_text(text.replace("<title>hadr view: out", "<title>hadr view: mine"))
    assert main(["view", str(out), "--no-browser"]) == main(again) == 2
    errors = capsys.readouterr().err
    assert "view.html is no page of this command, or was changed since" in errors
    assert "holds view.html, which no run like this one wrote, or which was changed since" in errors
    page.write_text(text)
    assert main(again) == 0
    assert not page.exists(), "it showed the former result"


def test_what_is_no_result_or_no_page_of_its_own_is_refused(restored, tmp_path, capsys):
    assert main(["view", str(restored)]) == 2
    assert "holds no result of 'hadr restore'" in capsys.readouterr().err
    out = restored / "out"
    (tmp_path / "thesis.html").write_text("years of work")
    assert main(["view", str(out), "--no-browser", "--out", str(tmp_path / "thesis.html")]) == 2
    assert (tmp_path / "thesis.html").read_text() == "years of work"
    for name, damage in (
        ("cloud.ply", b"ply\nnothing"),
        ("report.json", b'{"command": "hadr restore"}'),
        ("mask.png", cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].tobytes()),
    ):
        shutil.copytree(out, tmp_path / name, dirs_exist_ok=True)
        (tmp_path / name / name).write_bytes(damage)
        capsys.readouterr()
        assert main(["view", str(tmp_path / name), "--no-browser"]) == 2
        assert re.search("or (was|one that was) changed since", capsys.readouterr().err)
        assert not (tmp_path / name / "view.html").exists()


def test_a_record_that_does_not_fit_its_files_is_named(restored, tmp_path, capsys):
    out = restored / "out"
    report = json.loads((out / "report.json").read_text())
    masks = cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].tobytes()
    other = {**report["outputs"], "mask.png": {"sha256": hashlib.sha256(masks).hexdigest()}}
    for number, (changes, words) in enumerate(
        (
            ({"outputs": {}}, "depth.npy is missing, or was changed since"),
            ({"outputs": None}, "report.json: outputs"),
            ({"method_title": 7}, "report.json: method_title"),
            ({"outputs": other}, "depth, mask, confidence and cloud are not of one frame"),
        )
    ):
        folder = tmp_path / str(number)
        shutil.copytree(out, folder)
        (folder / "mask.png").write_bytes(masks)
        record = {name: value for name, value in report.items() if name != "sha256"}
        seal_row(folder / "report.json", record | changes)
        capsys.readouterr()
        assert main(["view", str(folder), "--no-browser"]) == 2
        assert words in capsys.readouterr().err


def test_a_frame_with_nothing_to_restore_shows_one_cloud(restored, tmp_path):
    cv2.imwrite(str(tmp_path / "full.png"), np.full((48, 64), 600, np.uint16))
    words = [f"--rgb={restored / 'rgb.png'}", f"--depth={tmp_path / 'full.png'}", "--quiet"]
    words += [f"--intrinsics={restored / 'camera.json'}", f"--out={tmp_path / 'out'}"]
    assert main(["restore", *words]) == 0
    assert [cloud.name for cloud in clouds(tmp_path / "out")] == ["restored"]
