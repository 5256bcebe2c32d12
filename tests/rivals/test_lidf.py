from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from hadr.confidence.calibration import within_learned
from hadr.models.backbone import imagenet_normal
from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.network_input import HADRInput
from hadr.models.ray_features import features_at
from hadr.rivals.lidf import LIDF, DilatedResNet, DilatedResNetConfig, LIDFConfig, Refinement

MICRO = LIDFConfig(
    backbone=DilatedResNetConfig(depths=(1, 1, 1, 1), widths=(8, 8, 8, 8)),
    decoder_widths=(16, 8),
    voxel_width=24,
    max_points=500,
)


def scene(frames: int = 1, wall: float = 1.0, glass: float = 0.6) -> HADRInput:
    """A wall, before it a glass without depth, at its left a strip of hand."""
    generator = torch.Generator().manual_seed(3)
    depth = torch.full((frames, 24, 32), wall)
    depth[:, 8:16, 8:12] = glass
    mask = torch.zeros_like(depth, dtype=torch.bool)
    mask[:, 8:16, 12:20] = True
    intrinsics = torch.tensor([[40.0, 40.0, 15.5, 11.5]])
    return HADRInput(
        color=torch.rand(frames, 3, 24, 32, generator=generator),
        depth=depth * ~mask,
        mask=mask,
        intrinsics=intrinsics.repeat(frames, 1),
        keypoints=torch.zeros(frames, 21, 3),
        keypoints_uv=torch.zeros(frames, 21, 2),
    )


def refining(config: LIDFConfig = MICRO, seed: int = 0) -> LIDF:
    """A network in stage 2 whose refinement moves points by random lengths."""
    torch.manual_seed(seed)
    model = LIDF(config)
    nn.init.normal_(model.refinement.offset_decoder.decoder.rest[-1].weight)
    model.set_stage(2)
    return model.eval()


def moving(offset: float, config: LIDFConfig = MICRO) -> LIDF:
    """A network in stage 2 whose refinement always gives this offset in 0..1 before the clamp."""
    torch.manual_seed(0)
    model = LIDF(config)
    decoder = model.refinement.offset_decoder
    nn.init.zeros_(decoder.decoder.rest[-1].weight)
    nn.init.constant_(decoder.decoder.rest[-1].bias, (offset - 0.001) / 2)
    model.set_stage(2)
    return model.eval()


def test_the_decoders_input_is_385_wide_and_the_refinements_334() -> None:
    config = LIDFConfig()
    assert config.first_stage.parts == (155, 128, 102)
    assert sum(config.first_stage.parts) == 385
    parts = Refinement(config).offset_decoder.decoder.first.parts[:3]
    assert parts == (155, 128, 51)
    assert sum(parts) == 334
    assert config.hand == "none"


def test_the_colours_are_normalised_for_network_and_voxels_alike() -> None:
    inputs = scene()
    taken: list[Tensor] = []
    model = LIDF(MICRO).eval()
    encoder = model.first.voxel_features.forward

    def watch(points: Tensor, color: Tensor, *rest: Tensor) -> Tensor:
        taken.append(color)
        result: Tensor = encoder(points, color, *rest)
        return result

    object.__setattr__(model.first.voxel_features, "forward", watch)
    normal = model(inputs)
    shown = replace(inputs, color=imagenet_normal(inputs.color))
    plain = LIDF(replace(MICRO, normalize_color=False)).eval()
    plain.load_state_dict(model.state_dict())
    assert torch.equal(plain(shown).depth, normal.depth)
    pixel = (inputs.depth[0] > 0).nonzero()[0]
    assert torch.allclose(taken[0][0], shown.color[0][:, pixel[0], pixel[1]])


def test_colours_are_not_normalised_twice() -> None:
    with pytest.raises(ValueError, match="normalize_color must be False with it, got True"):
        LIDFConfig(lite=LiteConfig())
    LIDFConfig(lite=LiteConfig(), normalize_color=False)


def test_each_point_moves_along_its_ray_by_at_most_the_range() -> None:
    model, inputs = refining(), scene(2)
    output = model(inputs)
    assert output.moves.abs().max() <= 0.2
    assert output.moves.abs().max() > 0.05
    assert (output.moves.abs() < 0.2).any()
    first, last = output.first_points, output.points
    direction = nn.functional.normalize(first, dim=1)
    along = (last * direction).sum(dim=1)
    torch.testing.assert_close(last, along[:, None] * direction)
    torch.testing.assert_close(along, first.norm(dim=1) + output.moves.sum(dim=1))
    frame, row, column = output.rays.unbind(dim=1)
    torch.testing.assert_close(output.depth[frame, row, column], last[:, 2])
    # The first stage's own answer is that of the first stage alone.
    model.set_stage(1)
    assert torch.equal(model(inputs).points, first)


