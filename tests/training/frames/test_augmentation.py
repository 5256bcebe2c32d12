from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from hadr.models.hadr import HADRConfig
from hadr.models.network_input import HADRInput, ray_points
from hadr.models.window import WindowConfig
from hadr.training.frames.augmentation import augment_frames, draw_camera, other_camera, seen_by
from hadr.training.frames.batches import FrameTensors
from hadr.training.recipe import Preset

INTRINSICS = (70.0, 55.0, 30.0, 25.0)  # a squashed camera: fx and fy differ
HEIGHT, WIDTH = 48, 64
NORMAL = torch.tensor([0.25, -0.4, 1.0])


def plane_frame() -> FrameTensors:
    """The plane normal . p = 0.8, with keypoints and a glass on it."""
    row, column = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    fx, fy, cx, cy = INTRINSICS
    ray = torch.stack([(column - cx) / fx, (row - cy) / fy, torch.ones(HEIGHT, WIDTH)], dim=-1)
    depth = (0.8 / (ray @ NORMAL))[None]
    mask = torch.zeros(1, HEIGHT, WIDTH, dtype=torch.bool)
    mask[:, 18:30, 24:40] = True
    chosen = torch.arange(21)
    keypoints = (ray * depth[0, :, :, None])[10 + chosen, 20 + chosen][None]
    uv = torch.stack([20.0 + chosen, 10.0 + chosen], dim=-1)[None]
    color = torch.rand(1, 3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(0))
    inputs = HADRInput(color, depth * ~mask, mask, torch.tensor([INTRINSICS]), keypoints, uv)
    return FrameTensors(inputs, depth, ~mask, mask, keypoints, ("plane",))


def recipe_with(**changes: Any) -> Preset:
    return Preset("test", WIDTH, HEIGHT, **{"augment": False, **changes})


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("zoom", [1.0, 1.3])
@pytest.mark.parametrize("roll", [0.0, 0.2])
def test_the_plane_stays_where_it_is(mirror: bool, zoom: float, roll: float) -> None:
    frame = plane_frame()
    camera = other_camera(
        INTRINSICS, (WIDTH, HEIGHT), mirror=mirror, zoom=zoom, corner=(5.3, 2.1), roll=roll
    )
    moved = seen_by(frame, camera)
    depth = moved.true_depth
    pixels = (depth > 0).nonzero()
    assert len(pixels) > 0.6 * HEIGHT * WIDTH
    points = ray_points(pixels, depth[depth > 0], moved.inputs.intrinsics)
    back = torch.from_numpy(np.linalg.inv(camera.camera_from_old).T).float()
    height = points @ back @ NORMAL - 0.8
    # The nearest pixel is at most half a pixel off, in rows and in columns.
    assert height.abs().max() < 0.5 * (0.25 / 70 + 0.4 / 55) * float(depth.max()) * 1.05
    # The keypoints lie on the plane, and their pixels are where the new camera sees them.
    assert torch.allclose(moved.true_keypoints @ back @ NORMAL, torch.tensor(0.8), atol=1e-5)
    fx, fy, cx, cy = moved.inputs.intrinsics[0]
    x, y, z = moved.inputs.keypoints[0].unbind(-1)
    seen = torch.stack([fx * x / z + cx, fy * y / z + cy], dim=-1)
    torch.testing.assert_close(moved.inputs.keypoints_uv[0], seen, atol=2e-4, rtol=0)


def test_a_mirror_is_an_exact_flip_and_makes_a_left_hand() -> None:
    frame = plane_frame()
    moved = seen_by(frame, other_camera(INTRINSICS, (WIDTH, HEIGHT), mirror=True))
    assert torch.equal(moved.true_depth, frame.true_depth.flip(2))
    assert torch.equal(moved.object_mask, frame.object_mask.flip(2))
    assert torch.equal(moved.inputs.depth, frame.inputs.depth.flip(2))
    torch.testing.assert_close(moved.inputs.color, frame.inputs.color.flip(3))
    assert moved.inputs.intrinsics[0].tolist() == pytest.approx([70, 55, WIDTH - 1 - 30, 25])
    volume = [torch.linalg.det(f.true_keypoints[0, [0, 5, 20]]) for f in (frame, moved)]
    assert volume[1].item() == pytest.approx(-volume[0].item())


def test_zoom_and_crop_hand_computed() -> None:
    camera = other_camera((10.0, 20.0, 1.5, 2.5), (4, 6), zoom=2.0, corner=(1.0, 2.0))
    # Pixel 1.5 is at 2.0 from the left edge; 1.0 behind the corner; 2.0 after the zoom.
    assert camera.intrinsics.tolist() == pytest.approx([20, 40, 1.5, 1.5])
    np.testing.assert_allclose(camera.pixel_from_old @ [1.5, 2.5, 1], [1.5, 1.5])
    np.testing.assert_allclose(camera.pixel_from_old @ [0.5, 1.5, 1], [-0.5, -0.5], atol=1e-12)


