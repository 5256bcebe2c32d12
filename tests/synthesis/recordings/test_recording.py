import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hadr.hand import ANGLE_LIMITS, FINGERS, HandShape
from hadr.synthesis.glass.objects import OBJECTS
from hadr.synthesis.holding.hold import check_hold, hold_kind
from hadr.synthesis.recordings.recording import (
    Recording,
    find_recordings,
    read_recording,
    recording_text,
    write_recording,
)

NOTES = "# object: 0000\n# kind: side\n# scale: 1.0\n"
POSE = "Object_Position_X,Object_Position_Y,Object_Position_Z"
POSE += ",Object_Rotation_W,Object_Rotation_X,Object_Rotation_Y,Object_Rotation_Z"
# The columns of a MANUS Core export of one hand's joint angles, and two of its rows' form.
MANUS = (
    "Frame,Elapsed_Time_In_Milliseconds,Time,Thumb_CMC_Spread,Thumb_CMC_Flex,Thumb_PIP_Flex,"
    "Thumb_DIP_Flex,Index_MCP_Spread,Index_MCP_Flex,Index_PIP_Flex,Index_DIP_Flex,"
    "Middle_MCP_Spread,Middle_MCP_Flex,Middle_PIP_Flex,Middle_DIP_Flex,Ring_MCP_Spread,"
    "Ring_MCP_Flex,Ring_PIP_Flex,Ring_DIP_Flex,Pinky_MCP_Spread,Pinky_MCP_Flex,Pinky_PIP_Flex,"
    "Pinky_DIP_Flex"
)
FIRST = [7.5, 52.25, 13.5, 7.0, -8.75, 55.5, 40, 25, -6.5, 57.5, 34.75, 22.0]
FIRST += [-7.5, 86.75, 41.5, 26.5, -17.75, 78.25, 24.75, 15.75]


def _manus_rows(delimiter=",", decimal="."):
    rows = []
    for frame in range(3):
        cells = [str(frame), f"{41.66667 * frame:.5f}", f"03:08:42:{2042 + 83 * frame}"]
        cells += [f"{v + frame:.6f}" for v in FIRST]
        rows.append(delimiter.join(c.replace(".", decimal) for c in cells))
    return rows


def _recording(rows=5):
    rng = np.random.default_rng(2)
    poses = np.tile(np.eye(4), (rows, 1, 1))
    poses[:, :3, 3] = rng.uniform(-0.2, 0.2, (rows, 3)).round(5)
    angles = np.deg2rad(rng.uniform(-10, 40, (rows, 20)).round(2))
    time = np.arange(rows) / 10
    return Recording("0001-stem-0007", "0001", "stem", HandShape("left", 0.95), time, angles, poses)


def test_an_export_is_read_unchanged_with_its_sheets_beside_it(tmp_path):
    """Header line, clock column, no placement inside: all that is added lies in other files."""
    export = tmp_path / "session_1.csv"
    export.write_text("\n".join([MANUS, *_manus_rows()]) + "\n")
    notes = {"object": "0008", "kind": "handle", "scale": 0.98, "side": "right"}
    (tmp_path / "session_1.json").write_text(json.dumps(notes))
    pose = f"Elapsed_Time_In_Milliseconds,{POSE}\n0,0.1,0,0.05,1,0,0,0\n100,0.2,0,0.05,1,0,0,0\n"
    (tmp_path / "session_1.placement.csv").write_text(pose)
    recording = read_recording(export)
    assert recording.hold_id == "session_1"
    assert recording.kind == "handle"
    np.testing.assert_allclose(recording.time, [0, 0.04166667, 0.08333334])
    np.testing.assert_allclose(np.rad2deg(recording.angles[0]), FIRST, atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(recording.angles[2]), np.add(FIRST, 2), atol=1e-9)
    x = recording.wrist_from_object[:, 0, 3]
    np.testing.assert_allclose(x, [0.1, 0.14166667, 0.18333334], atol=1e-9)
    # the sheet's clock is the export's, wherever the sheet begins
    later = pose.replace("\n100,0.2", "\n50,0.15").replace("\n0,0.1,", "\n-50,0.05,")
    (tmp_path / "session_1.placement.csv").write_text(later)
    x = read_recording(export).wrist_from_object[:, 0, 3]
    np.testing.assert_allclose(x, [0.1, 0.14166667, 0.15], atol=1e-9)
    apart = pose.replace("\n0,0.1,", "\n5000,0.1,").replace("\n100,0.2,", "\n6000,0.2,")
    (tmp_path / "session_1.placement.csv").write_text(apart)
    with pytest.raises(ValueError, match=r"5 to 6 s, session_1\.csv .* must have one clock"):
        read_recording(export)
    assert find_recordings(tmp_path) == [export]


