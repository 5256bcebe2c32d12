"""Mask, keypoints and depth of one frame: networks whose answers are known stand in."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from hadr import perception
from hadr.camera import Intrinsics
from hadr.depth_network import DepthNetwork
from hadr.perception import HandKeypoints, Perception, Segmentation
from hadr.restoration import restore

CAMERA = Intrinsics(fx=100, fy=100, cx=39.5, cy=29.5, width=80, height=60)
HAND = np.stack(
    (np.linspace(-0.2, -0.1, 21), 0.05 * (-1.0) ** np.arange(21), np.full(21, 0.7)), axis=1
)


class ByColor(nn.Module):
    """Glass is blue, skin is red."""

    def __init__(self, classes: int = 2) -> None:
        super().__init__()
        self.classes = classes

    def forward(self, color):
        red, _, blue = color.unbind(dim=1)
        return torch.stack((blue - 0.5, red - 0.5), dim=1)[:, : self.classes]


class Depth(nn.Module):
    """0.7 m everywhere in the mask, and remembers its input."""

    def forward(self, inputs):
        self.given = inputs
        answer = type("Answer", (), {})()
        answer.depth = 0.7 * inputs.mask
        answer.confidence = 0.6 * inputs.mask
        answer.restored = inputs.mask
        return answer


def frame() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Colour, depth, and where glass and hand are."""
    glass, hand = np.zeros((2, 60, 80), bool)
    glass[20:40, 32:52] = True
    hand[24:44, 12:28] = True
    color = np.zeros((60, 80, 3), np.uint8)
    color[glass] = (0, 0, 255)
    color[hand] = (255, 0, 0)
    depth = np.where(glass, 1.5, np.where(hand, 0.7, 0.9)).astype(np.float32)
    return color, depth, glass, hand


def restorer(**changes) -> DepthNetwork:
    given = {
        "model": Depth(),
        "kind": "hadr",
        "size": (40, 30),
        "needs_hand": True,
        "corruption": "oracle",
        "rule": None,
        "learned_range_m": None,
        "name": "depth.safetensors",
        "trained": "never",
    }
    return DepthNetwork(**given | changes)


SEGMENTATION = Segmentation(ByColor(), (40, 30), "masks.safetensors")


@pytest.fixture
def finder(monkeypatch):
    """A keypoint network that always finds the same hand, and what it was asked."""
    asked = []

    def find(self, color, depth, camera, mask, hand_mask):
        asked.append((depth, mask, hand_mask))
        return HAND.copy()

    monkeypatch.setattr(HandKeypoints, "find", find)
    return HandKeypoints(nn.Identity(), (40, 30), "hand.safetensors"), asked


def small_hadr():
    """An untrained HADR, smaller than any preset."""
    from hadr.models.backbone import BackboneConfig
    from hadr.models.hadr import HADR, HADRConfig

    torch.manual_seed(0)
    backbone = BackboneConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), window=4, drop_path=0.0)
    return HADR(
        HADRConfig(backbone=backbone, decoder_widths=(16, 8), voxel_width=24, max_points=500)
    )


def test_all_three_parts(finder) -> None:
    network, asked = finder
    color, depth, glass, hand = frame()
    before = depth.copy()
    found = Perception(restorer(), SEGMENTATION, network)(color, depth, CAMERA)
    np.testing.assert_array_equal(found.mask, glass)
    np.testing.assert_array_equal(found.hand_mask, hand)
    np.testing.assert_allclose(found.keypoints, HAND)
    np.testing.assert_allclose(found.depth, np.where(glass, 0.7, before), rtol=1e-6)
    np.testing.assert_allclose(found.confidence, np.where(glass, 0.6, 1), rtol=1e-6)
    np.testing.assert_array_equal(found.restored, glass)
    assert list(found.seconds) == list(perception.PARTS)
    assert min(found.seconds.values()) >= 0
    np.testing.assert_array_equal(depth, before)
    (seen, mask, hand_mask) = asked[0]
    assert (seen[glass] == 0).all(), "the keypoints must not come from the wall behind the glass"
    np.testing.assert_array_equal(seen[~glass], before[~glass])
    np.testing.assert_array_equal(mask, glass)
    np.testing.assert_array_equal(hand_mask, hand)


def test_what_is_given_is_not_predicted(finder) -> None:
    network, asked = finder
    color, depth, glass, hand = frame()
    perceive = Perception(restorer(), SEGMENTATION, network)
    mine = np.zeros_like(glass)
    mine[20:40, 32:40] = True
    found = perceive(color, depth, CAMERA, mask=mine, keypoints=HAND)
    assert not asked
    assert list(found.seconds) == ["restoration"]
    np.testing.assert_array_equal(found.restored, mine)
    assert found.hand_mask is None
    found = perceive(color, depth, CAMERA, mask=mine, hand_mask=hand)
    assert list(found.seconds) == ["keypoints", "restoration"]
    found = perceive(color, depth, CAMERA, keypoints=HAND)
    assert list(found.seconds) == ["segmentation", "restoration"]


