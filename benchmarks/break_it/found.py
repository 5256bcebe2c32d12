"""Tables of other questions, and what was found by hand, one by one."""

# fmt: off
# ruff: noqa: E501

import json
from pathlib import Path
from typing import Any

from break_it.cases import (
    AGAIN,
    ATTEMPT,
    BOOK,
    CALIBRATE,
    COURSE,
    EVALUATE,
    EXECUTED,
    FOUND,
    GENERATE,
    HAND,
    HAND_MODEL,
    HANDOVER,
    HTML,
    HUGE,
    INF,
    LOG,
    NAN,
    NEAREST,
    NETWORK,
    PLUS,
    REPLAY,
    REPRODUCE,
    RESUME,
    SEQUENCE,
    TRAIN,
    VIEW,
    Call,
    Case,
)
from break_it.edits import DEEP

#: The same question of many files: the call, its kind and option, the file; how it is changed.
ARRAYS = {
    (NEAREST, "depth", "truth.npy"): (
        "np.dstack([a, a, a])", "a.astype(np.uint8)", "a.astype(bool)", "a > 0", "a[:0]", "a.T",
        "a.astype(complex)", "a.astype(str)", "a.astype(object)", "a[None]", "a.ravel()", "a * nan",
        "a * 0", "-a", "a + inf", "a * 1000", "a[::2]", "np.float32(1)", "a.astype('M8[s]')",
        "np.zeros((0, 0))", "a * 1e30", "a.astype(np.int64) - 5", "np.array([{}])"),
    (NEAREST, "truth", "truth.npy"): (
        "a * 1000", "-a", "a * 0", "a * nan", "np.dstack([a, a, a])", "a[::2]", "a > 0",
        "a.astype(complex)", "a + inf", "a.astype(str)", "a.astype(np.uint8)"),
    (NEAREST, "mask", "mask.npy"): (
        "a * nan", "a.astype(str)", "a[::2]", "a * 0 + 1", "np.dstack([a, a])", "a[:0]",
        "a.astype(complex)", "a.astype(object)", "a.astype('M8[s]')", "np.float64(1)", "a.T"),
    (HAND, "hand", "hand.npy"): (
        "a * 1000", "-a", "a * 0", "a * nan", "a[:20]", "a[:, :2]", "a.T", "a.astype(str)",
        "a.astype(complex)", "a.astype(object)", "a + inf", "a[None]", "a + 100", "a[[0] * 21]"),
    (NEAREST, "rgb", "rgb.png"): ("a[..., 0]", "a.astype(np.uint16)", "a[::2]", "a[:, :1]",
        "np.dstack([a, a[..., 0] * 0])", "np.dstack([a, np.eye(*a.shape[:2], dtype=np.uint8) + 254])"),
    (NEAREST, "depth", "depth.png"): (
        "a.astype(np.uint8)", "np.dstack([a, a, a])", "a[::2]", "a * 0", "a[:1, :1]"),
    (NEAREST, "mask", "mask.png"): ("a[::2]", "a * 0 + 255", "a[:1, :1]", "np.dstack([a, a, a, a])"),
    (HAND, "hand-mask", "arm.png"): ("a[::2]", "a[:1, :1]"),
}
#: Right camera files of others: what ROS prints, its calibration, OpenCV's FileStorage.
CAMERA_INFO = """header: {stamp: {sec: 1, nanosec: 2}, frame_id: camera}
height: 48
width: 64
distortion_model: plumb_bob
d: [0.0, 0.0, 0.0, 0.0, 0.0]
k: [80.0, 0.0, 31.5, 0.0, 80.0, 23.5, 0.0, 0.0, 1.0]
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [80.0, 0.0, 31.5, 0.0, 0.0, 80.0, 23.5, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}
---
"""
OPENCV = """%YAML:1.0
---
image_width: 64
image_height: 48
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [80., 0., 31.5, 0., 80., 23.5, 0., 0., 1.]
distortion_coefficients: !!opencv-matrix {rows: 1, cols: 5, dt: d, data: [0., 0., 0., 0., 0.]}
fisheye_model: 0
avg_reprojection_error: 3.2e-01
"""
CAMERAS = (
    "fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\n", "fx 80", "- 80\n- 80\n", "!!python/object/apply:os.system ['touch executed-yaml']\n",
    "fx: 80\nfy: 80\nfx: 90\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\n",
    "fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\nxres: 128\nyres: 96\n",
    "fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\nK: [[90, 0, 31], [0, 90, 23], [0, 0, 1]]\n",
    "fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\ndist: [-0.3, 0.1, 0, 0, 0]\n",
    "fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\ndistortion_coefficients: {data: [0.2, 0, 0, 0]}\n",
    "fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\nk1: 0.2\n",
    "fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 48\nheight: 64\n",
    "fx: .inf\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\n",
    "K: [[80, 0, 31], [0, 80, 23]]\nwidth: 64\nheight: 48\n",
    "K: [[80, 3, 31], [0, 80, 23], [0, 0, 1]]\nwidth: 64\nheight: 48\n",
    "K: [[80, 0, 31], [0, 80, 23], [0, 0, 1]]\n", "K: x\nwidth: 64\nheight: 48\n",
    "a: &a [1, 1]\nb: &b [*a, *a, *a, *a]\nc: &c [*b, *b, *b, *b]\nK: *c\nwidth: 64\nheight: 48\n",
    "fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\n---\nfx: 90\n", "\t\t:", "[" * 100_000,
    f"fx: {'9' * 400}\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\n",
    *(f"fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\n{more}\n" for more in (
        "model: fisheye", "distortion_model: equidistant", "camera_model: KANNALA_BRANDT", "projection: equirectangular",
        "skew: 50", "skew_c: 0.5", "depth_scale: 0.0001", "binning_x: 2", "R: [[0, 1, 0], [1, 0, 0], [0, 0, 1]]", "unit: mm")),
    *(CAMERA_INFO.replace(old, new) for old, new in (
        ("d: [0.0", "d: [0.1"), ("plumb_bob", "equidistant"), ("r: [1.0", "r: [0.9"), ("p: [80", "p: [90"),
        ("binning_x: 0", "binning_x: 2"), ("x_offset: 0", "x_offset: 8"), ("height: 0", "height: 24"), ("k: [80.0, ", "k: ["),
        ("k: [80.0", "k: [0.0"), ("roi: {", "roi: 7\nregion: {"), ("---\n", "---\nwidth: 64\n"))),
    *(OPENCV.replace(old, new) for old, new in (
        ("[0., 0.", "[-0.3, 0."), ("fisheye_model: 0", "fisheye_model: 1"), ("rows: 3", "rows: 4"), ("!!opencv", "!!python/object:os."),
        ("image_width: 64", "image_width: 128"), ("data: [80.", "given: [80."))),
    *(f"fx: {x}\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\n" for x in ("6:38", "1:20.0", "8_0", "0x50", "0b1010000", "0o120")),
    "fx: 2026-01-01\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\n",
)
HEADERS = (  # of an .npy
    "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000, 1000000000)}",
    "{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 48)}",
    "{'descr': '<f4', 'fortran_order': False, 'shape': (48, 6.5)}",
    "{'descr': '|O', 'fortran_order': False, 'shape': (48, 64)}",
    "{'descr': '|V8', 'fortran_order': False, 'shape': (48, 64)}",
    "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (1,)}",
    "__import__('os').system('touch executed-header')", "{", "{}", "(" * 3000,
    "{'descr': 7, 'fortran_order': False, 'shape': (1,)}", "[" * 100,
)
ANGLES = "Thumb|Index|Middle|Ring|Pinky"
#: Of a recording: the columns whose name has this, and what becomes of each number x.
COLUMNS = (
    ("Object_Position", "x * 1000"), ("Object_Position", "x + 100"), ("Object_Position", "nan"),
    ("Object_Position", "'left'"), ("Object_Position", "''"), ("Object_Position", "1e308"),
    ("Object_Rotation", "0"), ("Object_Rotation", "x * 7"), ("Object_Rotation", "nan"),
    (ANGLES, "500"), (ANGLES, "x / 57.3"), (ANGLES, "-x"), (ANGLES, "nan"), (ANGLES, "'x'"),
    (ANGLES, "1e308"), (ANGLES, "''"), ("Elapsed", "-x"), ("Elapsed", "0"), ("Elapsed", "nan"),
    ("Elapsed", "'noon'"), ("Elapsed", "1e308"),
)
NOTES = (
    ("object: 0000", "object: 9999"), ("object: 0000", "object: ../0000"), 
    ("side: left", "side: both"), ("scale: 1.0224", "scale: 0"), ("scale: 1.0224", "scale: -1"),
    ("scale: 1.0224", "scale: nan"), ("scale: 1.0224", "scale: big"), ("girth: 1.0247", "girth: x"),
    ("girth: 1.0247", "girth: inf"), ("44.77", "-44.77"), ("44.77", "NaN"), ("44.77", '"x"'),
    ("44.77", "4477"), ("44.77", DEEP), ('"thumb"', '"toe"'), ("# lengths: {", "# lengths: ["),
    ("# lengths: {", "# lengths: 7 {"), ("Thumb_MCP_Stretch", "Index_MCP_Stretch"),
    ("Thumb_MCP_Stretch", "Thumb"), ("Object_Rotation_W", "Object_Rotation_V"), ("Frame,", ",,,,"),
    ("# object: 0000\n", ""), ("# scale: 1.0224\n", ""), ("\n0,0,", '\n0,0,"'),
)
#: Forged headers of a run's log, whose checksum is right: the field and what stands there.
LOGS = (
    ("transitions", (None, 7, "x", [7], [["x", "y", "z", "w"]], [[0, "Nowhere", "Finished", ""]], "@DROP")),
    ("cautions", (None, 7, [7], [[None, None]], [["x", 1]], "@DROP")),
    ("format", (None, 99, "x", [], "@DROP")), ("config", (None, 7, [], {}, {"foo": 1}, "@DROP")),
    ("events", (None, 7, {}, [7], [[["foo"]]], "@DROP")),
    ("base_from_camera", (None, 7, [], [[1]], [[NAN] * 4] * 4, [[2] * 4] * 4, "@DROP")),
    ("odd_keypoints", (None, 7, "x", {"0": 7}, {"x": []}, "@DROP")),
)
LOG_ARRAYS = ("time", "taken", "confidence", "hand", "cloud", "keypoints", "points", "tool", "joints", "width", "servo")
TEST = "data/test/0000/depth"
#: Frames that are damaged: the file in the data folder, and the edit.
FRAMES = (
    *((f"{part}/{name}", ("replaced", "missing")) for part, name in (
        ("rgb", "000032.jpg"), ("depth_png", "000032.png"), ("log_json", "000032.json"),
        ("hand_kpt", "000032.txt"), ("obj_mask", "000032.png"), ("hand_mask", "000032.png"))),
    *((part, ("replaced", "missing")) for part in ("rgb", "depth_png", "log_json", "hand_kpt")),
    *((part, ("replaced", "folder")) for part in ("rgb", "depth_png", "log_json", "hand_kpt")),
    ("rgb/000099.jpg", ("text", "")), ("rgb/notes.txt", ("text", "mine")),
    ("rgb/000032.png", ("text", "twice")), ("rgb/000032.jpg", ("array", "a[::2]")),
    ("rgb/000032.jpg", ("array", "a[..., 0]")), ("depth_png/000032.png", ("array", "a[::2]")),
    ("depth_png/000032.png", ("array", "a.astype(np.uint8)")),
    ("depth_png/000032.png", ("array", "a * 0")), ("obj_mask/000032.png", ("array", "a * 0 + 255")),
    ("obj_mask/000032.png", ("array", "a * 0")), ("hand_mask/000032.png", ("array", "a[::2]")),
    *(("hand_kpt/000032.txt", ("text", text)) for text in
      ("", "x y\n" * 21, "1 2\n" * 20, "1\n" * 21, "nan nan\n" * 21, "1e400 1\n" * 21, "\x00")),
    *((f"{part}/000032.{kind}", ("noise", how, 1)) for how in ("cut", "junk", "zeros")
      for part, kind in (("rgb", "jpg"), ("depth_png", "png"), ("log_json", "json"),
                         ("obj_mask", "png"), ("raw_disparity", "png"), ("normals", "png"))),
    ("log_json/000032.json", ("replaced", "->000032.json")), ("rgb/000032.jpg", ("replaced", "->/dev/zero")),
    ("rgb/000032.jpg", ("replaced", "fifo")), ("log_json/000032.json", ("replaced", "fifo")),
)
#: The record that `hadr book --readme-times` reads: the field and what stands there.
TIMES = (
    ("", (None, [], {}, 7, "x", DEEP)), ("parameters", (None, [], {}, "@DROP")),
    ("parameters.preset", (None, "mini", 7, [])), ("chapters", (None, [], {}, 7, "@DROP")),
    ("chapters.03_ray_voxels", (None, [], {}, 7, "@DROP")),
    ("chapters.03_ray_voxels.duration_s", (None, "x", [], NAN, INF, -1, HUGE, True, "@DROP")),
    ("chapters.03_ray_voxels.machine", (None, [], {}, 7, "another", "a|b\n<script>", "@DROP")),
)


