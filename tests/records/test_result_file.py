import hashlib
import json

import pytest

from hadr.records.result_file import (
    digest,
    read_result_file,
    read_result_files,
    read_sealed,
    seal_row,
    write_result_file,
    write_sealed,
)

ROWS = [
    {"method": "hadr", "split": "known", "rmse_m": 0.0123, "seeds": [0, 1]},
    {"method": "hadr", "split": "unknown", "rmse_m": float("nan"), "seeds": [0]},
]


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "deep" / "table.json"
    write_result_file(path, "a trial", ROWS, {"commit": "abc", "versions": {"torch": "2"}})
    return path


def test_what_is_written_is_read(written):
    found = read_result_file(written)
    assert found.what == "a trial"
    assert found.row(method="hadr", split="known")["rmse_m"] == 0.0123
    assert found.row(split="unknown")["rmse_m"] is None
    assert found.provenance["commit"] == "abc"
    assert [p.name for p in written.parent.iterdir()] == ["table.json"]


def test_the_digest_is_that_of_sorted_compact_json():
    assert digest({"b": 1, "a": "é"}) == hashlib.sha256('{"a":"é","b":1}'.encode()).hexdigest()


@pytest.mark.parametrize(
    ("old", "new"),
    [("0.0123", "0.0122"), ('"abc"', '"abd"'), ("a trial", "a triumph"), ('"known"', '"Known"')],
)
def test_a_file_edited_by_hand_is_noticed(written, old, new):
    text = written.read_text(encoding="utf-8")
    assert text.count(old) == 1
    written.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ValueError, match="was changed after it was measured"):
        read_result_file(written)


def test_layout_and_order_of_keys_may_change(written):
    content = json.loads(written.read_text(encoding="utf-8"))
    turned = dict(reversed(content.items()))
    written.write_text(json.dumps(turned), encoding="utf-8")
    assert read_result_file(written).rows[0]["method"] == "hadr"


def test_a_file_written_again_is_signed_again(written):
    found = read_result_file(written)
    write_result_file(written, "again", found.rows[:1], found.provenance)
    assert read_result_file(written).what == "again"


def test_what_was_changed_since_is_kept_when_it_is_written_again(written, tmp_path, capsys):
    row = tmp_path / "row.json"
    for path, write in (
        (written, lambda: write_result_file(written, "again", [{"a": 1}], {})),
        (row, lambda: seal_row(row, {"a": 1})),
    ):
        for number in ("", "2"):
            write()
            write()  # as it was written: nothing to keep
            path.write_text(f"mine{number}")
            write()
            kept = path.with_name(f"{path.name}.changed{number}")
            assert kept.read_text() == f"mine{number}"
            assert f"it is kept as {kept}" in capsys.readouterr().err
        assert len(list(path.parent.glob(f"{path.name}.changed*"))) == 2


def test_a_row_must_be_the_only_one(written):
    found = read_result_file(written)
    with pytest.raises(KeyError, match="2 of 2 rows have method = 'hadr'"):
        found.row(method="hadr")
    with pytest.raises(KeyError, match="0 of 2 rows have method = 'lidf'"):
        found.row(method="lidf")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", " is not valid JSON"),
        ("[]", r": must be named values, got \[\]"),
        ('{"rows": []}', ": lacks provenance"),
        ('{"what": 1, "provenance": {}}', ": provenance: lacks sha256"),
    ],
)
def test_other_files_are_named(tmp_path, text, said):
    path = tmp_path / "other.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=rf"other\.json{said}"):
        read_result_file(path)


def test_nothing_measured_is_an_error(tmp_path):
    with pytest.raises(ValueError, match="no rows"):
        write_result_file(tmp_path / "t.json", "nothing", [], {})
    with pytest.raises(FileNotFoundError, match="no result file"):
        read_result_file(tmp_path / "t.json")


def test_several_files_are_read_as_one(tmp_path):
    for name, error in (("known", 0.01), ("unknown", 0.02)):
        row = {"method": "hadr", "split": name, "rmse_m": error}
        write_result_file(tmp_path / f"{name}.json", name, [row], {"commit": name})
    both = read_result_files(tmp_path, "known", "unknown")
    assert both.row(method="hadr", split="unknown")["rmse_m"] == 0.02
    assert both.provenance["commit"] == "known"
    with pytest.raises(FileNotFoundError):
        read_result_files(tmp_path, "known", "ablation")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("null", "NaN", "NaN or infinity, which is not JSON"),
        ('"what"', '"what": "something else", "what"', "the name 'what' stands there twice"),
    ],
)
def test_what_another_reader_would_read_otherwise_is_refused(written, old, new, said):
    text = written.read_text(encoding="utf-8")
    assert old in text
    written.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ValueError, match=said):
        read_result_file(written)


def test_numbers_of_any_form_are_sealed(tmp_path):
    path = tmp_path / "times.json"
    content = {"times": {"swin": [0.1, 0.2]}, "provenance": {"commit": "abc", "sha256": "stale"}}
    write_sealed(path, content)
    found = read_sealed(path)
    assert found["times"] == {"swin": [0.1, 0.2]}
    assert found["provenance"]["sha256"] == digest(
        {"times": {"swin": [0.1, 0.2]}, "provenance": {"commit": "abc"}}
    )


def test_what_has_no_provenance_is_not_sealed(tmp_path):
    with pytest.raises(KeyError, match="provenance"):
        write_sealed(tmp_path / "times.json", {"times": []})
    assert not list(tmp_path.iterdir())
