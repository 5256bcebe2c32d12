"""Frames of several data folders as one, whatever reads them."""

import hashlib

import pytest

from hadr.data.folders import FrameSource, check_folders, data_digest, has_split, open_folder
from hadr.data.samples import samples_dir


class Reader:
    """A data set of another layout: the members of `FrameFolder`, and frames that are words."""

    names = ("0001/a", "0001/b", "0004/c")
    hold_ids = ("left", "left", None)

    def __len__(self):
        return 3

    def __getitem__(self, index):
        return self.names[index]


def test_folders_are_joined_in_order():
    source = FrameSource([Reader(), Reader()])
    assert len(source) == 6
    assert list(source) == source.names == [*Reader.names] * 2
    assert (source[-1], source[1:4]) == ("0004/c", ["0001/b", "0004/c", "0001/a"])
    with pytest.raises(IndexError):
        source[6]
    chosen = FrameSource(source.folders, [5, 1])
    assert (list(chosen), chosen.names) == (["0004/c", "0001/b"],) * 2


def test_holds_are_another_in_each_folder_and_a_frame_without_one_is_its_own():
    source = FrameSource([Reader(), Reader()])
    names = ["0001/a", "0001/b", "0004/c"]
    assert source.holds(names * 2) == [
        *("0/0001/left", "0/0001/left", "0/0004/0004/c"),
        *("1/0001/left", "1/0001/left", "1/0004/0004/c"),
    ]
    other = type("", (Reader,), {"hold_ids": ("take-1", "take-1", "take-1")})()
    assert FrameSource([other]).holds(names) == ["0/0001/take-1"] * 2 + ["0/0004/take-1"]
    for asked, lost in ((["0001/a", "0004/lost"], "0004/lost"), (["0004/c"] * 3, "0004/c")):
        with pytest.raises(ValueError, match=f"there is no frame '{lost}' here, or not in this"):
            source.holds(asked)


def test_the_bundled_folder_is_opened():
    root = samples_dir() / "frames"
    folder = open_folder(root, ("val", "test"), ["0004"])
    assert len(folder.names) == len(folder.hold_ids) == len(folder) > 0
    frame = folder[0]
    assert folder.names[0] == f"{frame.object_id}/{frame.stem}"
    assert folder.hold_ids[0] == frame.hold_id
    assert has_split(root, "val")
    assert not has_split(root, "validation")


def test_a_folder_that_is_none_or_is_named_twice_is_refused(tmp_path):
    root = samples_dir() / "frames"
    check_folders([root])
    with pytest.raises(FileNotFoundError, match=r"there is no data folder .*nowhere"):
        check_folders([root, tmp_path / "nowhere"])
    with pytest.raises(FileNotFoundError, match=" has none of the folders train, val, test"):
        check_folders([root, tmp_path])
    with pytest.raises(ValueError, match="frames is named twice"):
        check_folders([root, root.parent / "." / "frames"])
    with pytest.raises(ValueError, match="object '0004' is named twice"):
        open_folder(root, "val", ["0004", "0004"])


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
