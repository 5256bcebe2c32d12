from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from hadr.camera import Intrinsics, back_project
from hadr.models.backbone import BackboneConfig
from hadr.models.decoders import OffsetDecoder, PairDecoder, encode_position, leaky_clamp
from hadr.models.hadr import HADR, HADRConfig
from hadr.models.network_input import HADRInput, frame_to_input, masked_rays, ray_points

MICRO = HADRConfig(
    backbone=BackboneConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), window=4, drop_path=0.0),
    decoder_widths=(16, 8),
    voxel_width=24,
    max_points=500,
)
CAMERA = Intrinsics(40.0, 40.0, 15.5, 11.5, 32, 24)


def scene(frames: int = 1, wall: float = 1.0, glass: float = 0.6) -> tuple[HADRInput, Tensor]:
    """A wall, before it a glass square without depth, at its left a strip of hand."""
    generator = torch.Generator().manual_seed(3)
    true_depth = torch.full((frames, CAMERA.height, CAMERA.width), wall)
    mask = torch.zeros_like(true_depth, dtype=torch.bool)
    mask[:, 8:16, 12:20] = True
    true_depth[mask] = glass
    true_depth[:, 8:16, 9:12] = glass
    depth = true_depth * ~mask
    intrinsics = torch.tensor([[CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]]).repeat(frames, 1)
    keypoints = torch.randn(frames, 21, 3, generator=generator) * 0.05
    keypoints[..., 2] += glass
    color = torch.rand(frames, 3, CAMERA.height, CAMERA.width, generator=generator)
    uv = torch.rand(frames, 21, 2, generator=generator) * 20
    return HADRInput(color, depth, mask, intrinsics, keypoints, uv), true_depth


def test_the_papers_embedding_is_511_wide() -> None:
    config = HADRConfig()
    ray, voxel, pair = config.parts
    assert (ray, voxel, pair) == (128 + 27, 128 + 126, 51 + 51)
    assert sum(config.parts) == 511
    assert sum(HADRConfig(hand="none").parts) == 385  # LIDF's
    assert sum(HADRConfig(hand="2d").parts) == 385 + 42
    first = PairDecoder(config.parts, config.decoder_widths).first
    assert (first.in_features, first.out_features) == (511, 256)
    assert OffsetDecoder(config.parts, config.decoder_widths).decoder.first.in_features == 511 + 16


def test_a_decoder_equals_its_plain_form_on_whole_embeddings() -> None:
    torch.manual_seed(1)
    decoder = PairDecoder((7, 4, 5), (16, 8))
    ray, voxel, pair = torch.randn(3, 7), torch.randn(4, 4), torch.randn(6, 5)
    ray_of, voxel_of = torch.tensor([0, 0, 1, 2, 2, 2]), torch.tensor([3, 1, 0, 2, 1, 0])
    embedding = torch.cat((ray[ray_of], voxel[voxel_of], pair), dim=1)
    plain = nn.Linear(16, 16)
    plain.load_state_dict(decoder.first.state_dict())
    hidden = nn.functional.leaky_relu(plain(embedding), 0.02)
    hidden = nn.functional.leaky_relu(decoder.rest[0](hidden), 0.02)
    expected = decoder.rest[1](hidden)[:, 0]
    found = decoder.finish(decoder.begin(ray, voxel, pair, ray_of, voxel_of))
    torch.testing.assert_close(found, expected)


def test_position_encoding_by_hand() -> None:
    values = torch.tensor([[0.5, -1.0]])
    s, c = math.sin, math.cos
    expected = [0.5, -1, s(0.5), s(-1), c(0.5), c(-1), s(1), s(-2), c(1), c(-2)]
    assert encode_position(values, 2)[0].tolist() == pytest.approx(expected)
    assert encode_position(torch.zeros(2, 3), 8).shape == (2, 51)
    assert encode_position(torch.zeros(2, 3), 4).shape == (2, 27)


