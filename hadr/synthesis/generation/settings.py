"""What the frames of a data set have in common, what frame number ``i`` shows, and the presets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np

from hadr.data.frame_pictures import Normals
from hadr.data.splits import OBJECT_IDS, UNKNOWN_OBJECTS

LARGEST_SIDE, MOST_FRAMES = 8192, 1_000_000
"""Limits of a data set: pixels of a picture's longer side, and frames."""
EDITION = 2
"""Of the frames' look: the first, which names none, has farther cameras, even light, no blur."""
Variant = Literal["llvm_ad_rgb", "scalar_rgb"]

#: Ratio of training, validation and testing frames (paper, section IV-A).
_RATIO = (0.7, 0.2, 0.1)
_HOLD_CYCLE = ("train", "train", "test", "train", "val", "train", "train", "train", "val", "train")


@dataclass(frozen=True)
class FrameRecipe:
    """What frame ``index`` of a data set shows: an object, one of its holds; and its split."""

    index: int
    object_id: str
    hold_number: int
    split: str

    @property
    def stem(self) -> str:
        """Name of the frame's files."""
        return f"{self.index:06d}"


def hold_split(hold_number: int, object_id: str = "0000") -> str:
    """The split of an object's hold, however many frames are made: ten in turn hold 7:2:1."""
    # Kinds of hold come in turns of eight; the cycle moves on by one each ten and begins elsewhere
    # for each object, so that every kind is tested with some object.
    lap = hold_number // len(_HOLD_CYCLE)
    return _HOLD_CYCLE[(hold_number + lap + int(object_id)) % len(_HOLD_CYCLE)]


def recipes_by_hold(recipes: Sequence[FrameRecipe]) -> list[tuple[FrameRecipe, ...]]:
    """Put the frames that share a holding pose together, in the order of their first frames."""
    groups: dict[tuple[str, int], list[FrameRecipe]] = {}
    for recipe in recipes:
        groups.setdefault((recipe.object_id, recipe.hold_number), []).append(recipe)
    return [tuple(group) for group in groups.values()]


