"""The textures of surroundings: a library that is painted when it is looked at.

Texture number ``n`` is of family ``n % len(FAMILIES)``; a family has as many variants as one
likes. A texture is kept with its halved copies (a pyramid), so that far surfaces look up a copy
of the right coarseness. Negative numbers are a user's photographs: -1 is the first one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.records.caches import kept, kept_by_file
from hadr.synthesis.textures import materials, plants, views
from hadr.synthesis.textures.backgrounds import load_background
from hadr.synthesis.textures.noise import Canvas, look_up

Image = npt.NDArray[np.uint8]

LEVELS = 7
#: How many variants of a family scenes choose from.
VARIANTS = 4000
#: How many of them small things choose from, so that a process paints each of them once.
FEW = 6


@dataclass(frozen=True)
class Family:
    """One kind of texture.

    Args:
        paint: Paints one, sRGB in [0, 1], from a generator; the family is called as it is.
        place: ``material`` repeats and lies anywhere; ``view`` is a place, seen from afar.
        width: Natural height of one repeat, metres.
    """

    paint: Callable[[np.random.Generator], Canvas]
    place: Literal["material", "view"]
    width: float

    @property
    def name(self) -> str:
        """Its name."""
        return self.paint.__name__


FAMILIES: tuple[Family, ...] = (
    Family(materials.wood, "material", 0.75),
    Family(materials.boards, "material", 1.2),
    Family(materials.shingles, "material", 1.0),
    Family(materials.tiles, "material", 0.9),
    Family(materials.marble, "material", 0.9),
    Family(materials.terrazzo, "material", 0.6),
    Family(materials.plaid, "material", 0.45),
    Family(materials.print_cloth, "material", 0.5),
    Family(materials.carpet, "material", 1.0),
    Family(materials.plaster, "material", 1.4),
    Family(materials.pebbles, "material", 0.6),
    Family(plants.leaf_wall, "material", 1.1),
    Family(plants.big_leaves, "view", 0.8),
    Family(plants.branches, "view", 1.0),
    Family(plants.grass, "material", 0.7),
    Family(plants.flowers, "material", 1.0),
    Family(views.garden, "view", 2.4),
    Family(views.foliage, "view", 1.8),
    Family(views.bookshelf, "view", 1.5),
    Family(views.room, "view", 2.2),
    Family(views.street, "view", 2.4),
    Family(views.painting, "view", 1.2),
    Family(views.magazine, "view", 0.6),
)


def texture_number(name: str, variant: int) -> int:
    """Number of a family's variant; a ``ValueError`` lists the families where it is none."""
    names = [family.name for family in FAMILIES]
    if name not in names:
        raise ValueError(f"no family of textures {name!r}; there are {', '.join(names)}")
    return names.index(name) + variant * len(FAMILIES)


def _halved(image: Image) -> tuple[Image, ...]:
    levels: list[Image] = [image]
    for _ in range(LEVELS - 1):
        half = [max(side // 2, 1) for side in levels[-1].shape[1::-1]]
        levels.append(cv2.resize(levels[-1], half, interpolation=cv2.INTER_AREA))
    return tuple(levels)


@kept(128)
def _library_pyramid(number: int) -> tuple[Image, ...]:
    variant, family = divmod(number, len(FAMILIES))
    rng = np.random.default_rng([20240917, family, variant])
    painted = FAMILIES[family].paint(rng)
    return _halved(np.clip(np.rint(painted * 255), 0, 255).astype(np.uint8))


@kept_by_file(16)
def _photograph_pyramid(path: Path) -> tuple[Image, ...]:
    return _halved(load_background(path))


def pyramid(number: int, photographs: Sequence[Path] = ()) -> tuple[Image, ...]:
    """A texture and its halved copies, finest first, sRGB, (H, W, 3), (H / 2, W / 2, 3)..."""
    if number < 0:
        return _photograph_pyramid(photographs[-1 - number])
    return _library_pyramid(number)


def sample(
    number: npt.NDArray[np.generic],
    uv: Array,
    texels: Array,
    photographs: Sequence[Path] = (),
) -> Array:
    """Linear RGB in [0, 1], (N, 3), bilinearly from the level of about the asked coarseness.

    Each look-up has a texture's number, coordinates (one unit is one repeat, (N, 2)), and a size in
    pixels of the finest level, (N,). Negative numbers stand for photographs.
    """
    level = np.clip(np.round(np.log2(np.maximum(texels, 1.0))), 0, LEVELS - 1).astype(np.int64)
    keys = np.asarray(number).astype(np.int64) * LEVELS + level
    result = np.empty((len(uv), 3))
    for key in np.unique(keys):
        rows = np.flatnonzero(keys == key)
        texture = pyramid(int(key // LEVELS), photographs)[int(key % LEVELS)]
        height, width = texture.shape[:2]
        at = (uv[rows] % 1.0) * (width, height) - 0.5
        result[rows] = look_up(texture, at[:, 0], at[:, 1])
    return np.asarray((result / 255.0) ** 2.2)
