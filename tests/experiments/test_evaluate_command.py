from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from hadr.camera import Intrinsics, project
from hadr.cli import parse_options
from hadr.data.frame import Frame, write_frame
from hadr.experiments.evaluate_command import run
from hadr.models.backbone import BackboneConfig
from hadr.models.hadr import HADR, HADRConfig
from hadr.models.networks import NETWORKS
from hadr.models.segmentation import SegmentationNet
from hadr.training.checkpoints import save_checkpoint
from hadr.training.presets import preset

CAMERA = Intrinsics(60.0, 60.0, 31.5, 17.5, 64, 36)


def frame(stem: str, hand_off_m: float) -> Frame:
    """A glass at 0.5 m, and a hand so much farther."""
    rng = np.random.default_rng(0)
    depth = np.full(CAMERA.shape, 1.0, np.float32)
    glass, hand = np.zeros(CAMERA.shape, bool), np.zeros(CAMERA.shape, bool)
    glass[12:24, 20:40] = True
    hand[12:24, 8:20] = True
    depth[glass], depth[hand] = 0.5, 0.5 + hand_off_m
    line = np.stack([np.full(21, -0.15), np.linspace(-0.04, 0.04, 21)], axis=1)
    keypoints = np.column_stack([line, np.full(21, 0.5 + hand_off_m)])
    return Frame(
        stem=stem,
        object_id="0004",
        split="test",
        color=rng.integers(0, 256, (*CAMERA.shape, 3), dtype=np.uint8),
        depth=depth,
        hand_mask=hand,
        object_mask=glass,
        keypoints=keypoints,
        keypoints_uv=project(keypoints, CAMERA),
        camera=CAMERA,
        world_from_camera=np.eye(4),
    )


def test_networks_stand_beside_methods_that_learn_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Two folders are joined; the hand's median is 2 cm off in one frame, 4 cm in the other.
    write_frame(tmp_path / "one", frame("000001", 0.02))
    write_frame(tmp_path / "two", frame("000002", 0.04))
    net = HADRConfig(backbone=BackboneConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), window=4))
    for seed in ("a", "b"):
        save_checkpoint(
            tmp_path / seed / "last.safetensors", HADR(net), {"width": 32, "height": 18}
        )
    masks = preset("tiny", "segmentation")
    save_checkpoint(
        tmp_path / "masks.safetensors",
        SegmentationNet(masks.model),  # type: ignore[arg-type]
        {"width": 32, "height": 32},
    )
    words = [str(tmp_path / name) for name in ("a/last.safetensors", "b/last.safetensors")]
    words += [str(tmp_path / "masks.safetensors"), "--data", str(tmp_path / "one")]
    words += [str(tmp_path / "two"), "--out", str(tmp_path / "table.json")]
    assert run(parse_options("evaluate", words)) == 0
    written = json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))
    cheap = ["raw", "inpainting", "nearest", "hand-median"]
    assert list(written["rows"]) == [*cheap, "a/last", "b/last"]
    hand = written["rows"]["hand-median"]
    assert hand["rmse_m"] == pytest.approx((0.02 + 0.04) / 2, abs=1e-3)
    assert hand["pooled"]["rmse_m"] == pytest.approx(((0.02**2 + 0.04**2) / 2) ** 0.5, abs=1e-3)
    assert written["size"] == [224, 126]
    assert written["per_frame"]["a/last"]["stems"] == ["0004/000001", "0004/000002"]
    assert written["given"] == {"corruption": "oracle", "masks": "true", "keypoints": "true"}
    assert written["figures"]["masks"]["network"] == "segmentation"
    assert len(written["figures"]["masks"]) > 1
    assert written["provenance"]["versions"]["torch"]
    assert "mean of the frames' numbers" in capsys.readouterr().out


def test_where_no_hand_is_found_a_network_that_needs_one_restores_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blind = frame("000002", 0.02)
    blind.hand_mask[:], blind.object_mask[:, 24:] = False, False  # its glass is a fifth as large
    for one in (frame("000001", 0.02), blind):
        write_frame(tmp_path / "data", one)
    torch.manual_seed(0)
    needing = "unet-hand", "hadr-plus"
    for kind in (*needing, "hand-keypoints"):
        network = NETWORKS[kind].network_class()(preset("tiny", kind).model)
        save_checkpoint(tmp_path / f"{kind}.safetensors", network, {"width": 64, "height": 36})
    told = ["--data", str(tmp_path / "data"), "--out", str(tmp_path / "table.json")]
    words = [str(tmp_path / f"{kind}.safetensors") for kind in (*needing, "hand-keypoints")]
    assert run(parse_options("evaluate", [*words[:2], *told, "--keypoints", words[2]])) == 0
    written = json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))
    lines = capsys.readouterr().out.splitlines()
    for kind in needing:
        seen, unseen = written["per_frame"][kind]["rmse_m"]
        assert written["rows"][kind]["restored"]["rmse_m"] == pytest.approx(seen)
        assert unseen == pytest.approx(0.5, abs=1e-6), "all of it counts as depth 0"
        shares = [line.split("|")[-2].strip() for line in lines if line.startswith(f"| {kind} ")]
        assert shares == ["50.0", "83.3"], "of the frames, and of all pixels"
    assert run(parse_options("evaluate", [words[2], *told])) == 0
    written = json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))
    assert written["figures"]["hand-keypoints"]["seen"] == 0.5


def test_networks_of_one_name_and_one_called_as_a_method_keep_rows_of_their_own(
    tmp_path: Path,
) -> None:
    write_frame(tmp_path / "data", frame("000001", 0.02))
    net = HADRConfig(backbone=BackboneConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), window=4))
    paths = [tmp_path / name for name in ("a/run/best", "b/run/best", "c/nearest")]
    for path in paths:
        size = {"width": 32, "height": 18}
        save_checkpoint(path.with_suffix(".safetensors"), HADR(net), size)
    words = [f"{path}.safetensors" for path in paths]
    told = ["--data", str(tmp_path / "data"), "--out", str(tmp_path / "table.json")]
    assert run(parse_options("evaluate", words + told)) == 0
    rows = json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))["rows"]
    assert list(rows)[4:] == ["a/run/best", "b/run/best", "c/nearest"]
    with pytest.raises(ValueError, match=r"best\.safetensors is named twice"):
        run(parse_options("evaluate", words[:1] * 2))
    (tmp_path / "link.safetensors").symlink_to(words[0])
    with pytest.raises(ValueError, match="is named twice"):
        run(parse_options("evaluate", [words[0], str(tmp_path / "link.safetensors")]))


def test_a_split_that_is_nowhere_is_named(tmp_path: Path) -> None:
    write_frame(tmp_path / "one", replace(frame("000001", 0.02), split="train"))
    save_checkpoint(tmp_path / "net.safetensors", HADR(HADRConfig()), {"width": 32, "height": 18})
    words = [str(tmp_path / "net.safetensors"), "--data", str(tmp_path / "one")]
    with pytest.raises(FileNotFoundError, match=r"no folder test in .*; --split may be train$"):
        run(parse_options("evaluate", words))