#: What `hadr view` reads of a result, and arrays that are none of it; fields of its report.
VIEWED = {
    "report.json": (), "cloud.ply": (), "mask.png": ("a[::2]", "a.astype(np.uint16)"),
    "depth.npy": ("a[::2]", "a.astype(np.uint8)", "a * 0", "a * nan", "np.dstack([a, a])", "a.astype(object)"),
    "confidence.npy": ("a[::2]", "a.astype(str)", "np.float64(1)"),
}
REPORT = (
    ("", (None, [], 7, "x", DEEP)), ("command", (None, 7, "x", [], "@DROP")), ("method_title", ("@DROP",)),
    ("intrinsics", (None, [], {}, 7, "@DROP")), ("intrinsics.fx", (None, "x", -1, NAN, HUGE, "@DROP")),
    ("intrinsics.width", (None, 1.5, 10**7, 63, "@DROP")),
)
WHEEL = "wheels/mediapipe-0.10.21-cp311-cp311-manylinux_2_17_x86_64.whl"
#: Frames whose logs are of another unit or camera than their pictures: the field, and the factor.
LOG_IN_TRAINING = "data/train/0000/depth/log_json/000000.json"
LABELS = (
    ("hand_keypoint", 1000), ("hand_keypoint", 100), ("hand_keypoint", 10), ("hand_keypoint", 0.1), ("camera point", 1000),
    ("camera point", 10), ("camera angle", 0.0174533), ("depth_png scale", 10), ("depth_png scale", 0.1),
    ("camera internal", [[2.5], [2.5], [1]]), ("camera internal", [[0.5], [0.5], [1]]),
)


