"""The catalogue of transparent things: eight of the data set, three that no training sees.

A further one is an item here, with eight kinds of hold (`hadr.synthesis.holding.kinds`) that suit
it; it belongs to the data set where `hadr.data.splits` names its number.
"""

from __future__ import annotations

from hadr.data.splits import OBJECT_IDS
from hadr.records.caches import kept
from hadr.synthesis.glass.relief import facets, marks, spout, thread
from hadr.synthesis.glass.shape import Corners, GlassObject, handle_sections, profile, relieved
from hadr.synthesis.glass.surfaces import Surface, revolve, tube_around, united


@kept(32)
def bodies(item: GlassObject) -> tuple[Surface, ...]:
    """The closed surface of the object in its own frame; a handle and its body are one."""
    body = revolve(profile(item))
    if item.reliefs:
        body = revolve(profile(item), lambda angle, rz: relieved(item, angle, rz), 160)
    if item.handle:
        body = united((body, tube_around(*handle_sections(item))))
    return (body,)


def _mm(*corners: tuple[float, ...]) -> Corners:
    """Points in metres from millimetres."""
    return tuple(tuple(value / 1000 for value in corner) for corner in corners)


_FOOT_34 = ((0, 0.9), (28, 0, 9), (34, 0, 0.9), (34, 2.0, 0.9))