def test_leaky_clamp_by_hand_and_never_without_gradient() -> None:
    values = torch.tensor([-1.0, 0.0, 0.3, 1.0, 3.0], requires_grad=True)
    clamped = leaky_clamp(values)
    assert clamped.tolist() == pytest.approx([-0.01, 0.0, 0.3, 1.0, 1.02])
    (slope,) = torch.autograd.grad(clamped.sum(), values)
    assert slope[[0, 2, 4]].tolist() == pytest.approx([0.01, 1.0, 0.01])


def test_offset_decoder_adds_in_two_steps_from_a_thousandth() -> None:
    decoder = OffsetDecoder((2, 2, 2), (4,), steps=2)
    for parameter in decoder.parameters():
        nn.init.zeros_(parameter)
    # A network that gives 0.1 + 2 * max(current offset, 0): 0.001 -> 0.103 -> 0.409.
    nn.init.constant_(decoder.embed_offset.weight, 1.0)
    with torch.no_grad():
        decoder.decoder.first.weight[0, 6] = 2.0
        decoder.decoder.rest[0].weight[0, 0] = 1.0
        decoder.decoder.rest[0].bias[0] = 0.1
    row = torch.zeros(1, dtype=torch.long)
    found = decoder(torch.zeros(1, 2), torch.zeros(1, 2), torch.zeros(1, 2), row, row)
    assert found.item() == pytest.approx(0.001 + (0.1 + 0.002) + (0.1 + 2 * 0.103))


@pytest.mark.parametrize("seed", range(5))
def test_no_offset_starts_clamped(seed: int) -> None:
    torch.manual_seed(seed)
    model = HADR(MICRO).eval()
    output = model(scene()[0])
    assert len(output.offset) == 64
    assert output.offset.min() > 0.05
    assert output.offset.max() < 0.95


def test_depth_is_entering_distance_plus_offset_of_the_diagonal() -> None:
    model = HADR(MICRO).eval()
    decoder = model.offset_decoder.decoder
    for parameter in decoder.parameters():
        nn.init.zeros_(parameter)
    nn.init.constant_(decoder.rest[-1].bias, 0.1)  # offset 0.001 + 0.1 + 0.1 for every pair
    inputs, true_depth = scene()
    output = model(inputs, true_depth=true_depth)
    # The glass at 0.6 m lies in the cell whose z goes from 0.375 to 0.625. The square's rays are
    # so near to the axis that they enter it through its front face: z = 0.375.
    row, column = 11, 15
    direction = torch.tensor([(column - 15.5) / 40, (row - 11.5) / 40, 1.0])
    unit_z = 1 / direction.norm()
    expected = 0.375 + 0.201 * math.sqrt(3) * 0.25 * unit_z
    assert output.depth[0, row, column].item() == pytest.approx(expected.item(), abs=1e-6)
    index = (output.rays == torch.tensor([0, row, column])).all(1).nonzero().item()
    torch.testing.assert_close(output.points[index], direction * expected)
    assert not output.clamped.any()
    nn.init.constant_(decoder.rest[-1].bias, 0.5)  # offset 1.001: behind its voxel
    output = model(inputs, true_depth=true_depth)
    assert torch.equal(output.clamped, output.restored)


def test_true_voxel_where_asked_for_and_most_probable_otherwise() -> None:
    torch.manual_seed(0)
    model = HADR(MICRO).eval()
    inputs, true_depth = scene()
    free, told = model(inputs), model(inputs, true_depth=true_depth)
    z_of_chosen = told.occupied.center[told.pairs.voxel[told.chosen], 2]
    assert torch.all(z_of_chosen == 0.5)
    for ray in (0, 30, 63):
        own = (free.pairs.ray == ray).nonzero().squeeze(1)
        assert len(own) == 2  # glass's cell (from the hand's strip) and the wall's
        assert free.chosen[ray] == own[free.probability[own].argmax()]
        assert free.probability[own].sum().item() == pytest.approx(1.0)


