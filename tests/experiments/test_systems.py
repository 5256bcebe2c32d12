from dataclasses import replace

import pytest

from hadr.experiments.systems import LONG_RUN, LONGER, recipe_of
from hadr.training.losses import CODED


@pytest.mark.parametrize("method", LONGER)
def test_long_runs_have_more_epochs_and_larger_batches(method):
    network, batch = LONGER[method]
    base, long = recipe_of(network, "imagenet"), recipe_of(method, "imagenet")
    assert long == replace(
        base, epochs=4 * base.epochs, drop_epoch=4 * base.drop_epoch, batch_size=batch
    )
    assert batch > base.batch_size


def test_systems_differ_from_hadr_in_one_thing():
    base = recipe_of("hadr", "mini")
    long, handless = recipe_of("hadr-long", "mini"), recipe_of("no-hand", "mini")
    assert (long.epochs, long.drop_epoch) == (LONG_RUN * base.epochs, LONG_RUN * base.drop_epoch)
    assert replace(long, epochs=base.epochs, drop_epoch=base.drop_epoch) == base
    assert handless.model.hand == "none"
    assert replace(handless, model=replace(handless.model, hand="3d")) == base
    assert recipe_of("raw", "mini") is None
    for name, fields in {
        "no-aggregation": {"aggregation": True},
        "no-point-fusion": {"point_fusion": True},
        "hand-2d": {"hand": "3d"},
        "wrist-translation": {"wrist_rotation": True},
        "clamped-probability": {"clamp_probability": False},
    }.items():
        changed = recipe_of(name, "mini")
        assert changed != base
        assert replace(changed, model=replace(changed.model, **fields)) == base
    coded = recipe_of("coded-weights", "mini")
    assert coded.weights == CODED
    assert replace(coded, weights=base.weights) == base
    with pytest.raises(ValueError, match=r"method must be one of .* got 'gan'"):
        recipe_of("gan", "mini")


def test_preset_imagenet_is_measured_without_its_weights_and_without_its_window():
    base = recipe_of("hadr", "imagenet")
    unlearned, whole = (recipe_of(n, "imagenet") for n in ("random-encoder", "whole-picture"))
    assert (unlearned.model.lite.pretrained, unlearned.model.lite.frozen) == (False, 0)
    learned = replace(unlearned, model=replace(unlearned.model, lite=base.model.lite))
    assert (unlearned.encoder_rate, replace(learned, encoder_rate=base.encoder_rate)) == (1.0, base)
    assert (whole.model.view, whole.size, whole.ray_stride) == (None, (128, 72), 2)
    lone, thawed = (recipe_of(n, "imagenet") for n in ("no-aggregation", "no-aggregation-thawed"))
    assert (lone.model.lite.frozen, thawed.model.lite.frozen) == (1, 0)
    assert replace(thawed, model=replace(thawed.model, lite=base.model.lite)) == lone
    assert recipe_of("no-augmentation", "imagenet") == replace(base, augment=False)
    flat = recipe_of("hand-xy", "imagenet")
    assert (flat.model.hand, replace(flat.model, hand="3d")) == ("xy", base.model)
    coarse = recipe_of("six-cells", "imagenet").model
    assert (coarse.grid.voxel_size, replace(coarse, grid=base.model.grid)) == (1 / 3, base.model)
    moved = recipe_of("cells-from-zero", "imagenet").model.grid
    assert (moved.voxel_size, moved.origin) == (0.25, (-1.125, -1.125, 0.0))
    assert base.model.grid.origin == (-1.125, -1.125, -0.125)
    with pytest.raises(ValueError, match="got 'random-encoder'"):
        recipe_of("random-encoder", "mini")  # it has no such encoder
