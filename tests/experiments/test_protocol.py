import hashlib
from dataclasses import replace

import pytest

from hadr.data.samples import samples_dir
from hadr.data.splits import UNKNOWN_OBJECTS
from hadr.data.transhand import SPLITS
from hadr.experiments.protocol import LONG_RUN, LONGER, data_digest, open_part, recipe_of
from hadr.synthesis.glass.objects import OBJECTS
from hadr.training.losses import CODED


@pytest.fixture(scope="module")
def frames():
    return samples_dir() / "frames"


def test_known_parts_are_the_folders_splits(frames):
    parts = {part: open_part([frames], "known", part) for part in SPLITS}
    assert [len(parts[part]) for part in SPLITS] == [336, 96, 48]
    assert all(part.objects == tuple(sorted(OBJECTS)) for part in parts.values())


def test_unknown_objects_are_in_no_part_but_the_test(frames):
    train, val, test = (open_part([frames], "unknown", part) for part in SPLITS)
    assert set(test.objects) == set(UNKNOWN_OBJECTS)
    assert not set(UNKNOWN_OBJECTS) & (set(train.objects) | set(val.objects))
    assert set(train.objects) == set(OBJECTS) - set(UNKNOWN_OBJECTS)
    assert len(test) == 120  # all frames of the two objects, whatever their split
    assert not set(train.names) & {*val.names, *test.names}


def test_wrong_names_are_told(frames):
    with pytest.raises(ValueError, match=r"experiment must be one of .* got 'novel'"):
        open_part([frames], "novel", "test")
    with pytest.raises(ValueError, match="no data folder"):
        open_part([], "known", "test")


def test_digest_is_that_of_names_and_contents(tmp_path):
    for name, text in (("b.txt", "two"), ("a/c.txt", "one"), (".hidden", "x")):
        path = tmp_path / "set" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    by_hand = b"".join(
        name + hashlib.sha256(text).digest()
        for name, text in ((b"a/c.txt", b"one"), (b"b.txt", b"two"))
    )
    assert data_digest(tmp_path / "set") == hashlib.sha256(by_hand).hexdigest()
    before = data_digest(tmp_path / "set")
    (tmp_path / "set" / "b.txt").rename(tmp_path / "set" / "d.txt")
    assert data_digest(tmp_path / "set") != before
    with pytest.raises(FileNotFoundError, match="no files in the data folder"):
        data_digest(tmp_path / "nowhere")


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
    with pytest.raises(ValueError, match="got 'random-encoder'"):
        recipe_of("random-encoder", "mini")  # it has no such encoder