@pytest.mark.parametrize(("offset", "move"), [(0.75, 0.1), (40.0, 0.2), (-40.0, -0.2)])
def test_the_offset_spans_the_range_and_is_cut_off_at_its_ends(offset, move, in_double):
    # By 0.4 m to the camera, too: the answers lie farther off than that.
    model, inputs = in_double(moving(offset), scene(wall=1.4, glass=1.1))
    output = model(inputs)
    assert output.moves.shape == (64, 2)
    torch.testing.assert_close(output.moves.float(), torch.full((64, 2), move))
    distance = output.points.norm(dim=1) - output.first_points.norm(dim=1)
    torch.testing.assert_close(distance, output.moves.sum(dim=1), atol=1e-12, rtol=0)
    assert torch.equal(output.clamped, output.restored & (abs(move) == 0.2))
    assert within_learned(output, None).any() == (abs(move) < 0.2)


def test_a_cut_off_move_still_has_a_gradient() -> None:
    model = moving(40.0).train()
    model(scene(wall=1.4, glass=1.1)).points.sum().backward()
    bias = model.refinement.offset_decoder.decoder.rest[-1].bias
    assert isinstance(bias.grad, Tensor)
    assert bias.grad.abs().sum() > 0


def test_without_an_offset_the_first_stages_answer_stays() -> None:
    inputs = scene(2)
    for model in (moving(0.5), LIDF(MICRO).eval()):  # set by hand, and as a fresh network starts
        model.set_stage(1)
        first = model(inputs)
        model.set_stage(2)
        output = model(inputs)
        assert first.moves.shape[1] == 0
        assert output.moves.shape[1] == 2
        torch.testing.assert_close(output.moves, torch.zeros(128, 2), atol=1e-6, rtol=0)
        torch.testing.assert_close(output.depth, first.depth, atol=1e-6, rtol=0)
        assert torch.equal(output.restored, first.restored)


def test_what_is_perturbed_is_refined_from_there() -> None:
    inputs = scene()
    output = moving(0.5)(inputs, perturbation_m=0.07)
    direction = nn.functional.normalize(output.first_points, dim=1)
    torch.testing.assert_close(output.points, output.first_points + 0.07 * direction)
    still = moving(0.5)(inputs)
    assert torch.equal(output.first_points, still.first_points)
    model = refining()
    assert not torch.equal(model(inputs).moves, model(inputs, perturbation_m=0.07).moves)


@pytest.mark.parametrize(
    ("perturbation", "inside", "as_chosen"),
    [(-0.05, True, True), (-0.5, True, False), (0.08, False, True)],
    ids=["in the chosen voxel", "in the glass's, before it", "in none, behind it"],
)
def test_answers_and_their_colours_join_the_points_of_the_voxel_in_which_they_lie(
    perturbation: float, inside: bool, as_chosen: bool
) -> None:
    model, inputs = refining(replace(MICRO, refine_iterations=1)), scene()
    taken: dict[str, Tensor] = {}
    encoder = model.refinement.voxel_features
    encode = encoder.forward

    def watch(points: Tensor, color: Tensor, voxel: Tensor, centers: Tensor) -> Tensor:
        taken.update(points=points, color=color, voxel=voxel, centers=centers)
        return encode(points, color, voxel, centers)

    object.__setattr__(encoder, "forward", watch)
    nn.init.zeros_(model.first.probability_decoder.rest[-1].weight)
    first = nn.Parameter(torch.tensor([0.25]))  # every first answer lies in a voxel's middle
    model.first.offset_decoder.decoder.rest[-1].bias = first
    nn.init.zeros_(model.first.offset_decoder.decoder.rest[-1].weight)
    true_depth = torch.full_like(inputs.depth, 1.0)  # and that voxel is the wall's
    output = model(inputs, true_depth=true_depth, perturbation_m=perturbation)
    rays = len(output.rays)
    direction = nn.functional.normalize(output.first_points, dim=1)
    answers = output.first_points + perturbation * direction
    torch.testing.assert_close(taken["points"][-rays:], answers)
    picture = imagenet_normal(inputs.color)
    assert torch.equal(taken["color"][-rays:], features_at(picture, output.rays))
    voxel = taken["voxel"][-rays:]
    away = (answers - taken["centers"][voxel]).abs().max(dim=1).values
    assert torch.equal(away <= 0.125, torch.full((rays,), inside))
    chosen = output.pairs.voxel[output.chosen]
    assert torch.equal(voxel == chosen, torch.full((rays,), as_chosen))
    # All measured points of these voxels are there, and no others.
    measured = output.occupied.point_voxel
    assert torch.equal(taken["voxel"][:-rays], measured[torch.isin(measured, voxel)])