def test_both_hands_semicolons_decimal_commas_and_a_preamble(tmp_path):
    names = MANUS.split(",")
    both = names[:3] + [f"{side}_{n}" for side in ("Left", "Right") for n in names[3:]]
    rows = []
    for row in _manus_rows():
        cells = row.split(",")
        half = [f"{float(c) / 2:.6f}" for c in cells[3:]]
        rows.append(";".join(c.replace(".", ",") for c in [*cells[:3], *half, *cells[3:]]))
    preamble = "MANUS Core;3.1.0\nProfile;someone\n\n"
    header = "# object: 0005\n# kind: tips\n# scale: 1\n"
    text = header + preamble + ";".join(both) + ";\n" + ";\n".join(rows) + ";\n"
    (tmp_path / "two.placement.csv").write_text(f"Time_s,{POSE}\n0,0,0.1,0.05,0,1,0,0\n")
    path = tmp_path / "two.csv"
    for side, factor in (("right", 1), ("left", 0.5)):
        path.write_text(f"# side: {side}\n" + text, encoding="utf-8-sig")
        recording = read_recording(path)
        assert recording.shape.side == side
        np.testing.assert_allclose(np.rad2deg(recording.angles[0]), factor * np.array(FIRST))
        np.testing.assert_allclose(recording.wrist_from_object[1, :3, :3], np.diag([1, -1, -1]))
    path.write_text(text)
    with pytest.raises(ValueError, match="does not say which hand holds: add '# side: right'"):
        read_recording(path)


def test_what_a_glove_does_not_know_is_asked_for(tmp_path):
    path = tmp_path / "export.csv"
    text = "\n".join([MANUS, *_manus_rows()])
    path.write_text(text)
    with pytest.raises(ValueError, match=r"does not say object, kind, scale: add comment lines"):
        read_recording(path)
    path.write_text(NOTES + "# side: right\n" + text)
    message = r"where the object is: add the columns Object_Pos.* file export\.placement\.csv"
    with pytest.raises(ValueError, match=message):
        read_recording(path)
    path.write_text("# object: 9999\n# kind: x\n# scale: 1\n" + text)
    with pytest.raises(ValueError, match="no object '9999'"):
        read_recording(path)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["right", "left"]), st.booleans())
def test_writing_then_reading_gives_the_same(tmp_path_factory, seed, side, own_sizes):
    rng = np.random.default_rng(seed)
    recording = _recording()
    shape = HandShape(side, round(float(rng.uniform(0.88, 1.07)), 4))
    if own_sizes:
        sizes = rng.uniform(20, 50, (len(FINGERS), 3)).round(2) / 1000
        lengths = {f: tuple(map(float, size)) for f, size in zip(FINGERS, sizes, strict=True)}
        degrees = dict(zip(shape.fan, rng.uniform(-20, 20, 4).round(2), strict=True))
        fan = {finger: float(np.deg2rad(angle)) for finger, angle in degrees.items()}
        shape = replace(shape, lengths=lengths, girth=0.97, fan=fan)
    recording = replace(recording, shape=shape)
    path = tmp_path_factory.mktemp("r") / "a" / "x.csv"
    write_recording(recording, path)
    again = read_recording(path)
    assert (again.hold_id, again.object_id, again.kind) == ("0001-stem-0007", "0001", "stem")
    assert again.shape == shape
    np.testing.assert_allclose(again.time, recording.time)
    np.testing.assert_allclose(again.angles, recording.angles, atol=1e-12)
    np.testing.assert_allclose(again.wrist_from_object, recording.wrist_from_object, atol=1e-12)
    assert [p.name for p in path.parent.iterdir()] == ["x.csv"]


def _broken(change):
    lines = recording_text(_recording()).splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("Frame"))
    return "\n".join(change(lines, start)) + "\n"


def _set(lines, line, column, value):
    cells = lines[line].split(",")
    cells[column] = value
    lines[line] = ",".join(cells)
    return lines