def test_depth_inside_the_mask_reaches_a_network_that_learned_it() -> None:
    color, depth, _, _ = frame()
    for corruption, seen in (("oracle", 0.0), ("sensor", 1.5)):
        network = restorer(corruption=corruption, needs_hand=False)
        Perception(network, SEGMENTATION)(color, depth, CAMERA)
        given = network.model.given
        np.testing.assert_allclose(given.depth[given.mask].numpy(), seen)


def test_no_glass_no_hand_is_said_and_nothing_is_made_up(finder) -> None:
    network, _ = finder
    color, depth, glass, hand = frame()
    perceive = Perception(restorer(), SEGMENTATION, network)
    found = perceive(np.where(glass[..., None], 0, color).astype(np.uint8), depth, CAMERA)
    np.testing.assert_array_equal(found.depth, depth)
    assert not found.restored.any()
    assert any("no glass was found" in note for note in found.notes)
    found = perceive(np.where(hand[..., None], 0, color).astype(np.uint8), depth, CAMERA)
    assert found.keypoints is None
    assert not found.restored.any()
    assert (found.depth[glass] == 0).all(), "missing, neither the wall behind nor 0 as a depth"
    assert (found.confidence[glass] == 0).all()
    assert any("no hand with depth was found" in note for note in found.notes)
    assert any("depth.safetensors needs 21 hand keypoints" in note for note in found.notes)
    # A network that needs no hand does without.
    free = Perception(restorer(needs_hand=False), SEGMENTATION, network)
    found = free(np.where(hand[..., None], 0, color).astype(np.uint8), depth, CAMERA)
    np.testing.assert_array_equal(found.restored, glass)


def test_what_is_neither_given_nor_predicted_is_named(finder) -> None:
    network, _ = finder
    color, depth, glass, _ = frame()
    with pytest.raises(ValueError, match="no mask given and no segmentation network"):
        Perception(restorer())(color, depth, CAMERA)
    with pytest.raises(ValueError, match="no hand mask given and no segmentation network"):
        Perception(restorer(), None, network)(color, depth, CAMERA, mask=glass)
    one_class = Segmentation(ByColor(classes=1), (40, 30), "masks.safetensors")
    found = Perception(restorer(), one_class, network)(color, depth, CAMERA)
    assert found.keypoints is None
    with pytest.raises(ValueError, match=r"mask must be .* bool, got .* uint8"):
        Perception(restorer())(color, depth, CAMERA, mask=glass.astype(np.uint8))


def test_a_missing_or_wrong_checkpoint_is_named(tmp_path) -> None:
    with pytest.raises(FileNotFoundError, match=r"checkpoint .*gone.safetensors does not exist"):
        Perception.load(tmp_path / "gone.safetensors")
    from hadr.training.checkpoints import save_checkpoint

    path = tmp_path / "depth.safetensors"
    save_checkpoint(path, small_hadr(), {"width": 64, "height": 40})
    loaded = Perception.load(path)
    assert loaded.restoration.kind == "hadr"
    assert loaded.restoration.size == (64, 40)
    full, sparse = loaded.restoration, Perception.load(path, ray_stride=2).restoration
    color, depth, glass, _keypoints = frame()
    answers = [
        n.restore(color, np.where(glass, 0, depth), CAMERA, glass, np.full((21, 3), 0.7))
        for n in (full, sparse)
    ]
    np.testing.assert_array_equal(answers[0].restored, answers[1].restored)
    inside = answers[0].restored
    assert inside.any()
    assert np.abs(answers[0].depth - answers[1].depth)[inside].max() < 0.3  # within its voxel
    with pytest.raises(ValueError, match="stride must be at least 1, got 0"):
        full.with_fewer_rays(0)
    with pytest.raises(ValueError, match="is a unet-hand, which does not restore ray by ray"):
        replace(full, kind="unet-hand").with_fewer_rays()
    with pytest.raises(ValueError, match="of kind 'hadr', expected 'segmentation'"):
        Perception.load(path, segmentation=path)
    with pytest.raises(ValueError, match="of kind 'hadr', expected 'hand-keypoints'"):
        Perception.load(path, keypoints=path)


