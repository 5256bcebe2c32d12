"""Holding poses: a hand takes hold of an object, and its fingers close on it until they touch.

A pose is built as a right hand's: the object is placed as the kind of hold wants it
(:mod:`hadr.synthesis.holding.kinds`), the fingers close
(:mod:`hadr.synthesis.holding.grasp_optimisation`) and the skin is checked
(:mod:`hadr.synthesis.holding.contact`); what fails is drawn again. A left hand is the mirror image.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hadr.camera import Array
from hadr.hand import HandShape, Side
from hadr.records.caches import kept
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.holding.clearance import clearance_table
from hadr.synthesis.holding.contact import TOUCH, ContactReport, check_contact
from hadr.synthesis.holding.grasp_optimisation import (
    GraspOptimisation,
    HandSkins,
    hand_skins,
    palm_clearance,
    push_onto_palm,
)
from hadr.synthesis.holding.kinds import Placement, draw_placement, fingers_inside

#: Smallest and largest scale: a child of eight, a large man.
SCALE_RANGE = (0.85, 1.08)
#: Slender to broad.
GIRTH_RANGE = (0.86, 1.16)
_PLACEMENTS, _TRIES, _ROUNDS, _REDRAWS = 10, 2, 6, 5
#: What a hold made by the search keeps below the checks' limits, metres.
_AIM = 0.0013
_MIRROR_X, _MIRROR_Y = np.diag([-1.0, 1, 1, 1]), np.diag([1.0, -1, 1, 1])


@dataclass(frozen=True)
class Hold:
    """A hand that holds an object.

    Args:
        hold_id: Names the pose, e.g. ``0004-stem-0007``; frames that share it are near-duplicates.
        object_id: The object.
        kind: One of those in ``KINDS``.
        shape: Sizes and side of the hand.
        angles: The twenty joint angles, radians, shape (20,).
        wrist_from_object: Pose of the object in the wrist frame, shape (4, 4).
        gaps: Smallest distance of the skin of each finger, of the palm and of the forearm to the
            glass, metres; negative where it is pressed in.
    """

    hold_id: str
    object_id: str
    kind: str
    shape: HandShape
    angles: Array
    wrist_from_object: Array
    gaps: Mapping[str, float]

    @property
    def touching(self) -> tuple[str, ...]:
        """Which of the fingers and the palm touch the glass (within 2 mm)."""
        return tuple(name for name, gap in self.gaps.items() if gap <= TOUCH)


def check_hold(hold: Hold) -> ContactReport:
    """Run all checks on a hold; its ``problems`` are empty when it is good."""
    placed = hold.angles, hold.wrist_from_object
    return check_contact(hold.object_id, hold.shape, *placed, fingers_inside(hold.kind))


def _candidates(
    object_id: str, kind: str, hand: HandSkins, rng: np.random.Generator
) -> list[Placement]:
    """Placements of the object, the most promising first."""
    item, table = glass_object(object_id), clearance_table(object_id)
    found: list[tuple[float, Placement]] = []
    for _ in range(_PLACEMENTS):
        placement = draw_placement(item, kind, hand.shape.scale, rng)
        if placement.palm_gap == 0:
            placement = push_onto_palm(hand, table, placement)
        elif palm_clearance(hand, table, placement.wrist_from_object) < placement.palm_gap:
            continue
        found.append((GraspOptimisation(object_id, hand, placement).screen(), placement))
    return [placement for _, placement in sorted(found, key=lambda f: f[0])]


def search_hold(
    object_id: str, kind: str, shape: HandShape, rng: np.random.Generator
) -> tuple[Array, Array, ContactReport]:
    """Search a hold of a kind as a right hand's: angles, ``wrist_from_object``, the checks' report.

    Where all attempts fail it is the best failure, and its report has problems.
    """
    right = replace(shape, side="right")
    hand = hand_skins(right)
    best: tuple[float, Array, Array, ContactReport] | None = None
    for _ in range(_ROUNDS):
        for placement in _candidates(object_id, kind, hand, rng)[:_TRIES]:
            pose = placement.wrist_from_object
            angles, cost = GraspOptimisation(object_id, hand, placement).run(rng)
            report = check_contact(object_id, right, angles, pose, fingers_inside(kind))
            wanted = {f for f, action in placement.plan.items() if action != "free"}
            missed = len(wanted - set(report.touching))
            good = not report.problems and report.depth < _AIM and missed <= (len(wanted) > 3)
            total = cost + (0 if good else 100) + 1000 * len(report.problems)
            if best is None or total < best[0]:
                best = (total, angles, pose, report)
            if good:
                break
        if best is not None and best[0] < 100:
            break
    if best is None:
        raise ValueError(f"no placement of {object_id} for a hold of kind {kind!r} spares the palm")
    return best[1:]


def mirrored_pose(wrist_from_object: Array) -> Array:
    """The object's pose in the other hand, shape (4, 4); objects are their own mirror image."""
    return _MIRROR_X @ wrist_from_object @ _MIRROR_Y


def hold_kind(object_id: str, number: int) -> str:
    """The kind of an object's hold by its number, from 0."""
    kinds = glass_object(object_id).holds
    if number < 0:
        raise ValueError(f"number of a hold starts at 0, got {number}")
    return kinds[number % len(kinds)]


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


@kept(64)
def make_hold(object_id: str, number: int, seed: int = 0) -> Hold:
    """Make the holding pose of an object by its number, from 0; its eight kinds of hold alternate.

    Raises:
        ValueError: The object is unknown, the number is negative, or five hands in turn fail.
    """
    kind = hold_kind(object_id, number)
    for redraw in range(_REDRAWS):
        # Another hand, too, where one does not manage.
        rng = np.random.default_rng([seed, int(object_id), number, 11, redraw][: 4 + (redraw > 0)])
        side: Side = "right" if rng.random() < 0.6 else "left"
        shape = draw_hand_shape(rng, side)
        angles, pose, report = search_hold(object_id, kind, shape, rng)
        if not report.problems:
            break
    else:
        raise ValueError(
            f"{_REDRAWS} hands do not manage hold {number} of {object_id} ({kind}) with seed "
            f"{seed}: {'; '.join(report.problems)}"
        )
    name = f"{object_id}-{kind}-{number:04d}"
    hold = Hold(name, object_id, kind, shape, angles, pose, report.gaps)
    if side == "left":
        # A thread is not its own mirror image, so the gaps change a little.
        hold = replace(hold, wrist_from_object=mirrored_pose(pose))
        hold = replace(hold, gaps=check_hold(hold).gaps)
    return hold