@dataclass(frozen=True)
class GenerationSettings:
    """All that the bytes of a frame depend on, besides its index.

    Args:
        seed: Seed of everything (0).
        width: Image width, pixels (448).
        height: Image height, pixels; TransHand-14K's pictures are 16:9 (252).
        engine: photo traces paths (needs hadr[generate]), raycast casts rays (raycast).
        variant: Of Mitsuba, which draws for photo; where left out, that of the frames that are
            there already, else the fastest that works.
        samples: Paths a pixel of photo (8).
        quality: Of raycast: fine has soft shadows and four rays a pixel, fast one ray (fine).
        sensor: With the raw depth of a simulated depth camera.
        objects: The objects to alternate between, e.g. 0000 0004; without, all eight.
        split_by: What a split keeps together: a holding pose, nothing but the frame (which leaks
            near-twins), or the object with 0004 and 0007 for testing; the others split 7:2:1
            (holding).
        frames_per_hold: How many frames share a holding pose; 2.5 means two and three in turn
            (2).
        hold_shift: Object number j begins with its hold number j times this, so that few
            frames show many kinds of hold (0).
        recordings: Folder of recorded holds as CSV; without, holds are made from the seed.
        backgrounds: Folder of photographs for the surroundings; without, textures are painted.
        depth_format: Depth as float metres, npy, or 16-bit in 0.1 mm steps, png (npy).
        jpeg_quality: Stores colour as JPEG, 1..100; without, as PNG.
        rest_step: Rounds the depth of what is neither hand nor glass, metres, for smaller files;
            without, it stays as exact.
        raw_format: Raw depth in 1 mm steps, depth, or as the camera's disparity, which is smaller:
            1/16 pixel, beyond 1 m 1/8 pixel (depth).
        normals: Where surface normals are kept: everywhere, on glass and hand, on the glass (all).

    Raises:
        ValueError: A value is out of range, or an object unknown.
    """

    seed: int = 0
    width: int = 448
    height: int = 252
    engine: Literal["photo", "raycast"] = "raycast"
    variant: Variant | None = None
    samples: int = 8
    quality: Literal["fast", "fine"] = "fine"
    sensor: bool = False
    objects: tuple[str, ...] | None = None
    split_by: Literal["holding", "frame", "object"] = "holding"
    frames_per_hold: float = 2
    hold_shift: int = 0
    recordings: str | None = None
    backgrounds: str | None = None
    depth_format: Literal["npy", "png"] = "npy"
    jpeg_quality: int | None = None
    rest_step: float | None = None
    raw_format: Literal["depth", "disparity"] = "depth"
    normals: Normals = "all"

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(GenerationSettings).items():
            value, allowed = getattr(self, name), get_args(hint)
            if value == "":
                raise ValueError(f"{name} must not be empty")
            whole = hint is int or hint == int | None
            if whole and value is not None and (isinstance(value, bool) or value % 1 != 0):
                raise ValueError(f"{name} must be a whole number, got {value!r}")
            if get_origin(hint) is Literal and value not in allowed:
                known = ", ".join(map(repr, allowed[:-1]))
                raise ValueError(f"{name} must be {known} or {allowed[-1]!r}, got {value!r}")
        for name, low, high in (
            ("seed", 0, 2**63 - 1),
            ("width", 16, LARGEST_SIDE),
            ("height", 9, LARGEST_SIDE),
            ("samples", 1, 65536),
            ("frames_per_hold", 1, MOST_FRAMES),
            ("hold_shift", 0, MOST_FRAMES),
            ("jpeg_quality", 1, 100),
            ("rest_step", 1e-4, 0.1),
        ):
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ValueError(f"{name} must lie in {low}..{high}, got {value}")
        if self.objects is not None and not 0 < len(set(self.objects)) == len(self.objects):
            raise ValueError(f"objects must be different ones, at least one, got {self.objects}")
        if self.objects is not None:
            from hadr.synthesis.glass.objects import glass_object

            for name in self.objects:
                glass_object(name)

    def recipe(self, index: int) -> FrameRecipe:
        """What frame ``index`` shows; objects alternate. A negative index is a ``ValueError``."""
        if index < 0:
            raise ValueError(f"frames are counted from 0, got {index}")
        names = self.objects or OBJECT_IDS
        lap, position = divmod(index, len(names))
        object_id = names[position]
        hold_number = int(lap // self.frames_per_hold) + position * self.hold_shift
        split = hold_split(hold_number, object_id)
        if self.split_by == "frame":
            draw = np.random.default_rng([self.seed, index, 29]).choice(3, p=_RATIO)
            split = ("train", "val", "test")[int(draw)]
        elif self.split_by == "object":
            split = "test" if object_id in UNKNOWN_OBJECTS else "train"
        return FrameRecipe(index, object_id, hold_number, split)


@dataclass(frozen=True)
class Preset:
    """A data set by name: how many frames, what they have in common, a line for the help."""

    frames: int
    settings: GenerationSettings
    purpose: str
    bundled_recordings: bool = False
    """Poses come from the recordings that are part of the project."""


_TRACED = GenerationSettings(engine="photo", sensor=True, depth_format="png")
#: As small as the labels of what is held allow.
_SMALL = replace(
    _TRACED, jpeg_quality=86, rest_step=0.001, raw_format="disparity", normals="object"
)
PRESETS: dict[str, Preset] = {
    "tiny": Preset(
        16,
        GenerationSettings(
            width=128, height=72, quality="fast", depth_format="png", jpeg_quality=92
        ),
        "16 ray-cast frames of 128x72 in seconds, to try things out",
    ),
    "samples": Preset(
        480,
        replace(_SMALL, width=320, height=180),
        "the project's sample frames: 480 of 320x180 from 240 recorded holds",
        bundled_recordings=True,
    ),
    "gallery": Preset(
        12,
        replace(
            _SMALL, seed=11, width=1280, height=720, samples=16, frames_per_hold=1, hold_shift=5
        ),
        "12 frames of 1280x720 to look at",
    ),
    "mini": Preset(
        6000,
        replace(_TRACED, seed=1, width=320, height=180, jpeg_quality=92, normals="none"),
        "a training set: 6,000 frames of 320x180 from 3,000 holds that the samples don't have",
    ),
    "paper": Preset(
        14100,
        replace(_TRACED, seed=2, width=1280, height=720, jpeg_quality=95),
        "as many frames as TransHand-14K and as large: 14,100 of 1280x720; takes days",
    ),
}
