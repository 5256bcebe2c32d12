"""Hands differ: sizes, proportions and girth drawn as among people."""

from __future__ import annotations

import numpy as np

from hadr.hand import HandShape, Side

#: Smallest and largest scale: a child of eight, a large man.
SCALE_RANGE = (0.85, 1.08)
#: Slender to broad.
GIRTH_RANGE = (0.86, 1.16)


def draw_hand_shape(rng: np.random.Generator, side: Side) -> HandShape:
    """Draw a hand whose size, fingers, breadth of palm and girth vary by some per cent."""
    usual = HandShape()
    scale = float(np.clip(rng.normal(0.97, 0.055), *SCALE_RANGE))
    girth = float(np.clip(rng.normal(1.0, 0.06), *GIRTH_RANGE))
    longer = 1 + float(np.clip(rng.normal(0, 0.03), -0.06, 0.06))
    broader = 1 + 0.5 * (girth - 1) + float(np.clip(rng.normal(0, 0.02), -0.04, 0.04))
    lengths = {}
    for finger, bones in usual.lengths.items():
        own = longer * (1 + float(np.clip(rng.normal(0, 0.015), -0.03, 0.03)))
        a, b, c = (own * bone for bone in bones)
        lengths[finger] = (a, b, c)
    roots = {finger: (broader * x, y, z) for finger, (x, y, z) in usual.roots.items()}
    return HandShape(side=side, scale=scale, roots=roots, lengths=lengths, girth=girth)