# fmt: off
_ITEMS = (
    GlassObject(
        "0000",
        "tumbler",
        holds=("side", "above", "tips", "rim", "oblique", "cradle", "below", "reverse"),
        outer=_mm((0, 1.2), (22, 1.2, 3), (25, 0, 2), (32.4, 0, 2.5), (38, 106)),
        inner=_mm((35.6, 106), (28.8, 15, 9), (0, 13)),
        grip=(0.02, 0.098),
        reliefs=(facets(10, 0.0306, 0.085, 0.052),),
    ),
    GlassObject(
        "0001",
        "wine glass",
        holds=("stem", "side", "above", "oblique", "foot", "tips", "reverse", "pinch"),
        outer=_mm(
            *_FOOT_34, (9, 5.5), (4.0, 13), (3.7, 40), (3.9, 72), (8, 86), (30, 92), (40, 112),
            (42, 135), (36.5, 162), (33, 190),
        ),
        inner=_mm(
            (31.6, 190), (35.0, 162), (40.4, 135), (38.5, 112.8), (29, 93.8), (10, 88.5),
            (0, 88),
        ),
        grip=(0.105, 0.17),
        stem=(0.025, 0.075),
    ),
    GlassObject(
        "0004",
        "champagne flute",
        holds=("side", "stem", "tips", "above", "oblique", "fist", "pinch", "reverse"),
        outer=_mm(
            (0, 0.9), (26, 0, 9), (31, 0, 0.9), (31, 1.9, 0.9), (8, 5.2), (3.7, 12), (3.4, 40),
            (3.6, 66), (9, 84), (18, 102), (24, 130), (25.5, 165), (22.5, 214),
        ),
        inner=_mm((21.1, 214), (24.1, 165), (22.6, 130.2), (16.6, 102.8), (6.5, 86), (0, 83)),
        grip=(0.105, 0.195),
        stem=(0.025, 0.075),
    ),
    GlassObject(
        "0005",
        "beaker",
        holds=("tips", "side", "cradle", "above", "reverse", "rim", "oblique", "below"),
        outer=_mm((0, 1.2), (31, 0, 12), (36, 0, 5), (36, 97, 5), (40, 105.2)),
        inner=_mm((38.8, 106.2), (34.3, 97.6, 4), (34.3, 3, 4), (0, 3.2)),
        grip=(0.02, 0.09),
        transmittance=(0.965, 0.98, 0.98),
        reliefs=(
            spout(0.0065, 0.42, 0.088, 0.105),
            marks((0.025, 0.034, 0.043, 0.052, 0.061, 0.07), 1.9, 0.5),
        ),
    ),
    GlassObject(
        "0006",
        "bottle",
        holds=("side", "neck", "oblique", "above", "low", "tips", "reverse", "below"),
        outer=_mm(
            (0, 8), (14, 7), (24, 0, 6), (33, 0, 5), (33, 122), (29, 146), (13.6, 158),
            (13.0, 182, 2), (15.4, 183.5, 1), (15.4, 187, 1), (13.2, 188, 0.6), (13.2, 204),
        ),
        inner=_mm(
            (10.6, 204), (10.4, 160), (26, 145), (30.4, 121), (30.4, 4, 5), (23, 4), (14, 11.5),
            (0, 12.5),
        ),
        grip=(0.02, 0.125),
        transmittance=(0.93, 0.97, 0.945),
        reliefs=(thread(0.1910, 0.0042, 2.3, 0.0012, 0.0013),),
    ),
    GlassObject(
        "0007",
        "jar",
        holds=("above", "side", "tips", "cradle", "oblique", "below", "rim", "reverse"),
        outer=_mm(
            (0, 2), (24, 1.5), (32, 0, 3), (43.5, 0, 5.5), (43.5, 78, 11), (35.5, 83, 4),
            (35.0, 87, 1.2), (37.6, 88, 0.8), (37.6, 90, 0.8), (35.2, 90.8, 0.6), (35.2, 104),
        ),
        inner=_mm((32.6, 104), (32.4, 84, 6), (40.7, 76, 8), (40.7, 6, 6), (28, 5.5), (0, 6.5)),
        grip=(0.02, 0.08),
        reliefs=(thread(0.0928, 0.0046, 1.6, 0.0012, 0.0014),),
    ),
    GlassObject(
        "0008",
        "mug",
        holds=("handle", "side", "above", "cradle", "rim", "oblique", "tips", "below"),
        outer=_mm((0, 1.5), (24, 1.5, 3), (27, 0, 2), (38, 0, 4.5), (39.5, 92)),
        inner=_mm((36.1, 92), (34.4, 8.5, 6), (0, 8)),
        grip=(0.02, 0.085),
        handle=_mm(
            (37.4, 75), (46, 75.3), (58.5, 73.8), (67, 65), (69, 49), (66, 33), (57.5, 24.5),
            (46, 23.2), (36.6, 23.5),
        ),
        handle_radius=0.0039,
        handle_width=0.0062,
    ),
    GlassObject(
        "0009",
        "bowl",
        holds=("cradle", "rim", "carry", "below", "nip", "above", "pinch", "lip"),
        outer=_mm(
            (0, 2), (20, 2, 2), (22, 0, 1), (26.5, 0, 1.2), (27.5, 5.5, 2), (42, 13), (55, 32),
            (58, 64),
        ),
        inner=_mm((55.2, 64), (52.2, 33), (40.5, 16.2), (26, 8.8), (0, 8)),
        grip=(0.02, 0.062),
    ),
    GlassObject(
        "0010",
        "carafe",
        holds=("neck", "side", "oblique", "above", "low", "tips", "reverse", "below"),
        outer=_mm(
            (0, 3), (26, 2), (32, 0, 4), (44, 0, 7), (47, 62), (40, 98), (19, 128), (19.5, 168),
            (31, 206),
        ),
        inner=_mm(
            (28.8, 207), (17.3, 168), (16.6, 129), (37.6, 97), (44.4, 62), (41, 7, 9), (0, 7),
        ),
        grip=(0.02, 0.09),
    ),
    GlassObject(
        "0011",
        "conical flask",
        holds=("neck", "side", "above", "tips", "oblique", "reverse", "cradle", "below"),
        outer=_mm(
            (0, 1.2), (38, 0, 12), (43, 0, 5), (41, 14, 14), (15.5, 104, 12), (15, 132, 4),
            (19, 137.5, 1),
        ),
        inner=_mm(
            (18.2, 138.8), (13.4, 132, 4), (13.8, 104.4, 12), (39, 14), (39, 2.2, 4), (0, 2.2),
        ),
        grip=(0.02, 0.10),
        transmittance=(0.965, 0.98, 0.98),
    ),
    GlassObject(
        "0012",
        "coupe",
        holds=("stem", "fist", "above", "foot", "nip", "lip", "pinch", "reverse"),
        outer=_mm(
            *_FOOT_34, (9, 5.5), (4.0, 13), (3.7, 40), (4.0, 84), (10, 94), (36, 99), (48, 116),
            (49.5, 146),
        ),
        inner=_mm((48.1, 146), (46.5, 116.6), (35, 101), (12, 96.5), (0, 96)),
        grip=(0.11, 0.14),
        stem=(0.025, 0.08),
    ),
)
# fmt: on
#: The eight objects by their id; which thing stands behind an id is our choice, not the paper's.
OBJECTS: dict[str, GlassObject] = {i.object_id: i for i in _ITEMS if i.object_id in OBJECT_IDS}
#: Shapes of the handover experiment with new objects; no data set for training shows them.
NOVEL_OBJECTS: dict[str, GlassObject] = {
    i.object_id: i for i in _ITEMS if i.object_id not in OBJECT_IDS
}


def glass_object(object_id: str) -> GlassObject:
    """Look up an object by its four digits; a ``ValueError`` lists them where there is none."""
    known = OBJECTS | NOVEL_OBJECTS
    if object_id not in known:
        raise ValueError(f"no object {object_id!r}; there are {', '.join(known)}")
    return known[object_id]