def test_restore_predicts_mask_and_keypoints_and_says_so(finder, monkeypatch) -> None:
    network, _ = finder
    color, depth, glass, _ = frame()
    monkeypatch.setattr(Segmentation, "load", classmethod(lambda cls, path: SEGMENTATION))
    monkeypatch.setattr(HandKeypoints, "load", classmethod(lambda cls, path: network))
    result = restore(
        color,
        depth,
        CAMERA,
        method="hand-median",
        segmentation="masks.safetensors",
        keypoint_network="hand.safetensors",
    )
    np.testing.assert_array_equal(result.mask, glass)
    np.testing.assert_allclose(result.depth[glass], 0.7, atol=1e-6)
    assert "the mask is not given but predicted by masks.safetensors" in result.notes
    assert "the hand's keypoints are not given but predicted by hand.safetensors" in result.notes
    dark = np.zeros_like(color)
    with pytest.raises(ValueError, match=r"masks.safetensors found no glass in the picture"):
        restore(dark, depth, CAMERA, method="nearest", segmentation="masks.safetensors")
    with pytest.raises(ValueError, match=r"hand.safetensors needs to know where the hand is"):
        restore(color, depth, CAMERA, glass, keypoint_network="hand.safetensors")


@pytest.mark.parametrize(
    ("learned", "told"),
    [
        ("oracle", "is not trusted and was erased"),
        ("sensor", "is trusted as far as the method does"),
    ],
)
def test_restore_and_perception_treat_measured_depth_alike(
    learned: str, told: str, finder, monkeypatch, tmp_path
) -> None:
    from hadr.training.checkpoints import save_checkpoint

    network, asked = finder
    monkeypatch.setattr(Segmentation, "load", classmethod(lambda cls, path: SEGMENTATION))
    monkeypatch.setattr(HandKeypoints, "load", classmethod(lambda cls, path: network))
    path = tmp_path / "depth.safetensors"
    record = {"width": 64, "height": 40, "data": {"corruption": learned}}
    save_checkpoint(path, small_hadr(), record)
    color, depth, glass, _ = frame()
    found = Perception.load(path, "masks", "hand")(color, depth, CAMERA)
    result = restore(
        color, depth, CAMERA, checkpoint=path, segmentation="masks", keypoint_network="hand"
    )
    assert result.method == "hadr"
    for name in ("mask", "depth", "confidence", "restored"):
        np.testing.assert_array_equal(getattr(result, name), getattr(found, name), name)
    seen = [image for image, _, _ in asked]  # what the keypoint network was given
    np.testing.assert_array_equal(seen[0], seen[1])
    np.testing.assert_array_equal(seen[0] == 0, glass & (learned == "oracle"))
    said = [
        [n for n in notes if "had a measured depth" in n] for notes in (found.notes, result.notes)
    ]
    assert said[0] == said[1] == [f"400 of the mask's 400 pixels had a measured depth; it {told}"]


def test_untrained_networks_of_all_kinds_work_together(tmp_path) -> None:
    """Shapes, sizes and files fit; what untrained networks see is of no matter."""
    from hadr.models.blocks.resnet import UNetConfig
    from hadr.models.hand.keypoints import HandKeypointConfig, HandKeypointNet
    from hadr.models.segmentation import SegmentationConfig, SegmentationNet
    from hadr.training.checkpoints import save_checkpoint

    torch.manual_seed(0)
    unet = UNetConfig((1, 1, 1, 1), (4, 4, 4, 4), (4, 4, 4, 4))
    masks = SegmentationNet(SegmentationConfig(unet))
    torch.nn.init.zeros_(masks.head.weight)
    torch.nn.init.constant_(masks.head.bias[:4].data, 1.0)  # all is glass, nothing a hand
    torch.nn.init.constant_(masks.head.bias[4:].data, -1.0)
    parts = {
        "depth": small_hadr(),
        "masks": masks,
        "hand": HandKeypointNet(HandKeypointConfig(unet, crop=32)),
    }
    for name, model in parts.items():
        save_checkpoint(tmp_path / f"{name}.safetensors", model, {"width": 64, "height": 40})
    files = [tmp_path / f"{name}.safetensors" for name in parts]
    perceive = Perception.load(*files)
    color, depth, glass, hand = frame()
    found = perceive(color, depth, CAMERA)
    assert found.mask.all()
    assert not found.hand_mask.any()
    assert not found.restored.any()
    found = perceive(color, depth, CAMERA, mask=glass, hand_mask=hand)
    assert found.keypoints.shape == (21, 3)
    assert np.abs(found.keypoints - found.keypoints.mean(axis=0)).max() < 0.6
    assert 0.4 < found.keypoints[:, 2].mean() < 1.0, "in the cube around the hand at 0.7 m"
    np.testing.assert_array_equal(found.restored, glass)
    blind = perceive(color, np.where(hand, 0, depth), CAMERA, mask=glass, hand_mask=hand)
    assert blind.keypoints is None
    assert any("no hand with depth" in note for note in blind.notes)