def test_the_drawn_camera_sees_the_whole_object() -> None:
    frame, recipe = plane_frame(), recipe_with(zoom=1.4, roll_deg=12)
    zooms = []
    for seed in range(30):
        camera = draw_camera(frame, recipe, np.random.default_rng(seed))
        moved = seen_by(frame, camera)
        zoom = camera.intrinsics[0] / INTRINSICS[0]
        zooms.append(zoom)
        expected = float(frame.object_mask.sum()) * zoom**2
        assert float(moved.object_mask.sum()) == pytest.approx(expected, rel=0.06)
    assert min(zooms) < 1.1 < 1.3 < max(zooms) <= 1.4


def test_an_object_at_the_edge_keeps_its_camera() -> None:
    frame = plane_frame()
    everywhere = torch.ones_like(frame.object_mask)
    frame = replace(frame, object_mask=everywhere)
    camera = draw_camera(frame, recipe_with(zoom=1.5), np.random.default_rng(0))
    np.testing.assert_array_equal(camera.pixel_from_old, np.eye(3)[:2])


def test_chance_belongs_to_the_frame_and_the_epoch(frames: FrameTensors) -> None:
    recipe = Preset(name="test", width=32, height=24, mirror=0.5, zoom=1.2)
    together = augment_frames(frames.take([3, 1, 5]), [3, 1, 5], recipe, 7, 2)
    alone = augment_frames(frames.take([5]), [5], recipe, 7, 2)
    assert torch.equal(together.inputs.color[2], alone.inputs.color[0])
    assert torch.equal(together.true_depth[2], alone.true_depth[0])
    later = augment_frames(frames.take([3, 1, 5]), [3, 1, 5], recipe, 7, 3)
    assert not torch.equal(together.inputs.color, later.inputs.color)


def test_nothing_to_change_changes_nothing(frames: FrameTensors) -> None:
    same = augment_frames(frames, range(len(frames)), recipe_with(), 0, 0)
    assert same is frames


def test_colours_change_only_where_they_are_augmented() -> None:
    frame = plane_frame()
    color = frame.inputs.color

    def seen(**changes: Any) -> torch.Tensor:
        return augment_frames(frame, [0], recipe_with(**changes), 0, 0).inputs.color

    assert torch.equal(seen(keypoint_noise=0.01), color)
    torch.testing.assert_close(seen(mirror=1.0), color.flip(3))
    assert (seen(augment=True) - color).abs().max() > 0.1


def test_windows_laid_by_chance_show_the_same_plane() -> None:
    frame = plane_frame()
    recipe = recipe_with(model=HADRConfig(view=WindowConfig(size=32, jitter=0.2)))
    twice = FrameTensors.join([frame, frame])
    seen = augment_frames(twice, [0, 1], recipe, 0, 0)
    cameras = seen.inputs.intrinsics
    assert not torch.isclose(cameras[0], cameras[1], rtol=1e-3).any()
    known = seen.true_depth > 0
    assert known.float().mean() > 0.7
    assert torch.isin(seen.true_depth[known], frame.true_depth).all()
    points = ray_points(known.nonzero(), seen.true_depth[known], cameras)
    # The nearest pixel is at most half a pixel off, in rows and in columns.
    off = 0.5 * (0.25 / 70 + 0.4 / 55) * float(frame.true_depth.max()) * 1.05
    assert (points @ NORMAL - 0.8).abs().max() < off
    assert torch.equal(seen.object_mask, seen.inputs.mask)
    assert torch.equal(seen.hand_mask, known & ~seen.object_mask)


def test_unknown_keypoints_stay_unknown() -> None:
    frame = plane_frame()
    zeros = torch.zeros_like(frame.inputs.keypoints)
    unknown = replace(frame.inputs, keypoints=zeros, keypoints_uv=zeros[..., :2])
    recipe = recipe_with(mirror=1.0, zoom=1.2, keypoint_noise=0.01)
    moved = augment_frames(replace(frame, inputs=unknown), [0], recipe, 0, 0)
    assert not moved.inputs.keypoints.any()
    assert not moved.inputs.keypoints_uv.any()


def test_noisy_keypoints_move_alike_and_each_for_itself_and_the_truth_stays() -> None:
    frame, sigma = plane_frame(), 0.004
    errors = []
    for number in range(400):
        noisy = augment_frames(frame, [number], recipe_with(keypoint_noise=sigma), 0, 0)
        errors.append((noisy.inputs.keypoints - frame.inputs.keypoints)[0].double())
        assert torch.equal(noisy.true_keypoints, frame.true_keypoints)
    found = torch.stack(errors)  # (frames, 21, 3)
    assert float(found.std()) == pytest.approx(sigma, rel=0.06)
    assert float(found.mean(dim=1).std()) == pytest.approx(sigma * np.sqrt(0.5 * 22 / 21), rel=0.1)
    fx, _, cx, _ = INTRINSICS
    x, _, z = noisy.inputs.keypoints[0].T
    torch.testing.assert_close(noisy.inputs.keypoints_uv[0, :, 0], fx * x / z + cx)