def test_rays_without_candidate_are_not_restored() -> None:
    model = HADR(MICRO).eval()
    inputs, _ = scene(2)
    depth = inputs.depth.clone()
    depth[0] = 0  # frame 0 has no point at all, frame 1 only its left strip
    depth[1, :, 12:] = 0
    mask = inputs.mask.clone()
    mask[1, 8:16, 31] = True  # rays so far to the right that they pass by the strip's voxel
    output = model(replace(inputs, depth=depth, mask=mask))
    assert not output.restored[0].any()
    assert output.restored[1].any()
    assert not output.restored[1][:, 31].any()
    lost = ~output.restored
    assert torch.all(output.depth[lost] == 0)
    assert torch.all(output.depth[output.restored] > 0)
    assert torch.all((output.chosen < 0) == (output.pairs.candidates() == 0))
    assert torch.all(output.points[output.chosen < 0] == 0)


@pytest.mark.parametrize(
    "config",
    [
        MICRO,
        replace(MICRO, hand="none"),
        replace(MICRO, hand="2d"),
        replace(MICRO, hand="xy"),
        replace(MICRO, wrist_rotation=False),
        replace(MICRO, aggregation=False),
        replace(MICRO, point_fusion=False),
        replace(MICRO, clamp_probability=True),
    ],
    ids=["full", "no hand", "2d hand", "xy", "no rotation", "one scale", "no fusion", "clamped"],
)
def test_one_step_reaches_each_module(config: HADRConfig) -> None:
    torch.manual_seed(0)
    model = HADR(config)
    output = model(scene(2)[0])
    (output.points.sum() + output.logits.square().sum()).backward()
    for name, module in model.named_children():
        parameters = list(module.parameters())
        reached = [p.grad is not None and bool(p.grad.abs().sum() > 0) for p in parameters]
        assert all(reached[-2:]) if parameters else name == "ray_features", name
        assert not parameters or reached[0] or name == "backbone", name
    embedding = next(model.backbone.swin.parameters())
    assert embedding.grad is not None
    assert embedding.grad.abs().sum() > 0


@pytest.mark.parametrize("hand", ["3d", "xy", "2d", "none"])
def test_the_hand_matters_only_where_it_is_a_feature(hand: str) -> None:
    torch.manual_seed(0)
    model = HADR(replace(MICRO, hand=hand)).eval()  # type: ignore[arg-type]
    inputs, _ = scene()
    before = model(inputs).logits
    moved_3d = model(replace(inputs, keypoints=inputs.keypoints + 0.05)).logits
    moved_2d = model(replace(inputs, keypoints_uv=inputs.keypoints_uv + 5)).logits
    assert torch.equal(before, moved_3d) == (hand in ("2d", "none"))
    assert torch.equal(before, moved_2d) == (hand != "2d")


def test_the_2d_feature_is_the_pixel_over_the_image_size() -> None:
    model = HADR(replace(MICRO, hand="2d")).eval()
    inputs, _ = scene()
    uv = torch.full_like(inputs.keypoints_uv, -0.5)
    uv[:, 3] = torch.tensor([31.5, 11.5])  # right border, middle row
    with_uv = replace(inputs, keypoints_uv=uv)
    feature = model._hand_feature(with_uv, model(with_uv).occupied)
    assert feature.shape[1] == 42
    assert feature[0, 6:8].tolist() == [1.0, 0.5]
    assert feature[0].sum().item() == 1.5


def test_the_published_2d_feature_is_x_and_y_in_metres() -> None:
    model = HADR(replace(MICRO, hand="xy")).eval()
    inputs, _ = scene()
    occupied = model(inputs).occupied
    feature = model._hand_feature(inputs, occupied)
    assert feature.shape[1] == 84 == model.config.hand_width
    flat = inputs.keypoints[0, :, :2]
    torch.testing.assert_close(feature[0, :42], (flat - flat[0]).flatten())
    torch.testing.assert_close(feature[0, 42:], (flat - occupied.center[0, :2]).flatten())
    away = replace(inputs, keypoints=inputs.keypoints + torch.tensor([0.0, 0.0, 0.3]))
    assert torch.equal(model._hand_feature(away, occupied), feature)


