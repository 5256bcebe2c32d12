from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from hadr.models.hadr import HADR
from hadr.training.checkpoints import load_checkpoint, save_checkpoint, update_record
from hadr.training.recipe import Preset

SIZE = {"width": 32, "height": 24}


def test_round_trip_and_the_record_beside_it(tmp_path, micro, frames):
    model = HADR(micro.model).eval()
    path = tmp_path / "deep" / "net.safetensors"
    save_checkpoint(path, model, {**SIZE, "note": "ä"})
    again, meta = load_checkpoint(path)
    assert again.config == model.config
    assert not again.training
    assert (meta["width"], meta["note"]) == (32, "ä")
    assert path.stat().st_mode & 0o044 == 0o044  # others can read it
    assert json.loads(path.with_suffix(".json").read_text(encoding="utf-8")) == meta
    with torch.no_grad():
        assert torch.equal(again(frames.inputs).depth, model(frames.inputs).depth)


@pytest.mark.parametrize("keep", [0, 5, 1000, -1])
def test_a_truncated_checkpoint_says_so(tmp_path: Path, micro: Preset, keep: int) -> None:
    path = tmp_path / "net.safetensors"
    save_checkpoint(path, HADR(micro.model), SIZE)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(ValueError, match=r"net\.safetensors \(\d+ bytes\) is cut off or damaged"):
        load_checkpoint(path)


def test_other_files_are_refused(tmp_path: Path, micro: Preset) -> None:
    with pytest.raises(FileNotFoundError, match="no checkpoint at"):
        load_checkpoint(tmp_path / "none.safetensors")
    save_file({"x": torch.zeros(2)}, tmp_path / "other.safetensors")
    with pytest.raises(ValueError, match="not a checkpoint of HADR"):
        load_checkpoint(tmp_path / "other.safetensors")
    with pytest.raises(ValueError, match=r"must end with \.safetensors, got 'net\.pt'"):
        save_checkpoint(tmp_path / "net.pt", HADR(micro.model), SIZE)


@pytest.mark.parametrize("what", ["weights", "record", "no checksum"])
def test_what_changed_since_it_was_written_is_refused(tmp_path, micro, what):
    path = tmp_path / "net.safetensors"
    save_checkpoint(path, HADR(micro.model), {**SIZE, "confidence": {"center": [-1.25]}})
    whole = path.read_bytes()
    changed = {
        "weights": bytes([*whole[:-9], whole[-9] ^ 64, *whole[-8:]]),
        "record": whole.replace(b"-1.25", b"-1.75"),
        "no checksum": whole.replace(b"sha256", b"sha255"),
    }[what]
    assert changed != whole
    path.write_bytes(changed)
    said = "lacks sha256" if what == "no checksum" else "was damaged or changed"
    with pytest.raises(ValueError, match=rf"net\.safetensors:? {said}"):
        load_checkpoint(path)


def test_weights_that_are_no_numbers_are_refused(tmp_path: Path, micro: Preset) -> None:
    path, model = tmp_path / "net.safetensors", HADR(micro.model)
    with torch.no_grad():
        next(model.parameters()).fill_(torch.nan)
    save_checkpoint(path, model, SIZE)
    with pytest.raises(ValueError, match=r"net\.safetensors holds weights that are no numbers, in"):
        load_checkpoint(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"width": "64"}, "width: must be a whole number, got '64'"),
        ({"height": 0}, "height must be 1 to 16384, got 0"),
        ({"network": 7}, "network: must be text, got 7"),
        ({"network": "x"}, "network must be one of hadr, .*, got 'x'"),
        ({"model": {}}, "model: lacks hand, "),
        ({"data": {"corruption": "fog"}}, "corruption must be one of oracle, .*, got 'fog'"),
        ({"data": []}, r"data: must be named values, got \[\]"),
        ({"learned_range": {"depth_m": [2.0, 0.3]}}, "learned_range: depth_m must be two rising"),
    ],
)
def test_a_wrong_field_of_the_record_is_named(tmp_path, micro, change, said):
    path = tmp_path / "net.safetensors"
    save_checkpoint(path, HADR(micro.model), SIZE)
    update_record(path, change)
    with pytest.raises(ValueError, match=rf"net\.safetensors: {said}"):
        load_checkpoint(path)


def test_a_configuration_that_makes_no_network_is_refused(tmp_path: Path, micro: Preset) -> None:
    path = tmp_path / "net.safetensors"
    save_checkpoint(path, HADR(micro.model), SIZE)
    model = load_checkpoint(path)[1]["model"]
    for change, said in (
        ({"voxel_width": -1}, "model: voxel_width must not be negative, got -1"),
        ({"decoder_widths": []}, "its model is no network that can be"),
        ({"decoder_widths": [8]}, "does not fit its own configuration"),
    ):
        update_record(path, {"model": model | change})
        with pytest.raises(ValueError, match=rf"net\.safetensors.* {said}") as error:
            load_checkpoint(path)
        assert len(str(error.value)) < 600


def test_a_failed_write_leaves_the_old_checkpoint(tmp_path, micro, monkeypatch):
    path = tmp_path / "net.safetensors"
    save_checkpoint(path, HADR(micro.model), {**SIZE, "round": 1})

    def full_disk(path: Path, content: bytes) -> None:
        with path.open("wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError("no space left")

    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with pytest.raises(OSError, match="no space left"):
        save_checkpoint(path, HADR(micro.model), {**SIZE, "round": 2})
    assert load_checkpoint(path)[1]["round"] == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["net.json", "net.safetensors"]
