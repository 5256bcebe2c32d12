"""Windows around hand and glass: where they lie, what they show, and the way back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from hadr.models.blocks.efficientnet_lite import EfficientNetLite0
from hadr.models.network_input import DepthOutput, HADRInput, ray_points
from hadr.models.networks import DEPTH_NETWORKS, network_of
from hadr.models.window import WindowConfig, lay_windows, seen_through, through_window
from hadr.training.presets import preset
from hadr.training.tasks.task import Task

HEIGHT, WIDTH = 60, 80


def wall(count: int = 1, slope: float = 0.004) -> HADRInput:
    """A slanted wall, colour that tells the pixel, a mask of 12x8 pixels, a hand beside it."""
    column = torch.arange(WIDTH).float().expand(count, HEIGHT, WIDTH)
    row = torch.arange(HEIGHT).float()[:, None].expand(count, HEIGHT, WIDTH)
    mask = torch.zeros(count, HEIGHT, WIDTH, dtype=torch.bool)
    mask[:, 20:28, 30:42] = True
    intrinsics = torch.tensor([[70.0, 72.0, 39.5, 29.5]]).expand(count, 4)
    uv = torch.stack((torch.linspace(38, 49, 21), torch.linspace(22, 31, 21)), dim=1)
    uv = uv.expand(count, 21, 2)
    depth = 0.5 + slope * column
    near = torch.full((count, 21, 1), 0.6)
    keypoints = torch.cat(((uv - 39.5) / 70 * near, near), dim=2)
    color = torch.stack((column / WIDTH, row / HEIGHT, torch.zeros_like(row)), dim=1)
    return HADRInput(color, depth, mask, intrinsics, keypoints, uv)


def test_a_window_lies_around_mask_and_keypoints() -> None:
    crop = lay_windows(wall(), WindowConfig(size=48, margin=1.5))
    # Columns 30 to 49, rows 20 to 31: 20 and 12 pixels, so the side is 1.5 x 20.
    assert crop.center.tolist() == [[39.5, 25.5]]
    assert crop.step[0].tolist() == pytest.approx([30 / 48, 30 / 48])


def test_a_hand_that_is_unknown_or_outside_does_not_count() -> None:
    config = WindowConfig(size=24, margin=1)
    frame = wall()
    alone = replace(frame, keypoints_uv=torch.zeros(1, 21, 2), keypoints=torch.zeros(1, 21, 3))
    crop = lay_windows(alone, config)
    assert crop.center.tolist() == [[35.5, 23.5]]
    assert crop.step[0].tolist() == [0.5, 0.5]
    away = replace(frame, keypoints_uv=frame.keypoints_uv + 1000)
    assert torch.equal(lay_windows(away, config).center, crop.center)
    empty = replace(alone, mask=torch.zeros_like(frame.mask))
    crop = lay_windows(empty, config)
    assert crop.center.tolist() == [[39.5, 29.5]]
    assert float(crop.step[0, 0]) * 24 == pytest.approx(80)


def test_the_jitter_stays_in_its_range() -> None:
    config = WindowConfig(size=48, margin=1.5, jitter=0.2)
    crop = lay_windows(wall(200), config, torch.Generator().manual_seed(1))
    side = crop.step[:, 0] * 48
    assert 24 - 1e-4 <= float(side.min()) < 25
    assert 35 < float(side.max()) <= 36 + 1e-4
    moved = (crop.center - torch.tensor([39.5, 25.5])).abs() / side[:, None]
    assert 0.18 < float(moved.max()) <= 0.2 + 1e-5


def test_some_training_frames_are_seen_whole() -> None:
    config = WindowConfig(size=40, margin=1.5, jitter=0, whole=0.25)
    crop = lay_windows(wall(400), config, torch.Generator().manual_seed(1))
    whole = crop.step[:, 0] == WIDTH / 40
    assert 70 <= int(whole.sum()) <= 130
    assert crop.center[whole][0].tolist() == [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]
    assert set(crop.step[~whole][:, 0].tolist()) == {0.75}
    assert not bool((lay_windows(wall(9), config).step == 2).any())


def test_the_window_is_a_camera_that_sees_the_same_points() -> None:
    frame = wall()
    crop = lay_windows(frame, WindowConfig(size=60, margin=1.5))  # half a pixel a step
    seen = seen_through(crop, frame)
    assert seen.color.shape == (1, 3, 60, 60)
    assert int(seen.mask.sum()) == 4 * int(frame.mask.sum())
    # Colour tells the pixel of the frame that is seen; the pixel's point must be that one's.
    pixels = torch.tensor([[0, 30, 31], [0, 12, 44], [0, 55, 8]])
    here = ray_points(pixels, torch.ones(3), seen.intrinsics)
    column, row = seen.color[0, :2, pixels[:, 1], pixels[:, 2]] * torch.tensor([[80.0], [60.0]])
    there = torch.stack(((column - 39.5) / 70, (row - 29.5) / 72, torch.ones(3)), dim=1)
    torch.testing.assert_close(here, there, atol=1e-5, rtol=0)
    # Keypoints stay where they are, and their pixels are their projection.
    assert torch.equal(seen.keypoints, frame.keypoints)
    at = seen.keypoints_uv[0]
    z = seen.keypoints[0, :, 2]
    fx, _, cx, _ = seen.intrinsics[0]
    torch.testing.assert_close(seen.keypoints[0, :, 0] / z * fx + cx, at[:, 0], atol=1e-3, rtol=0)
    assert float(seen.depth[0, 30, 31]) == pytest.approx(0.5 + 0.004 * 40, abs=1e-6)


def test_beyond_the_picture_nothing_is_there() -> None:
    frame = wall()
    mask = torch.zeros_like(frame.mask)
    mask[:, 0:30, 0:6] = True
    frame = replace(frame, mask=mask, keypoints_uv=torch.zeros(1, 21, 2))
    seen = seen_through(lay_windows(frame, WindowConfig(size=40, margin=1)), frame)
    assert not bool(seen.depth[:, :, :15].any())
    assert not bool(seen.mask[:, :, :15].any())
    assert bool((seen.depth[:, :, 18:] > 0).all())


@dataclass(frozen=True)
class Config:
    view: WindowConfig | None


class Echo(nn.Module):
    """Answers with the depth that it is given, but for some columns of the picture."""

    def __init__(self, view: WindowConfig | None, without: float = -1.0) -> None:
        super().__init__()
        self.config, self.without = Config(view), without
        self.sizes: list[tuple[int, ...]] = []

    @through_window
    def forward(self, inputs: HADRInput) -> DepthOutput:
        self.sizes.append(tuple(inputs.depth.shape))
        column = inputs.color[:, 0] * WIDTH
        restored = inputs.mask & ((column < self.without) | (column > self.without + 3))
        return DepthOutput(inputs.depth * restored, restored)


@pytest.mark.parametrize("size", [30, 60, 47])
def test_the_answer_comes_back_to_the_frame(size: int) -> None:
    frame = wall(2)
    model = Echo(WindowConfig(size=size, margin=1.5)).eval()
    answer = model(frame)
    assert model.sizes == [(2, size, size)]
    assert torch.equal(answer.restored, frame.mask)
    # Half a window pixel of the slope is the most that nearest pixels can be off.
    error = (answer.depth - frame.depth)[frame.mask].abs().max()
    assert float(error) <= 0.004 * max(30 / size, 1) / 2 + 1e-6
    assert not bool(answer.depth[~frame.mask].any())


def test_a_round_outline_is_restored_to_its_last_pixel() -> None:
    frame = wall()
    row, column = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    disc = (row - HEIGHT / 2) ** 2 + (column - WIDTH / 2) ** 2 < (HEIGHT / 3) ** 2
    frame = replace(frame, mask=disc[None])
    config = WindowConfig(size=40, margin=1.3)
    answer = Echo(config).eval()(frame)
    assert torch.equal(answer.restored, frame.mask)
    # At the outline a pixel takes the depth of one that is a window's pixel beside it at most.
    pixel = float(lay_windows(frame, config).step.max())
    error = float((answer.depth - frame.depth)[frame.mask].abs().max())
    assert error <= 0.004 * 1.5 * pixel


def test_a_hole_in_the_answer_stays_one_and_draws_nothing_to_zero() -> None:
    frame = wall(slope=0.0)
    answer = Echo(WindowConfig(size=90, margin=1.5), without=34.0).eval()(frame)
    assert set(np.nonzero(~answer.restored[0, 24].numpy() & frame.mask[0, 24].numpy())[0]) == {
        34, 35, 36, 37,
    }  # fmt: skip
    assert answer.depth[answer.restored].tolist() == pytest.approx([0.5] * 64)


@dataclass(frozen=True)
class Marked(DepthOutput):
    """An answer of which some pixels are at the end of their voxel."""

    clamped: torch.Tensor


class MarkingEcho(Echo):
    """Marks what lies below row 23 of the picture."""

    @through_window
    def forward(self, inputs: HADRInput) -> Marked:
        low = inputs.color[:, 1] * HEIGHT > 23.5
        return Marked(inputs.depth * inputs.mask, inputs.mask, inputs.mask & low)


def test_marks_of_the_answer_come_back_to_the_pixels_that_they_are_of() -> None:
    frame = wall()
    answer = MarkingEcho(WindowConfig(size=60, margin=1.5)).eval()(frame)
    low = torch.arange(HEIGHT)[:, None] >= 24
    assert torch.equal(answer.clamped, frame.mask & low)
    assert torch.equal(answer.restored, frame.mask)


def test_in_training_and_without_a_view_the_frame_is_taken_as_it_is() -> None:
    frame = wall()
    for model in (Echo(None).eval(), Echo(WindowConfig(size=30)).train()):
        assert torch.equal(model(frame).depth, frame.depth * frame.mask)
        assert model.sizes == [(1, HEIGHT, WIDTH)]


@pytest.mark.parametrize("kind", [kind for kind in DEPTH_NETWORKS if kind != "hadr-plus"])
def test_each_network_can_look_through_a_window(kind: str) -> None:
    recipe = preset("tiny", kind)
    torch.manual_seed(0)
    model = replace(recipe.model, view=WindowConfig(size=32))  # type: ignore[call-arg]
    network = Task(replace(recipe, model=model)).build().eval()
    frame = wall(2)
    frame = replace(frame, depth=frame.depth * ~frame.mask)
    sizes: list[tuple[int, ...]] = []
    first = next(part for part in network.modules() if isinstance(part, nn.Conv2d))
    first.register_forward_pre_hook(lambda _, given: sizes.append(tuple(given[0].shape)))
    with torch.no_grad():
        answer = network(frame)
    assert answer.depth.shape == (2, HEIGHT, WIDTH)
    assert not bool((answer.restored & ~frame.mask).any())
    assert max(sizes[0][2:]) <= 34
    assert network_of(kind).config_class()().view is None


SEEING = [kind for kind in DEPTH_NETWORKS if getattr(preset("imagenet", kind).model, "lite", None)]


@pytest.mark.parametrize("kind", SEEING)
def test_a_pretrained_encoder_gets_colours_as_they_are(kind: str) -> None:
    network = Task(preset("imagenet", kind)).build().eval()
    (encoder,) = (part for part in network.modules() if isinstance(part, EfficientNetLite0))
    seen: list[Tensor] = []
    encoder.register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    with torch.no_grad():
        network(wall())
    assert seen
    assert all(color.min() >= 0 and color.max() <= 1 for color in seen)


@pytest.mark.parametrize("name", ["rays", "true_depth"])
def test_what_is_of_the_whole_frame_is_refused_in_a_window(name: str) -> None:
    recipe = preset("tiny")
    model = replace(recipe.model, view=WindowConfig(size=32))  # type: ignore[call-arg]
    network = Task(replace(recipe, model=model)).build().eval()
    with pytest.raises(ValueError, match=f"{name} of the whole frame"):
        network(wall(), **{name: wall().depth})


@pytest.mark.parametrize("wrong", [{"size": 0}, {"margin": 0.9}, {"jitter": 0.6}, {"whole": 2}])
def test_wrong_numbers_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="a window's size must be at least 1"):
        WindowConfig(**wrong)  # type: ignore[arg-type]
