import cv2
import numpy as np
import pytest

from hadr.synthesis.textures.backgrounds import check_backgrounds, find_backgrounds, load_background
from hadr.synthesis.textures.families import sample


def test_a_folder_of_photographs(tmp_path):
    image = np.zeros((600, 2048, 3), np.uint8)
    image[:, 1024:] = (0, 0, 255)  # OpenCV's order: the right half is red
    cv2.imwrite(str(tmp_path / "b.png"), image)
    cv2.imwrite(str(tmp_path / "a.JPG"), image[:100, :200])
    (tmp_path / "notes.txt").write_text("no picture")
    paths = find_backgrounds(tmp_path)
    assert [p.name for p in paths] == ["a.JPG", "b.png"]
    large = load_background(paths[1])
    assert large.shape == (300, 1024, 3)
    np.testing.assert_array_equal(large[150, 800], [255, 0, 0])
    seen = sample(np.full(1, -2), np.array([[0.75, 0.5]]), np.ones(1), paths)
    np.testing.assert_allclose(seen, [[1, 0, 0]])


def test_wrong_photographs_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"no folder of photographs at .*nowhere"):
        find_backgrounds(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="holds no photograph"):
        find_backgrounds(tmp_path)
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"not a picture")
    with pytest.raises(ValueError, match=r"can't read the photograph .*broken\.jpg"):
        load_background(broken)
    cv2.imwrite(str(tmp_path / "tiny.png"), np.zeros((9, 40, 3), np.uint8))
    with pytest.raises(ValueError, match=r"tiny\.png has only 40x9 pixels"):
        load_background(tmp_path / "tiny.png")


def test_a_photograph_that_is_cut_off_is_named_and_all_are_checked_at_once(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (90, 120, 3), dtype=np.uint8)
    for name in ("a.jpg", "b.png", "c.webp", "d.bmp", "e.tiff"):
        cv2.imwrite(str(tmp_path / name), picture)
    check_backgrounds(tmp_path)
    for path in find_backgrounds(tmp_path):
        path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ValueError, match=r"a\.jpg: the JPEG is cut off after \d+ bytes"):
        load_background(tmp_path / "a.jpg")
    with pytest.raises(ValueError, match=r"^[4-5] of .*a\.jpg: .*b\.png: the PNG is cut off"):
        check_backgrounds(tmp_path)
    for number in range(12):
        (tmp_path / f"f{number}.png").write_bytes(b"")
    with pytest.raises(ValueError, match=r"^1[67] of the photographs.*; and [67] more$"):
        check_backgrounds(tmp_path)


@pytest.mark.parametrize("progressive", [0, 1])
def test_what_a_phone_writes_into_a_jpeg_does_not_hide_its_end(tmp_path, progressive):
    """A preview in front, with an end of its own, and a film of many bytes behind."""
    picture = np.random.default_rng(0).integers(0, 256, (90, 120, 3), dtype=np.uint8)
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive, cv2.IMWRITE_JPEG_RST_INTERVAL, 3]
    jpeg = cv2.imencode(".jpg", picture, options)[1].tobytes()
    preview = cv2.imencode(".jpg", picture[:20, :20])[1].tobytes()
    inside = b"\xff\xe1" + (len(preview) + 2).to_bytes(2, "big") + preview
    phone = jpeg[:2] + inside + jpeg[2:]
    path = tmp_path / "phone.jpg"
    path.write_bytes(phone + bytes(5000))
    assert load_background(path).shape == (90, 120, 3)
    for end in (len(inside) + 2, len(phone) // 2, len(phone) - 2):
        path.write_bytes(phone[:end])
        with pytest.raises(ValueError, match="the JPEG is cut off"):
            load_background(path)