def many() -> list[Case]:
    """The cases of this module's tables."""
    made: list[Case] = []

    def add(call: Call, kind: str, name: str, *edits: Any, **more: Any) -> None:
        made.append(call.case(kind, name, *edits, **more))

    for (call, option, file), expressions in ARRAYS.items():
        for e in expressions:
            add(call, "array", f"{option} {file}: {e}", (file, "array", e), **{option: file},
                says=(option, file, "colour"))
    for name, e in (("swapped", "a[[0, *range(5, 9), *range(1, 5), *range(9, 21)]]"), ("reversed", "a[[0, *range(20, 0, -1)]]"),
                    ("mirrored", "a * [-1, 1, 1]"), ("shuffled", "np.random.default_rng(0).permutation(a)")):
        for call in (HAND, PLUS):  # used, with a note, and no probability
            add(call, "hand's form", name, ("hand.npy", "array", e), hand="hand.npy", expect="safe")
    for text in CAMERAS:
        add(NEAREST, "camera", repr(text[-60:]), ("camera.yaml", "text", text), intrinsics="camera.yaml",
            says=("camera.yaml",))
    for text in HEADERS:
        for option in ("depth", "truth", "mask"):
            add(NEAREST, "header", f"{option}: {text[:60]}", ("truth.npy", "header", text),
                **{option: "truth.npy"}, says=("truth.npy",))
    for part, expression in COLUMNS:
        file = "recordings/0000.csv"
        add(GENERATE, "recording", f"{part} = {expression}", (file, "column", part, expression),
            says=("0000.csv", "0000-above"))
    for old, new in NOTES:
        edit = ("recordings/0000.csv", "swap", old, new)
        add(GENERATE, "recording", f"{old!r} -> {new[:30]!r}", edit, says=("0000.csv", "0000-above"))
    for name, values in LOGS:
        for value in values:
            add(REPLAY, "log", f"{name} = {value!r}", ("log.npz", "log", name, value), says=("log.npz",))
    for name in LOG_ARRAYS:
        for e in ("a[:3]", "a * nan", "a.astype(str)", "a[:0]", "np.float64(1)"):
            add(REPLAY, "log", f"{name}: {e}", ("log.npz", "log_array", name, e), says=("log.npz",))
    for file, edit in FRAMES:
        for call in (EVALUATE,):
            corruption = "sensor" if "raw" in file else None
            harmless = edit == ("array", "a * 0") or "notes" in file
            add(call, "data", f"{file}: {' '.join(map(str, edit))[:50]!r}", (f"{TEST}/{file}", *edit),
                says=("000032", "000099", file.split("/")[0], "frame notes", "shows an object"), corruption=corruption,
                expect="safe" if harmless or "normals" in file else "refused")
    for name, values in TIMES:
        for value in values:
            add(BOOK, "times", f"{name or 'all'} = {str(value)[:30]}",
                ("build/results.json", "field", name, value), says=("results.json",))
    for file, expressions in VIEWED.items():
        for wrong in ("missing", "folder", "loop", "fifo", "->/dev/null", "->/dev/zero"):
            add(VIEW, "wrong file", f"{file}: {wrong}", (f"restored/{file}", "replaced", wrong), says=(file, "restored"))
        for how in ("cut", "junk", "zeros", "hole", "flip"):
            add(VIEW, "noise", f"{file}: {how}", (f"restored/{file}", "noise", how, 1), says=(file, "restored"),
                expect="safe" if how == "flip" or (how, file) == ("hole", "report.json") else "refused")
        for e in expressions:
            add(VIEW, "array", f"{file}: {e}", (f"restored/{file}", "array", e), says=(file, "restored"))
    for name, values in REPORT:
        for value in values:
            add(VIEW, "field", f"{name or 'all'} = {str(value)[:30]}", ("restored/report.json", "field", name, value),
                says=("report.json", "restored"))
    for wrong in ("missing", "folder", "pickle", "copy ../rgb.png"):
        add(HAND_MODEL, "wrong file", f"the wheel: {wrong}", (WHEEL, "replaced", wrong), says=("mediapipe",))
    for how, n in (("cut", 0), ("cut", 2), ("cut", 4), ("junk", 0), ("zeros", 0), ("hole", 0), ("flip", 0), ("flip", 1)):
        add(HAND_MODEL, "noise", f"the wheel: {how} {n}", (WHEEL, "noise", how, n), says=("mediapipe",))
    for name, factor in LABELS:
        for call, file in ((EVALUATE, LOG), (TRAIN, LOG_IN_TRAINING)):
            add(call, "labels", f"{name} times {str(factor)[:30]}", (file, "scaled", name, factor), says=(Path(file).stem,))
    for how in ("nan", "flip"):
        for call, file in ((NETWORK, "net.safetensors"), (PLUS, "plus.safetensors"), (FOUND, "seg.safetensors"),
                           (FOUND, "kpt.safetensors"), (EVALUATE, "net.safetensors"),
                           (CALIBRATE, "plus.safetensors"), (RESUME, "run/last.safetensors")):
            add(call, "weights", f"{file}: {how}", (file, "weights", how), says=(file,))
        add(TRAIN, "weights", f"--start-from: {how}", ("net.safetensors", "weights", how),
            start_from="net.safetensors", says=("net.safetensors",))
    for old, new in (('"center": .-?', '"center": [9'), ('"depth_m": .0.', '"depth_m": [0.0'), ('"name": "', '"name": "x')):
        add(PLUS, "record", f"{old} -> {new}", ("plus.safetensors", "record", old, new), says=("plus.safetensors",))
    for name in ("", "/book", "/results", "/hadr", "/notebooks/text", "/data_samples", "/.."):
        for call, option in ((HTML, "build"), (COURSE, "out"), (REPRODUCE, "out")):
            add(call, "sources", f"--{option} {name or '.'}", **{option: f"{{checkout}}{name}"},
                says=(option, "checkout", name or "."))
    return made


