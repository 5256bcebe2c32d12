import hashlib
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from hadr.cli import parse_options
from hadr.confidence.calibration import ConfidenceRule
from hadr.confidence.known_ground import Ground
from hadr.data.folders import data_digest
from hadr.data.samples import samples_dir
from hadr.models.hadr import HADR
from hadr.models.hadr_plus import HADRPlus, HADRPlusConfig
from hadr.records.result_file import digest, read_result_file
from hadr.training import calibrate_command as subject
from hadr.training.calibrate import (
    LEARNED,
    MEASURED,
    calibrate,
    learn_ground,
    measure_confidence,
    restored_pixels,
)
from hadr.training.checkpoints import load_checkpoint, save_checkpoint, update_record


@pytest.fixture(scope="module")
def model(micro):
    torch.manual_seed(0)
    return HADR(micro.model)


@pytest.fixture(scope="module")
def plus():
    """A network that can say how sure it is."""
    torch.manual_seed(0)
    return HADRPlus(HADRPlusConfig(crop=32, width=8, blocks=1))


def test_pixels_are_the_restored_ones_with_their_errors(model, frames) -> None:
    pixels = restored_pixels(model, frames, batch_size=4)
    with torch.no_grad():
        output = model.eval()(frames.inputs)
    kept = frames.object_mask & output.restored
    outside = output.rays[(output.offset < 0) | (output.offset > 1)]
    kept[tuple(outside.unbind(dim=1))] = False
    assert len(pixels.error_m) == int(kept.sum())
    expected = (output.depth - frames.true_depth)[kept].numpy()
    np.testing.assert_allclose(pixels.error_m, expected, atol=1e-5)
    np.testing.assert_array_equal(np.bincount(pixels.frame, minlength=6), kept.sum((1, 2)))
    assert pixels.coverage == pytest.approx(float(kept.sum() / frames.object_mask.sum()))
    assert pixels.signal is None, "HADR cannot say how sure it is"
    far = float(output.depth[kept].max()) - 1e-4
    fewer = restored_pixels(model, frames, (0.0, far), batch_size=4)
    assert 0 < len(pixels.error_m) - len(fewer.error_m) < 40
    assert fewer.coverage < pixels.coverage


def test_calibrating_says_what_it_was_fitted_on_and_makes_it_honest_there(model, plus, frames):
    additions = calibrate(plus, frames, frames, "little frames")
    near, far = additions["learned_range"]["depth_m"]
    assert near == pytest.approx(0.45 - 0.02)
    assert far == pytest.approx(0.7 + 0.02)
    record = additions["confidence"]
    assert record["fitted_on"]["of"] == "little frames"
    assert record["fitted_on"]["frames"] == len(frames)
    rule = ConfidenceRule.from_dict(record)
    pixels = restored_pixels(plus, frames, (near, far))
    found = measure_confidence(rule, pixels, frames.stems)
    alike = measure_confidence(rule, pixels, ["one hold"] * len(frames))
    doubt = "gain_at_90_standard_error_m"
    assert (alike["holds"], found["holds"]) == (1, found["frames"]) == (1, len(frames))
    assert alike[doubt] < 1e-9 < found[doubt], "one hold has nothing to be drawn from"
    assert found["mean_confidence"] == pytest.approx(found["share_right"], abs=0.05)
    assert found["oracle_rmse_at_90_m"] <= found["rmse_at_90_m"]
    assert found["rmse_m"] == pytest.approx(float(np.sqrt(np.mean(pixels.error_m**2))))
    two = frames.take([0, 1])
    fitted = calibrate(plus, frames, two, "two")["confidence"]["fitted_on"]
    pixels = len(restored_pixels(plus, two, (near, far)).error_m)
    assert fitted == {"frames": 2, "pixels": pixels, "of": "two"}
    silent = calibrate(model, frames, frames, "little frames")
    assert silent == {"learned_range": additions["learned_range"]}
    with pytest.raises(ValueError, match="cannot say how sure it is"):
        measure_confidence(rule, restored_pixels(model, frames), frames.stems)


def test_limit_and_confidence_of_a_ground_are_of_validation_frames(plus, glass_frame) -> None:
    def ground(*rows: int) -> dict:
        return learn_ground(plus, (32, 24), "oracle", (0.3, 0.8), seen[:6], [seen[n] for n in rows])

    seen = [glass_frame(f"{n:06d}", rows) for n, rows in enumerate((6, 7, 8, 9, 10, 12, 26, 28))]
    seen = [replace(frame, raw_depth=frame.depth) for frame in seen]
    alike, larger = ground(*range(6)), ground(6, 7)
    for name in (LEARNED, MEASURED):
        limits = [found["fields"][name]["limit"] for found in (alike, larger)]
        assert limits[0] < limits[1], "the larger glasses of validation are in"
    rules = [found["fields"][MEASURED]["confidence"] for found in (alike, larger)]
    assert [rule["calibration"]["frames"] for rule in rules] == [6, 2]


