import re
from dataclasses import replace

import numpy as np
import pytest

from hadr.synthesis.holding.hold import check_hold, make_hold
from hadr.synthesis.recordings.motion import failing_rows, main, record_hold, write_recordings
from hadr.synthesis.recordings.recording import find_recordings, read_recording, write_recording


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    list(write_recordings(folder, ["0001"], 2))
    return folder


def test_every_row_of_a_made_recording_passes_and_none_repeats(made):
    paths = find_recordings(made)
    assert [p.name for p in paths] == ["0001-stem-0000.csv", "0001-side-0001.csv"]
    for path in paths:
        recording = read_recording(path)
        assert len(recording.time) == 20
        assert recording.time[-1] == pytest.approx(1.9)
        assert next(failing_rows(recording), None) is None
        assert (np.abs(np.diff(recording.angles, axis=0)).max(1) > 1e-4).all()
        assert np.rad2deg(np.ptp(recording.angles, axis=0)).max() < 25
        turns = recording.wrist_from_object[:, :3, :3]
        eyes = np.tile(np.eye(3), (20, 1, 1))
        np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), eyes, atol=1e-9)
        hold = recording.at(7)
        assert hold.hold_id == recording.hold_id
        assert not check_hold(hold).problems
        np.testing.assert_array_equal(hold.angles, recording.angles[7])
        assert len(hold.touching) >= 3
    with pytest.raises(IndexError, match="row 20 of 0001-side-0001, which has 20 rows"):
        recording.at(20)


def test_making_recordings_goes_on_where_it_stopped(made, tmp_path, capsys):
    first = {p.name: p.read_bytes() for p in find_recordings(made)}
    kept = made / "0001" / "0001-stem-0000.csv"
    target = tmp_path / "0001" / kept.name
    target.parent.mkdir()
    target.write_bytes(kept.read_bytes())
    main(["--out", str(tmp_path), "--holds", "2", "--objects", "0001"])
    assert "2 recordings, 1 of them made now" in capsys.readouterr().out
    assert {p.name: p.read_bytes() for p in find_recordings(tmp_path)} == first
    with pytest.raises(ValueError, match="has recordings of seed 0, not 1: name another folder"):
        next(write_recordings(tmp_path, ["0001"], 3, seed=1))


def test_the_check_finds_a_pushed_object(made, tmp_path, capsys):
    recording = read_recording(find_recordings(made)[1])
    poses = recording.wrist_from_object.copy()
    poses[3, 2, 3] -= 0.01
    write_recording(replace(recording, wrist_from_object=poses), tmp_path / "pushed.csv")
    with pytest.raises(SystemExit, match="1"):
        main(["--out", str(tmp_path), "--check"])
    said = capsys.readouterr().out
    assert re.search(r"pushed\.csv row 4: .*mm deep in the glass", said)
    assert len(said.strip().splitlines()) == 1


def test_errors_of_making():
    hold = make_hold("0001", 0)
    with pytest.raises(ValueError, match=r"need at least two rows, got 0 s at 10\.0 Hz"):
        record_hold(hold, seconds=0)
    with pytest.raises(ValueError, match="0001-stem-0000 is no good hold: no two fingers"):
        record_hold(replace(hold, angles=np.zeros(20)))
