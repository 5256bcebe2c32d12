import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hadr.data.splits import leaked_share, split_by_frame, split_by_holding, split_by_object
from hadr.synthesis.generation.settings import hold_split
from hadr.synthesis.glass.objects import OBJECTS

HOLDS = [f"0000-side-{i // 3:04d}" for i in range(300)]


def test_by_frame_keeps_the_ratio_and_leaks():
    split = split_by_frame(300, np.random.default_rng(0))
    assert [(split == name).sum() for name in ("train", "val", "test")] == [210, 60, 30]
    # A test frame has two twins; both miss the training set with probability 0.3^2.
    assert leaked_share(split, HOLDS) > 0.75


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(10, 60), st.integers(1, 5))
def test_by_holding_never_leaks(seed, n_holds, frames_per_hold):
    holds = [f"h{i % n_holds}" for i in range(n_holds * frames_per_hold)]
    split = split_by_holding(holds, np.random.default_rng(seed))
    groups = {name: {h for h, s in zip(holds, split, strict=True) if s == name} for name in split}
    assert sum(len(g) for g in groups.values()) == n_holds
    if "test" in split:
        assert leaked_share(split, holds) == 0.0


def test_by_object_holds_the_unknown_ones_out():
    objects = ["0000", "0004", "0001", "0007", "0004"]
    split = split_by_object(objects)
    assert split.tolist() == ["train", "test", "train", "test", "test"]
    assert leaked_share(split, objects) == 0.0


@pytest.mark.parametrize("object_id", OBJECTS)
def test_each_ten_holds_are_split_seven_to_two_to_one(object_id):
    for first in range(0, 100, 10):
        names = [hold_split(i, object_id) for i in range(first, first + 10)]
        assert [names.count(n) for n in ("train", "val", "test")] == [7, 2, 1]


def test_thirty_holds_an_object_test_every_kind_with_some_object():
    """Kinds of hold come in turns of eight."""
    kinds = {name: set() for name in ("train", "val", "test")}
    for object_id in OBJECTS:
        own = set()
        for number in range(30):
            split = hold_split(number, object_id)
            kinds[split].add(number % 8)
            own |= {number % 8} if split == "train" else set()
        assert len(own) == 8  # every object is trained on with all kinds
    assert all(len(found) == 8 for found in kinds.values())


def test_leaked_share_by_hand():
    split = np.array(["train", "test", "test", "val"])
    assert leaked_share(split, ["a", "a", "b", "b"]) == 0.5


def test_errors():
    with pytest.raises(ValueError, match="three weights train:val:test, got"):
        split_by_frame(10, np.random.default_rng(0), (7, 3))
    with pytest.raises(ValueError, match="none of the frames shows 0004, 0007"):
        split_by_object(["0000"])
    with pytest.raises(ValueError, match="2 splits, but 1 groups"):
        leaked_share(np.array(["train", "test"]), ["a"])
    with pytest.raises(ValueError, match="there is no test frame"):
        leaked_share(np.array(["train"]), ["a"])
