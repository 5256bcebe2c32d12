"""The method's diagram says what the network says, and lights what it is asked to."""

import numpy as np
import pytest

from hadr.figures.method import diagram
from hadr.figures.sheet import Sheet
from hadr.models.hadr import HADRConfig


@pytest.fixture(scope="module")
def example():
    return diagram._example()


def test_the_parts_of_a_pair_are_the_decoders_input(example):
    assert sum(diagram._widths(example).values()) == sum(HADRConfig().parts)


def test_the_followed_ray_ends_in_its_most_probable_voxel(example):
    shares = example.output.probability[example.pairs]
    assert example.pairs[int(shares.argmax())] == example.chosen
    pairs = example.output.pairs
    reached = float(example.output.points[example.ray].norm())
    assert pairs.t_in[example.chosen] <= reached <= pairs.t_out[example.chosen]


def test_the_whole_diagram_has_no_veil_and_a_lit_one_leaves_its_box_free(example):
    def corner_of(name, *lit):
        sheet = diagram.method_diagram(*lit)
        sheet.figure.canvas.draw()
        left, bottom, width, height = (int(100 * x) for x in diagram.PARTS[name][2])
        picture = np.asarray(sheet.figure.canvas.buffer_rgba())[::-1]
        scale = sheet.figure.dpi / 100
        rows = slice(int((bottom + 8) * scale), int((bottom + height - 8) * scale))
        columns = slice(int((left + 8) * scale), int((left + width - 8) * scale))
        return picture[rows, columns, :3]

    whole = corner_of("hand")
    assert np.array_equal(corner_of("hand", "hand"), whole)
    assert corner_of("hand", "pairs").min() > whole.min() + 100
    with pytest.raises(ValueError, match=r"no part \['foot'\]"):
        diagram.method_diagram("foot")


def test_a_sheet_is_shown_as_vectors_and_bitmap_the_same_each_time(monkeypatch):
    shown = []
    monkeypatch.setattr("hadr.figures.sheet.display", lambda data, raw: shown.append(data))
    for _ in range(2):
        sheet = Sheet(2, 1)
        sheet.card((0.1, 0.1, 1, 0.5))
        sheet.arrow((0.2, 0.2), (1, 0.2), (1, 0.8))
        sheet.write(0.2, 0.3, "words")
        sheet.show()
    assert shown[0] == shown[1]
    assert shown[0]["image/svg+xml"].startswith("<?xml")
    assert set(shown[0]) == {"image/svg+xml", "image/png"}
