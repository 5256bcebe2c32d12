"""Camera files in all their forms, and what is refused in them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from hadr.camera import Intrinsics
from hadr.camera_file import load_intrinsics

CAMERA = Intrinsics(fx=40.0, fy=50.0, cx=3.0, cy=1.5, width=8, height=4)


def test_load_intrinsics_in_four_forms(tmp_path: Path) -> None:
    named = tmp_path / "camera.json"
    named.write_text(json.dumps(CAMERA.to_dict()))
    matrix = tmp_path / "matrix.yml"
    matrix.write_text("K: [[40, 0, 3], [0, 50, 1.5], [0, 0, 1]]\nwidth: 8\nheight: 4\n")
    sized = tmp_path / "camera.yaml"
    sized.write_text("xres: 8\nyres: 4\nfx: 40\nfy: 50\ncx: 3\ncy: 1.5\n")
    sdk = tmp_path / "camera.txt"
    sdk.write_text("fx: 40\nfy: 50\nppx: 3\nppy: 1.5\nwidth: 8\nheight: 4\ncoeffs: [0, 0.0, 0]\n")
    forms = (named, matrix, str(sized), sdk)
    assert [load_intrinsics(form) for form in forms] == [CAMERA] * 4


ROS_1 = """\
header:
  seq: 7
  stamp: {secs: 1, nsecs: 2}
  frame_id: "camera_color_optical_frame"
