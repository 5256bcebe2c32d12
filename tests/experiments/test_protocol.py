import pytest

from hadr.data.samples import samples_dir
from hadr.data.splits import UNKNOWN_OBJECTS
from hadr.data.transhand import SPLITS
from hadr.experiments.protocol import open_part
from hadr.synthesis.glass.objects import OBJECTS


@pytest.fixture(scope="module")
def frames():
    return samples_dir() / "frames"


def test_known_parts_are_the_folders_splits(frames):
    parts = {part: open_part([frames], "known", part) for part in SPLITS}
    assert [len(parts[part]) for part in SPLITS] == [336, 96, 48]
    for part in parts.values():
        assert {name.partition("/")[0] for name in part.names} == set(OBJECTS)


def test_unknown_objects_are_in_no_part_but_the_test(frames):
    train, val, test = parts = [open_part([frames], "unknown", part) for part in SPLITS]
    learned, chosen, tried = ({name.partition("/")[0] for name in part.names} for part in parts)
    assert tried == set(UNKNOWN_OBJECTS)
    assert not tried & (learned | chosen)
    assert learned == set(OBJECTS) - tried
    assert len(test) == 120  # all frames of the two objects, whatever their split
    assert not set(train.names) & {*val.names, *test.names}


def test_wrong_names_are_told(frames):
    with pytest.raises(ValueError, match=r"experiment must be one of .* got 'novel'"):
        open_part([frames], "novel", "test")
    with pytest.raises(ValueError, match="no data folder"):
        open_part([], "known", "test")