def test_without_its_rotation_the_wrist_frame_is_the_cameras() -> None:
    inputs, _ = scene()
    wrist = (inputs.keypoints - inputs.keypoints[:, :1]).flatten()
    for rotation in (True, False):
        model = HADR(replace(MICRO, wrist_rotation=rotation)).eval()
        feature = model._hand_feature(inputs, model(inputs).occupied)
        apart = (feature[:, :63] - wrist).abs().max()
        assert apart > 0.01 if rotation else apart == 0


def test_only_where_asked_for_the_probability_head_ends_in_the_clamp() -> None:
    torch.manual_seed(0)
    plain = HADR(MICRO).eval()
    clamped = HADR(replace(MICRO, clamp_probability=True)).eval()
    clamped.load_state_dict(plain.state_dict())
    inputs, _ = scene()
    free, kept = plain(inputs).logits, clamped(inputs).logits
    assert (free - kept).abs().max() > 1e-3
    torch.testing.assert_close(kept, leaky_clamp(free))


def test_one_scale_has_fewer_weights_than_all() -> None:
    all_scales, one = (HADR(replace(MICRO, aggregation=on)) for on in (True, False))
    assert len(one.state_dict()) < len(all_scales.state_dict())


def test_masked_rays_with_stride_and_start() -> None:
    mask = torch.zeros(2, 5, 6, dtype=torch.bool)
    mask[0, 1:4, 2:5] = True
    mask[1, 3, 3] = True
    assert len(masked_rays(mask)) == 10
    expected = [[0, 1, 3], [0, 3, 3], [1, 3, 3]]
    assert masked_rays(mask, 2, 1, 1).tolist() == expected


def test_ray_points_agree_with_the_camera() -> None:
    depth = np.random.default_rng(0).uniform(0.4, 1.2, CAMERA.shape)
    pixels = torch.ones(1, *CAMERA.shape).nonzero()
    intrinsics = torch.tensor([[CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]], dtype=torch.float64)
    found = ray_points(pixels, torch.from_numpy(depth).flatten(), intrinsics)
    np.testing.assert_allclose(found.numpy(), back_project(depth, CAMERA).reshape(-1, 3))


def test_frame_to_input_squashes_exactly() -> None:
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
    depth = rng.uniform(0.5, 1.0, (24, 32))
    depth[:12] = np.nan
    keypoints = rng.normal(0, 0.05, (21, 3)) + np.array([0, 0, 0.7])
    one = frame_to_input(color, depth, depth > 0.7, keypoints, CAMERA, (16, 8))
    assert one.color.shape == (1, 3, 8, 16)
    assert one.color.min() >= 0
    assert one.color.max() <= 1
    assert torch.all(one.depth[0, :4] == 0)
    assert torch.equal(one.mask, one.depth > 0.7)
    assert one.intrinsics[0].tolist() == pytest.approx([20.0, 40 / 3, 7.5, 3.5])
    fx, fy, cx, cy = one.intrinsics[0].tolist()
    x, y, z = keypoints[4]
    assert one.keypoints_uv[0, 4].tolist() == pytest.approx([fx * x / z + cx, fy * y / z + cy])
    np.testing.assert_allclose(one.color[0, :, 0, 0] * 255, color[:3, :2].mean((0, 1)), atol=0.51)


def test_frame_to_input_names_what_is_wrong() -> None:
    color, depth = np.zeros((24, 32, 3), np.uint8), np.ones((24, 32))
    with pytest.raises(ValueError, match=r"color must be \(24, 32, 3\) uint8, got .* float64"):
        frame_to_input(color.astype(float), depth, depth > 0, None, CAMERA, (16, 8))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"mask must be \(24, 32\).*got \(2, 2\)"):
        frame_to_input(color, depth, np.ones((2, 2), bool), None, CAMERA, (16, 8))
    unknown = frame_to_input(color, depth, depth > 0, None, CAMERA, (16, 8))
    assert torch.all(unknown.keypoints == 0)


def test_an_unknown_hand_feature_is_named() -> None:
    with pytest.raises(ValueError, match=r"hand must be one of .*got '4d'"):
        HADRConfig(hand="4d")  # type: ignore[arg-type]