height: 4
width: 8
distortion_model: "plumb_bob"
D: [0.0, 0.0, 0.0, 0.0, 0.0]
K: [40.0, 0.0, 3.0, 0.0, 50.0, 1.5, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [40.0, 0.0, 3.0, 0.0, 0.0, 50.0, 1.5, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: False}
---
"""


def rows(values: list[float]) -> str:
    return "".join(f"- {x}\n" for x in values)


ROS_2 = (
    "header:\n  stamp:\n    sec: 1\n    nanosec: 2\n  frame_id: camera\nheight: 4\nwidth: 8\n"
    f"distortion_model: rational_polynomial\nd:\n{rows([0.0] * 8)}"
    f"k:\n{rows([40.0, 0, 3, 0, 50, 1.5, 0, 0, 1])}r:\n{rows([1.0, 0, 0, 0, 1, 0, 0, 0, 1])}"
    f"p:\n{rows([0.0] * 12)}binning_x: 1\nbinning_y: 1\n"
    "roi:\n  x_offset: 0\n  y_offset: 0\n  height: 4\n  width: 8\n  do_rectify: false\n---\n"
)
CALIBRATION = """\
image_width: 8
image_height: 4
camera_name: head_camera
camera_matrix: {rows: 3, cols: 3, data: [40., 0., 3., 0., 50., 1.5, 0., 0., 1.]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0., 0., 0., 0., 0.]}
rectification_matrix: {rows: 3, cols: 3, data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]}
projection_matrix: {rows: 3, cols: 4, data: [40., 0., 3., -2., 0., 50., 1.5, 0., 0., 0., 1., 0.]}
"""


@pytest.mark.parametrize(
    "text",
    [ROS_1, ROS_1 + ROS_1.replace("seq: 7", "seq: 8"), ROS_2, CALIBRATION],
    ids=["ROS 1", "two messages", "ROS 2", "camera_calibration"],
)
def test_the_cameras_of_ros(tmp_path: Path, text: str) -> None:
    (tmp_path / "camera.yaml").write_text(text)
    assert load_intrinsics(tmp_path / "camera.yaml") == CAMERA


@pytest.mark.parametrize("name", ["camera.yml", "camera.yaml", "camera.json"])
def test_what_opencv_writes(tmp_path: Path, name: str) -> None:
    storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Fri 13 Nov 2026 14:41:15")
    storage.write("image_width", 8)
    storage.write("image_height", 4)
    storage.write("flags", 0)
    storage.write("fisheye_model", 0)
    storage.write("camera_matrix", CAMERA.matrix)
    storage.write("distortion_coefficients", np.zeros((1, 5)))
    storage.write("avg_reprojection_error", 1e-5)
    storage.release()
    assert load_intrinsics(tmp_path / name) == CAMERA


NAMED = "fy: 80\ncx: 3\ncy: 1\nwidth: 8\nheight: 4\n"


def test_a_plain_lens_notes_and_what_is_told_twice_alike(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    more = (
        "xres: 8\nyres: 4\ndistortion_model: plumb_bob\nD: [0, 0.0, 0]\ndist: {cols: 5, data: [0]}"
        "\ncamera_name: D435\nmodel: null\nskew: 0.0\nfps: 30"
    )
    path.write_text(f"{NAMED}fx: 80\nK: [[80, 0, 3], [0, 80, 1], [0, 0, 1]]\n{more}")
    assert load_intrinsics(path) == Intrinsics(80, 80, 3, 1, 8, 4)


@pytest.mark.parametrize("number", ["0640", "64e1", "+640", "640.", "!!int 0640", "!!float 640"])
def test_numbers_are_those_of_yaml_1_2(tmp_path: Path, number: str) -> None:
    (tmp_path / "a.yaml").write_text(f"{NAMED}fx: {number}")
    assert load_intrinsics(tmp_path / "a.yaml").fx == 640


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "{fx: ", "neither valid YAML nor JSON"),
        ("a.yaml", "[1, 2, 3]", "must hold named values"),
        ("a.json", '{"fx": 1, "fy": 1, "cx": 0}', "lack cy, width, height"),
        ("a.json", '{"K": [[1,0,0],[0,1,0],[0,0,1]], "width": 4}', "lack height"),
        ("a.json", '{"a": ' * 100_000, "neither valid YAML nor JSON"),
        ("a.yaml", "[" * 100_000, "neither valid YAML nor JSON"),
        ("a.json", '{"fx": 1, "fx": 2}', "the name 'fx' stands there twice"),
        ("a.yaml", "fx: 1\nfx: 2", "the name 'fx' stands there twice"),
        ("a.yaml", NAMED + "fx: wide", "fx must be a number, got 'wide'"),
        ("a.yaml", NAMED + "fx: true", "fx must be a number, got True"),
        ("a.yaml", NAMED + f"fx: {10**400}", "fx must be a number, got 1000"),
        ("a.yaml", NAMED + "fx: 6:38", "fx must be a number, got '6:38'"),
        ("a.yaml", NAMED + "fx: 80\n---\nfx: 9", "2 cameras stand there, which differ"),
        ("a.yaml", ROS_1.replace("P: [40", "P: [44"), "fx is 40.0, but also 44.0"),
        ("a.yaml", ROS_1.replace("R: [1.0, 0.0", "R: [0.9, 0.1"), "R = .* turns the camera"),
        ("a.yaml", ROS_1.replace("binning_x: 0", "binning_x: 2"), "binning_x = 2: the numbers are"),
        ("a.yaml", ROS_1.replace("x_offset: 0", "x_offset: 2"), "roi: x_offset = 2: the image is"),
        ("a.yaml", ROS_1.replace("D: [0.0", "D: [-1.0e-02"), r"the lens distorts \(D = "),
        ("a.yaml", ROS_1.replace("K: [40.0, ", "K: ["), r"K must have shape \(3, 3\), got \(8,\)"),
        ("a.yaml", ROS_2.replace("width: 8\nd", "width: 9\nd"), "roi: width = 8: the image is"),
        ("a.yaml", ROS_2.replace("\nroi:", "\nroi: 7\n_:"), "roi must hold named values, got 7"),
        ("a.yaml", CALIBRATION.replace("rows: 3", "rows: 4"), "K must have 3 rows and 3 cols, got"),
        (
            "a.yaml",
            CALIBRATION.replace(", data: [40", ", given: [40"),
            r"K must have shape \(3, 3\)",
        ),
        ("a.yaml", "fx: !!python/name:os.system", "neither valid YAML nor JSON"),
        ("a.yaml", NAMED + "fx: 80\nxres: 128", "width is 8, but also 128"),
        ("a.yaml", NAMED + "fx: 80\nK: [[9, 0, 3], [0, 9, 1], [0, 0, 1]]", "fx is 80, but also 9"),
        ("a.yaml", NAMED + "fx: 80\nk1: 0.2", r"the lens distorts \(k1 = 0.2\), .* undistorted"),
        ("a.yaml", NAMED + "fx: 80\nD: [0, 0, 0, 0, 1.0e-3]", r"the lens distorts \(D = "),
        ("a.yaml", NAMED + "fx: 80\ndistortion: {rows: 1, data: [1]}", "the lens distorts"),
        ("a.yaml", NAMED + "fx: 80\nmodel: fisheye", r"no pinhole \(model = 'fisheye'\)"),
        ("a.yaml", NAMED + "fx: 80\ndistortion_model: equidistant", "the camera is no pinhole"),
        ("a.yaml", NAMED + "fx: 80\ncamera_type: 3", "the camera is no pinhole"),
        ("a.yaml", NAMED + "fx: 80\nD: {data: [0, 0], k1: 0.3}", "the lens distorts"),
        ("a.yaml", NAMED + "fx: 80\nroi: {x: 10}", "roi: 'x' is not understood"),
        ("a.yaml", NAMED + "fx: !!int 6:38", "neither valid YAML nor JSON: '6:38' is no number"),
        ("a.yaml", NAMED + "fx: 80\nskew: 50", r"has a skew \(skew = 50\)"),
        ("a.yaml", NAMED + "fx: 80\ndepth_scale: 0.1", "depth_scale = 0.1 is not understood"),
    ],
)
def test_bad_intrinsics_files(tmp_path: Path, name: str, text: str, message: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        load_intrinsics(path)
    assert name in str(caught.value)


def test_missing_intrinsics_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"intrinsics file .*nowhere\.yaml does not exist"):
        load_intrinsics(tmp_path / "nowhere.yaml")


def test_cleargrasp_intrinsics(realdata: Path) -> None:
    camera = load_intrinsics(realdata / "cleargrasp_d435" / "camera_intrinsics.yaml")
    assert camera == Intrinsics(921.0, 921.0, 642.0, 359.0, 1280, 720)