SMALL = {"fx": 80, "fy": 80, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
FINGER = [[0.01 * n, 0, 0.5] for n in range(21)]
FOUND_ONE_BY_ONE = [
    *many(),
    *(NEAREST.case("camera", f"{name}, as it should be", ("camera.yaml", "text", text), intrinsics="camera.yaml",
                   expect="works") for name, text in (("camera_info", CAMERA_INFO), ("two messages", CAMERA_INFO * 2),
                                                      ("OpenCV's", OPENCV), ("upper case", CAMERA_INFO.replace("k:", "K:")))),
    *(NEAREST.case("picture", f"a JPEG with a blot {n}", ("rgb.jpg", "noise", "blot", n), rgb="rgb.jpg", says=("rgb.jpg",))
      for n in range(6)),
    *(NEAREST.case("picture", f"{file} turned by EXIF {n}", (file, "turned", n), rgb=file, says=("orientation",))
      for file in ("rgb.jpg", "rgb.png") for n in (3, 6, 8)),
    *(NEAREST.case("noted", f"a picture of nothing: {e}", ("rgb.png", "array", e), expect="noted",
                   says=("shows nothing",)) for e in ("a * 0", "a * 0 + 200", "a // 60")),
    *(call.case("noted", f"depth {e}", ("depth.png", "array", e), expect="noted", says=("would measure",))
      for call, e in ((NEAREST, "a // 10"), (NEAREST, "a * 10"), (NETWORK, "a // 10"))),
    *(NEAREST.case("noted", f"camera: {name}", ("camera.json", "text", json.dumps(SMALL | changed)), expect="noted",
                   says=("odd camera",)) for name, changed in (
        ("fx and cx swapped", {"fx": 31.5, "cx": 80}), ("cx and cy swapped", {"cx": 23.5, "cy": 31.5}),
        ("of twice the size", {"fx": 160, "fy": 160}), ("fx and fy swapped", {"fx": 80, "fy": 60}))),
    *(call.case("noted", f"colour: {e}", ("rgb.png", "array", e), expect="noted", says=("redder than blue",))
      for call in (NETWORK, PLUS) for e in ("a[..., ::-1]", "a[..., [1, 1, 1]]")),
    *(call.case("picture", "the mask is inverted", ("mask.png", "array", "255 - a"), says=("inverted",))
      for call in (NEAREST, HAND, NETWORK)),
    NEAREST.case("together", "--checkpoint of no network", checkpoint="net.safetensors", says=("--checkpoint",)),
    NETWORK.case("noted", "a segmentation without use", segmentation="seg.safetensors", expect="noted", says=("not used",)),
    *(NEAREST.case("loss", f"--overwrite of {name}, edited", (f"restored/{name}", "text", "mine"), overwrite="", out="restored",
                   says=(name,)) for name in ("depth.png", "cloud.ply", "view.html", "hand.json")),
    *(VIEW.case("loss", f"{name} was edited", (f"restored/{name}", "text", "mine"), says=(name,))
      for name in ("depth.npy", "mask.png", "confidence.npy", "cloud.ply")),
    NEAREST.case("loss", "--overwrite of report.json without its checksum", ("restored/report.json", "field", "sha256", "@DROP"),
                 overwrite="", out="restored", says=("restored",)),
    NEAREST.case("loss", "--overwrite of a report of mine", ("out/report.json", "text", '{"command": "hadr restore", "my": "diary"}'),
                 overwrite="", says=("out",)),
    EVALUATE.case("loss", "--out is somebody's", ("result.json", "text", '{"split": "x", "given": 1, "frames": [1]}'),
                  out="result.json", says=("result.json",)),
    NEAREST.case("noted", "a hand without use", hand="hand.json", expect="noted", says=("does not look at the hand",)),
    NEAREST.case("noted", "a hand mask without use", hand_mask="arm.png", expect="noted", says=("the hand mask",)),
    NETWORK.case("noted", "a finder without use", keypoint_network="kpt.safetensors", expect="noted", says=("not used",)),
    NEAREST.case("noted", "the truth of another frame", ("truth.npy", "array", "a * 1.2"), truth="truth.npy", expect="noted",
                 says=("of this frame",)),
    NEAREST.case("loss", "--overwrite of report.json, edited", ("restored/report.json", "field", "method", "mine"), overwrite="",
                 out="restored", says=("restored",)),
    *(call.case("place", f"--{option}: where nothing can be", **{option: "/proc/x"}, says=("'/proc/x'",))
      for call, option in ((NEAREST, "out"), (GENERATE, "out"), (TRAIN, "out"), (EVALUATE, "out"), (COURSE, "out"))
      if Path("/proc/self").exists()),
    *(NEAREST.case("picture", f"mask of {kind} named .png", ("mask.png", "lossy", kind), says=("mask",))
      for kind in (".jpg", ".webp")),
    *(NEAREST.case("picture", f"EXR with {c}", ("d.exr", "exr", c), depth="d.exr", says=("d.exr",))
      for c in ("A", "XY")),
    *(NEAREST.case("picture", f"{o}: a PNG of {w}x{h}", (f"{o}.png", "size", w, h), says=(f"{o}.png",))
      for o in ("rgb", "depth", "mask") for w, h in ((100000, 100000), (2**31 - 1, 1), (0, 48))),
    NEAREST.case("picture", "an .npy that begins with PK", ("truth.npy", "bytes", "504b0304" + "00" * 60),
                 depth="truth.npy", says=("truth.npy",)),
    NEAREST.case("picture", "mask of nothing", ("mask.png", "array", "a * 0"), expect="safe"),
    # Folders of frames that are not what they are taken for.
    TRAIN.case("labels", "masks swapped", ("data/train/0000/depth/hand_mask", "swapped", "obj_mask"), says=("swapped",)),
    *(call.case("labels", "the same frames twice", ("same", "tree", "data"), says=("same",), **{o: old + "data\tsame"})
      for call, o, old in ((EVALUATE, "data", ""), (TRAIN, "data", ""), (CALIBRATE, "", "plus.safetensors\t"))),
    CALIBRATE.case("labels", "a single frame", **{"": "plus.safetensors\tfew"}, says=("split train", "split val")),
    RESUME.case("resume", "a picture has changed", ("data/train/0000/depth/rgb/000000.jpg", "array", "a[:, ::-1]"), epochs="3",
                says=("frames_sha256",)),
    EVALUATE.case("loss", "--out is a training's file to come", ("busy/last.json", "locked"), out="busy/last.json", says=("busy",)),
    CALIBRATE.case("loss", "a training has the checkpoint's folder", ("plus.safetensors", "locked"), says=("taken by hadr train",)),
    SEQUENCE.case("place", "a frame is named sequence.json", *((f"frames/{part}/sequence.json.png", "replaced", "copy 1.png")
                  for part in ("rgb", "depth", "mask")), says=("sequence.json",)),
    NEAREST.case("noted", "the truth is the input", depth="truth.npy", truth="truth.npy", expect="noted", says=("itself",)),
    *(HAND.case("field", f"a hand's {word}", ("hand.json", "text", f'{{"keypoints": {FINGER}, "{word}": 1}}'), hand="hand.json",
                says=(word,)) for word in ("scale", "units", "depth_scale", "side")),
    # What `hadr view` and `hadr hand-model` would replace, and a wheel with another network.
    VIEW.case("loss", "view.html is mine", ("restored/view.html", "text", "mine"), says=("view.html",)),
    VIEW.case("loss", "--out is the report", out="restored/report.json", says=("report.json",)),
    HAND_MODEL.case("weights", "another network", says=("SHA-256",)),
    HAND_MODEL.case("loss", "--out is another model", ("hand.task", "text", "mine"),
                    says=("hand.task",)),
    # An output never replaces what is not its own.
    EVALUATE.case("loss", "--out is the checkpoint", out="net.safetensors", says=("net.safetensors",)),
    EVALUATE.case("loss", "--out is the checkpoint's record", ("net.json", "text", "{}"), out="net.json",
                  says=("net.json",)),
    EVALUATE.case("loss", "--out is a frame", out="data/generation.json", says=("generation.json",)),
    CALIBRATE.case("loss", "--out is the checkpoint", out="plus.safetensors", may=("plus.json",), says=("plus.safetensors",)),
    ATTEMPT.case("loss", "--json is somebody's", ("t.json", "text", "mine"), json="t.json",
                  says=("t.json",)),
    NEAREST.case("loss", "--out is where the depth is", ("in/depth.png", "replaced", "copy ../depth.png"),
                 depth="in/depth.png", out="in", overwrite="", says=("in",)),
    NEAREST.case("loss", "--overwrite of others' files", ("out/depth.png", "text", "mine"), overwrite="",
                 says=("out",)),
    NEAREST.case("loss", "--overwrite with more files", ("out/notes.txt", "text", "mine"), overwrite="",
                 says=("notes.txt",)),
    GENERATE.case("loss", "again, with my files in it", ("made/train/0000/depth/my_labels/labels.csv",
                  "text", "mine"), ("made/README.txt", "text", "mine"),
                  ("made/test/0000/depth/rgb/README.txt", "text", "mine"), out="made", expect="safe", makes=("made",)),
    GENERATE.case("loss", "again, another seed", out="made", seed="5", says=("seed",)),
    GENERATE.case("loss", "into a folder of mine", ("taken/notes.txt", "text", "mine"), out="taken",
                  expect="safe", makes=("taken",)),
    GENERATE.case("loss", "two folders", **{"": "other"}, says=("--out",)),
    TRAIN.case("loss", "into a training's folder", out="run", says=("run",)),
    TRAIN.case("loss", "best.json of mine", ("out/best.json", "text", "mine"), says=("out", "best")),
    COURSE.case("loss", "into a folder of mine", ("out/notes.txt", "text", "mine"), says=("out",)),
    COURSE.case("loss", "into pages of mine", ("out/student/03_ray_voxels.ipynb", "text", "mine"),
                says=("out",)),
    BOOK.case("loss", "no build", build="nowhere", says=("nowhere",)),
    # A training that goes on from what is not its own.
    RESUME.case("resume", "nothing there", out="fresh", says=("fresh", "resume")),
    RESUME.case("resume", "best in place of last", ("run/last.safetensors", "replaced",
                "copy best.safetensors"), ("run/last.json", "replaced", "copy best.json"),
                epochs="3", says=("last.safetensors", "resume")),
    RESUME.case("resume", "another network", network="hadr-plus", says=("hadr-plus", "network")),
    RESUME.case("resume", "last is missing", ("run/last.safetensors", "replaced", "missing"), epochs="3",
                says=("last",)),
    RESUME.case("resume", "fewer epochs", ("run/last.safetensors", "field", "epochs", 9), says=("epochs",)),
    *(RESUME.case("resume", f"{f} of last = {str(v)[:20]}", ("run/last.safetensors", "field", f, v), epochs="3",
                  says=("last", f)) for f, values in (
        ("history", (None, [], {}, [7], "x", "@DROP")), ("epochs", (None, "x", -1, HUGE, "@DROP")),
        ("score", (None, 7, "x", "@DROP")), ("preset", (None, 7, [], {}, "@DROP")),
        ("seed", (None, "x", 99, "@DROP"))) for v in values),
    *(RESUME.case("resume", f"last.json: {text[:20]!r}", ("run/last.json", "text", text), epochs="2",
                  says=("last.json",), expect="safe") for text in ("", "[]", "null", "{", DEEP, '{"preset": 7}')),
    RESUME.case("resume", "with --start-from", start_from="net.safetensors", says=("--start-from",)),
    TRAIN.case("resume", "--start-from another", start_from="plus.safetensors", says=("plus",)),
    # What a network is asked that it can't do.
    NETWORK.case("network", "no hand", hand=None, method="hadr", says=("hand",)),
    NETWORK.case("network", "another kind", method="hadr-plus", says=("hadr-plus",)),
    NETWORK.case("network", "a segmentation", checkpoint="seg.safetensors", says=("seg",)),
    FOUND.case("network", "segmentation is depth's", segmentation="net.safetensors", says=("net",)),
    FOUND.case("network", "keypoints is depth's", keypoint_network="net.safetensors", says=("net",)),
    HAND.case("network", "hand-median without hand", hand=None, says=("hand",)),
    EVALUATE.case("network", "masks from keypoints", masks="kpt.safetensors", says=("kpt",)),
    CALIBRATE.case("network", "a segmentation", **{"": "seg.safetensors\tdata"}, says=("seg",)),
    # Options that don't go together.
    HANDOVER.case("together", "--out and --replay", replay="log.npz", says=("--replay",)),
    COURSE.case("together", "--no-slides and --executed", executed="build", says=("--executed",)),
    GENERATE.case("together", "--sensor and --no-sensor", sensor="", no_sensor="", says=("--sensor",)),
    TRAIN.case("together", "--hand of another network", network="hadr-plus", hand="2d", says=("hadr-plus",)),
    TRAIN.case("together", "--pretrained of hadr-plus", network="hadr-plus", pretrained="x", says=("--pretrained",)),
    TRAIN.case("together", "--masks of a segmentation", network="segmentation", masks="seg.safetensors",
               says=("segmentation",)),
    # Result files that are right by their checksum and wrong by their content.
    *(AGAIN.case("sealed", f"{f} = {str(v)[:30]}", ("result.json", "sealed", f, v), says=("result.json", "nearest"))
      for f, values in (("rows", (None, [], {}, [7], "x")), ("rows.0", (None, 7, [], {})), 
                        ("rows.0.method", (None, 7, [], "foo", "@DROP"))) for v in values),
    *(HTML.case("loss", f"--build holds {file} of mine", (f"others/{file}", "text", "mine"), build="others",
                says=("others",)) for file in ("executed/03_ray_voxels.ipynb", "html/_build/site.html", "html/build.log",
                                               "results/03_ray_voxels/results.json", "notes.txt")),
    # Among the frames of a data set, or in a result, nothing else is written.
    *(call.case("loss", f"--{option} among frames", **{option: f"{root}/train/x{end}"}, says=("among the frames",))
      for call, option, end, root in ((TRAIN, "out", "", "data"), (GENERATE, "out", "", "made"), (NEAREST, "out", "", "made"),
                                      (EVALUATE, "out", ".json", "made"), (CALIBRATE, "out", ".json", "data"))),
    *(VIEW.case("loss", f"--out {place}", out=place, says=(place,)) for place in ("restored/x.html", "page.png", "page")),
    *(call.case("loss", f"--{option} in a result", **{option: f"restored/{place}"}, says=("restored",)) for call, option, place in (
        (NEAREST, "out", "deeper"), (TRAIN, "out", ""), (GENERATE, "out", "more"), (EVALUATE, "out", "t.json"))),
    CALIBRATE.case("labels", "frames of another training", ("plus.safetensors", "field", "data", {"frames_sha256": "0" * 64}),
                   says=("other frames",)),
    PLUS.case("noted", "a hollow mask", ("mask.png", "array", "np.where(np.pad(a[2:-2, 2:-2], 2) & np.roll(a, 3, 0) & np.roll(a, -3, 0)"
              " & np.roll(a, 3, 1) & np.roll(a, -3, 1), 0, a)"), expect="noted", says=("hollow",)),
    SEQUENCE.case("together", "Thumbs.db among the pictures", ("frames/rgb/Thumbs.db", "text", "x"), expect="works"),
    NEAREST.case("loss", "a folder of mine where it is written first", (".out.hadr/draft/thesis.txt", "text", "mine"),
                 says=("somebody's own",)),
    ATTEMPT.case("loss", "--json is an attempt's record", json="attempt/perfect/0005-902.json", says=("attempts' own",)),
    NEAREST.case("noted", "settings of matplotlib in the folder", ("matplotlibrc", "text", "text.usetex: True"), expect="works"),
    EVALUATE.case("together", "a network twice", **{"": "net.safetensors\tnet.safetensors"}, says=("named twice",)),
    *(VIEW.case("sealed", f"{f} = {v}", ("restored/report.json", "sealed", f, v), says=("report.json", f))
      for f, values in (("outputs", (None, [], 7)), ("method_title", (7, None)), ("intrinsics", (None, [], 7))) for v in values),
    # Notebooks that are none.
    *(call.case("notebook", name, ("build/executed/03_ray_voxels.ipynb", "text", text), says=("03_ray_voxels",))
      for call in (HTML, EXECUTED) for name, text in (
          ("empty", ""), ("a list", "[]"), ("null", "null"), ("old", '{"nbformat": 99, "cells": []}'),
          ("cells = 7", '{"nbformat": 4, "nbformat_minor": 5, "metadata": {}, "cells": 7}'), ("deep", DEEP))),
    HTML.case("notebook", "missing", ("build/executed/03_ray_voxels.ipynb", "replaced", "missing"),
              says=("03_ray_voxels",)),
]