def test_an_answer_outside_of_all_occupied_voxels_counts_to_its_chosen_one() -> None:
    model, inputs = refining(), scene()
    far = model(inputs, perturbation_m=30.0)
    assert torch.isfinite(far.depth).all()
    assert torch.all(far.depth[inputs.mask] > 25)
    behind = model(inputs, perturbation_m=-30.0)
    assert not behind.restored.any()
    assert torch.all(behind.depth == 0)


def test_rays_without_candidate_are_not_restored() -> None:
    inputs = scene(2)
    depth = inputs.depth.clone()
    depth[0] = 0  # no point in frame 0, in frame 1 only the strip at its left
    depth[1, :, 12:] = 0
    mask = inputs.mask.clone()
    mask[1, 8:16, 31] = True  # so far to the right that the rays pass by the strip's voxel
    output = refining()(replace(inputs, depth=depth, mask=mask))
    lost = output.chosen < 0
    assert 0 < lost.sum() < len(lost)
    assert not output.restored[0].any()
    assert output.restored[1].any()
    assert not output.restored[1][:, 31].any()
    assert torch.all(output.depth[~output.restored] == 0)
    assert torch.all(output.points[lost] == 0)
    assert torch.all(output.moves[lost] == 0)
    empty = refining()(replace(inputs, mask=torch.zeros_like(mask)))
    assert not empty.restored.any()


def test_the_stage_is_a_part_of_the_state() -> None:
    inputs, model = scene(), refining()
    other = LIDF(MICRO).eval()
    assert not other.refines
    other.load_state_dict(model.state_dict())
    assert other.refines
    assert torch.equal(other(inputs).depth, model(inputs).depth)


def test_without_refinement_there_is_one_stage() -> None:
    model = LIDF(replace(MICRO, refine=False)).eval()
    assert not any(name.startswith("refinement") for name, _ in model.named_parameters())
    assert model(scene()).restored.any()


SMALL_COLOR = DilatedResNetConfig(depths=(1, 1, 2, 1), widths=(4, 8, 8, 16))


def test_the_colour_network_is_resnet_34_and_a_convolution_to_32_channels() -> None:
    count = sum(p.numel() for p in DilatedResNet(DilatedResNetConfig()).parameters())
    assert count == 21_797_672 - 513_000 + 512 * 32 + 32


@pytest.mark.parametrize("size", [(72, 128), (126, 224), (33, 50)])
def test_the_stride_stays_8(size: tuple[int, int]) -> None:
    model = DilatedResNet(SMALL_COLOR, channels=5).eval()
    coarse = []
    model.reduce.register_forward_hook(lambda *seen: coarse.append(seen[2].shape))
    dense = model(torch.rand(2, 3, *size))
    assert coarse == [(2, 5, -(-size[0] // 8), -(-size[1] // 8))]
    assert dense.shape == (2, 5, *size)


def test_kernels_reach_twice_and_four_times_as_far_where_the_stride_is_gone() -> None:
    model = DilatedResNet(SMALL_COLOR)
    stages = model.resnet.encoder.stages
    for stage, stride, dilation in zip(stages, (1, 2, 1, 1), (1, 1, 2, 4), strict=True):
        layers = [m for m in stage.modules() if isinstance(m, torch.nn.Conv2d)]
        wide = [layer for layer in layers if layer.kernel_size == (3, 3)]
        assert layers[0].stride == (stride, stride) or stride == 1
        assert max(layer.stride[0] for layer in layers) == stride
        assert {layer.dilation for layer in wide} == {(dilation, dilation)}
        assert {layer.padding for layer in wide} == {(dilation, dilation)}