_LENGTHS = (
    '# lengths: {"thumb": [44, 34, 27], '
    + ", ".join(f'"{finger}": [40, 30, 20]' for finger in FINGERS if finger != "thumb")
    + "}"
)


def _times(lines, start, columns, factor):
    for line in range(start + 1, len(lines)):
        for column in columns:
            cell = float(lines[line].split(",")[column])
            _set(lines, line, column, f"{cell * factor:.6f}")
    return lines


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, s: _set(t, s + 2, 8, "abc"), r"row 2 \(line 8\), column Index_PIP_.*: 'abc"),
        (lambda t, s: _set(t, s + 1, 5, ""), r"row 1 \(line 7\), column Thumb_IP_.*: '' is not"),
        (lambda t, s: _set(t, s + 1, 5, "nan"), r"column Thumb_IP_Stretch: 'nan' is not a finite"),
        (lambda t, s: _set(t, s + 3, 25, "2"), r"row 3 \(line 9\).*a quaternion of length"),
        (lambda t, s: _set(t, s + 3, 1, "50"), r"row 3 \(line 9\): time does not grow"),
        (lambda t, s: [*t[:-1], t[-1][:40]], r"row 5 \(line 11\) has \d+ cells, the header 29"),
        (lambda t, s: t[: s + 1], "has a header but no rows"),
        (lambda t, s: t[:s], "has no header with joint angles, such as Index_MCP_Stretch"),
        (lambda t, s: [r.replace("Pinky_DIP_Stretch", "Other") for r in t], "lacks 1 angles of"),
        (lambda t, s: [r.replace("Rotation_Z", "Other") for r in t], "say Object_Rotation_Z: add"),
        (lambda t, s: [r.replace("Elapsed_Time", "Other") for r in t], "has no time: expected"),
        (lambda t, s: [r.replace("Ring_MCP_S", "Index_MCP_S") for r in t], "both the index_mcp"),
        (lambda t, s: _set(t, s + 2, 8, "500"), r"row 2 .*Index_PIP_.*: no joint bends to 500"),
        (lambda t, s: _set(t, s + 2, 8, "-61"), r"row 2 .*Index_PIP_.*: no joint bends to -61"),
        (lambda t, s: _times(t, s, range(2, 22), 0.0174), "in degrees, not radians"),
        (lambda t, s: _times(t, s, range(22, 25), 1000), r"row 1 .*no hand reaches .*metres\?"),
        (lambda t, s: [_LENGTHS.replace("44", "-44"), *t], r"broken\.csv: lengths of the th"),
        (lambda t, s: ["# lengths: [", *t], r"broken\.csv: lengths is not valid JSON"),
        (lambda t, s: ['# fan: {"index": 3}', *t], r"broken\.csv: fan must give index, middle, r"),
        (lambda t, s: ["# girth: big", *t], r"broken\.csv: girth must be a number, got 'big'"),
        (lambda t, s: [r.replace("Position_Z", "Position_X") for r in t], "column Obj.* twice"),
    ],
)
def test_broken_files_are_named_with_row_and_column(tmp_path, change, message):
    path = tmp_path / "broken.csv"
    path.write_text(_broken(change))
    with pytest.raises(ValueError, match=message):
        read_recording(path)


COMMITTED = Path(__file__).parents[3] / "data_samples" / "recordings"


def test_the_recordings_of_the_project_are_thirty_of_each_object():
    paths = find_recordings(COMMITTED)
    assert len(paths) == 240
    names = [p.stem for p in paths]
    for object_id in OBJECTS:
        own = [n for n in names if n.startswith(object_id)]
        assert own == [f"{object_id}-{hold_kind(object_id, n)}-{n:04d}" for n in range(30)]
    assert sum(p.stat().st_size for p in paths) < 2.5e6


@pytest.mark.parametrize("object_id", list(OBJECTS))
def test_all_sixty_four_recorded_kinds_pass_at_a_moment(object_id):
    sides = set()
    for path in find_recordings(COMMITTED / object_id)[:8]:
        recording = read_recording(path)
        hold = recording.at(13)
        report = check_hold(hold)
        assert report.problems == (), path.name
        assert hold.kind == hold_kind(object_id, int(path.stem[-4:]))
        assert (recording.angles >= ANGLE_LIMITS[:, 0]).all()
        assert (recording.angles <= ANGLE_LIMITS[:, 1]).all()
        sides.add(hold.shape.side)
    assert sides == {"left", "right"}