def test_the_command_adds_to_the_record_and_leaves_the_weights(plus, tmp_path, capsys) -> None:
    path = tmp_path / "a.safetensors"
    meta = {"width": 32, "height": 24, "epochs": 7, "preset": {"name": "micro"}}
    save_checkpoint(path, plus, meta, stored="int8", training_state={"x": torch.ones(2)})
    before = {name: (t.dtype, t.numpy().tobytes()) for name, t in load_file(path).items()}
    line = [str(path), str(samples_dir() / "frames"), "--objects", "0006"]
    line += ["--out", str(tmp_path / "measured.json")]
    assert subject.run(parsed(*line)) == 0
    after = {name: (t.dtype, t.numpy().tobytes()) for name, t in load_file(path).items()}
    assert {n: (d, hashlib.sha256(b).digest()) for n, (d, b) in before.items()} == {
        n: (d, hashlib.sha256(b).digest()) for n, (d, b) in after.items()
    }
    _, record = load_checkpoint(path)
    assert record["epochs"] == 7
    near, far = record["learned_range"]["depth_m"]
    assert 0.1 < near < 0.4 < far < 1
    ConfidenceRule.from_dict(record["confidence"])
    result = read_result_file(tmp_path / "measured.json")
    row = result.row(split="test", network="hadr-plus")
    assert len(row["sparsification"]["rmse_m"]) == 20
    assert sum(row["reliability"]["count"]) == row["pixels"]
    told = capsys.readouterr().out
    assert "learned range" in told
    assert "without the least sure tenth" in told
    ground = Ground.from_dict(record["ground"])
    learned, measured = ground.fields["depth as in training"], ground.fields["measured depth"]
    assert "known_in" not in learned.names, "oracle frames have no depth in the glass"
    assert "known_in" in measured.names
    assert learned.rule is None
    assert measured.rule is not None, "a camera's depth has a calibration of its own"
    noted = {**record["confidence"], "note": "as it was"}
    update_record(path, {"ground": None, "confidence": noted})
    assert subject.run(parsed(*line[:4], "--only-ground")) == 0
    _, again = load_checkpoint(path)
    assert again == {**record, "confidence": noted, "sha256": again["sha256"]}


def test_the_command_says_which_network_cannot_say_how_sure_it_is(model, tmp_path, capsys) -> None:
    path = tmp_path / "a.safetensors"
    save_checkpoint(path, model, {"width": 32, "height": 24})
    out = tmp_path / "measured.json"
    line = (str(path), str(samples_dir() / "frames"), "--objects", "0006", "--out", str(out))
    assert subject.run(parsed(*line)) == 0
    _, record = load_checkpoint(path)
    assert "learned_range" in record
    assert "confidence" not in record
    assert not out.exists()
    told = capsys.readouterr().out
    assert "a network of kind hadr cannot say how sure it is" in told
    assert "is not written" in told


def test_frames_without_the_objects_depth_teach_no_range(model, frames) -> None:
    blind = replace(frames, true_depth=torch.zeros_like(frames.true_depth))
    with pytest.raises(ValueError, match="the learned range is unknown"):
        calibrate(model, blind, frames, "nothing")


def parsed(*words: str) -> subject.Options:
    options: subject.Options = parse_options("calibrate", words)
    return options


def test_what_cannot_be_calibrated_is_left_as_it_is(model, tmp_path) -> None:
    frames = str(samples_dir() / "frames")
    masks = str(samples_dir() / "checkpoints" / "segmentation-imagenet.safetensors")
    with pytest.raises(ValueError, match="kind 'segmentation', which restores no depth"):
        subject.run(parsed(masks, frames))
    path = tmp_path / "small.safetensors"
    save_checkpoint(path, model, {"width": 32, "height": 24, "data": {"corruption": "oracle"}})
    with pytest.raises(ValueError, match="was never calibrated: leave --only-ground out"):
        subject.run(parsed(str(path), frames, "--only-ground"))
    other, meta = tmp_path / "other.safetensors", {"data": {"frames_sha256": "0" * 64}}
    save_checkpoint(other, model, {"width": 32, "height": 24, **meta})
    with pytest.raises(ValueError, match="has learned from other frames than those of"):
        subject.run(parsed(str(other), frames))
    own = {"sha256": digest([data_digest(frames)])}
    for record, why in (
        ({"experiment": "known", "sha256": "0" * 64}, "sha256"),
        ({"experiment": "unknown", **own}, "experiment 'unknown'"),
        ({"experiment": "by-frame", **own}, "experiment 'by-frame'"),
    ):
        save_checkpoint(other, model, {"width": 32, "height": 24, "data": record})
        with pytest.raises(ValueError, match=f"its record's {why} is not theirs"):
            subject.run(parsed(str(other), frames))
    before = path.read_bytes()
    with pytest.raises(ValueError, match="trained with corruption 'oracle'"):
        subject.run(parsed(str(path), frames, "--corruption", "sensor"))
    with pytest.raises(ValueError, match="is a folder, expected the name of a file"):
        subject.run(parsed(str(path), frames, "--out", str(tmp_path)))
    assert path.read_bytes() == before
    notes = tmp_path / "small.json"
    notes.write_text("my notes")
    with pytest.raises(ValueError, match=r"small\.json is no checkpoint's record"):
        subject.run(parsed(str(path), frames))
    assert (path.read_bytes(), notes.read_text()) == (before, "my notes")


def test_a_handful_of_frames_teaches_no_confidence(plus, tmp_path) -> None:
    for split, count in (("train", 12), ("val", 1), ("test", 1)):
        for part in (samples_dir() / "frames" / split / "0006/depth").iterdir():
            (place := tmp_path / "few" / split / "0006/depth" / part.name).mkdir(parents=True)
            for file in sorted(part.iterdir())[:count]:
                (place / file.name).write_bytes(file.read_bytes())
    path = tmp_path / "a.safetensors"
    save_checkpoint(path, plus, {"width": 32, "height": 24})
    before = path.read_bytes()
    with pytest.raises(ValueError, match="split val has 1 frames of it, expected 10 or more"):
        subject.run(parsed(str(path), str(tmp_path / "few")))
    assert path.read_bytes() == before
