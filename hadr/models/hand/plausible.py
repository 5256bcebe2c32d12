"""Is this a hand, and does it stand where the picture shows one?

A network that looks for keypoints gives 21 points, whatever it is shown, and a file that a user
names may hold another frame's hand. What follows believes them: an object is sought where the hand
is. So keypoints are held against what else is known, and what does not fit is said in words:

* a human hand's size: the palm, and the fingers, each with its three bones together; the median
  of the five counts, since a network may well lose one finger behind the glass;
* a human hand's form, where keypoints are given: every bone counts, and the knuckles' order, which
  tells swapped fingers; a mirror image is a hand, too, and only its place may betray it;
* the glass: a hand that holds it is seen beside it;
* the depth that the camera measured at the keypoints' pixels: skin lies some millimetres before a
  joint, fingers before a joint some centimetres, and the hand is never before what is seen there; a
  given hand's bones lie under the skin that is seen, and no skin is seen beside them;
* where the hand's pixels are known, their points: joints lie under them; together they are as large
  as hand and forearm can be seen, neither a speck nor a table; and what is seen around them lies
  farther away, unlike around a cloth that is taken for skin.

The limits are from the bundled training and validation frames. Of the 492 true hands of all bundled
frames they leave 490 in, held against the raw depth, and 482 where they are given, which costs
their probability alone; of 144 training and validation hands, 128 that the small networks find. Of
19 computed frames and two photographs without a hand they accept none, nor of the photographs' 80
crops and mirror images (`benchmarks/cameras/hand_checks.py`). To lose a hand that is found costs
the restoration that needs it, to invent one gives a wrong depth.

Source of the lengths: Buryanov and Kotiuk 2010, "Proportions of hand segments", table I.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from hadr.camera import BoolArray, FloatArray, Intrinsics, project, unproject
from hadr.hand import BONES, FINGERS, forward_kinematics, keypoints_from_skeleton

PALM_M = 0.090
"""An adult's palm, wrist to middle finger's knuckle, as of `hadr.hand.HandShape`."""
FINGERS_M = {"thumb": 0.0995, "index": 0.0780, "middle": 0.0884, "ring": 0.0843, "little": 0.0668}
"""The means of an adult finger's three bones together, the thumb's with its metacarpal."""
SIZES = (0.5, 1.6)
"""Smallest and largest factor on both: a child's or a large man's, and what a network errs."""
FOUND_BONES = 4.2
"""Longest bone of a hand that a network found, as a share of what the others let expect: 4.16 is
the largest of the bundled keypoint network's on every third training frame. It is a weak limit,
for a weak network."""
BONE_SIZES = (0.5, 1.75)
"""Smallest and largest factor on a bone, against the hand's others: true bundled hands have 0.93 to
1.08; a finger's two middle joints swapped give 1.89 and more, thumb and index swapped 2.56."""
FARTHEST_FROM_GLASS_M = 0.03
"""A hand that holds a glass has a keypoint so near to it in the picture."""
GAP_M = (-0.02, 0.10)
"""How far keypoints lie behind what was measured at their pixels, in the median; below 0: before
it, where the camera would have seen them."""
UNDER_SKIN_M = (0.0, 0.025)
"""Where a given hand's bones lie behind the depth that is measured at their pixels."""
AHEAD_M = 0.005
"""A bone that lies so far before what is measured there is another hand's."""
BESIDE_M, REACH_M = 0.03, 0.08
"""What is measured within `REACH_M` of the hand's middle belongs to it, no farther than `BESIDE_M`
from a bone."""
LEAST_FIT = 3.07
"""Log odds that bones lie under the skin, minus those that they lie before it, minus half of those
that what is seen lies beside them. Of the bundled training hands 1.5 % have less; with the other
limits, of the validation frames' hands none is lost, and 90 to 92 % of those are found that are
turned by 40 degrees, 91 and 95 % of mirrored ones, 93 % of another frame's at the same place, 90 %
of those 3 cm aside, 99 % of those 3 cm nearer or farther, and 21 % where one finger is off by 3 cm
(`benchmarks/cameras/hand_checks.py --moved`)."""
LEAST_SEEN = 5
"""Of fewer keypoints with measured depth at their pixels nothing is said."""
WINDOW_M = 0.008
"""Half of the window around a keypoint's pixel, metres at its depth."""
FARTHEST_FROM_SKIN_M = 0.06
"""How far keypoints lie from the nearest point of the hand's pixels, in the median."""
AREA_M2 = (0.004, 0.06)
"""What is seen of a hand and its forearm."""
LEAST_STEP_M = 0.01
"""How far what is seen around the hand's pixels lies behind them, in the median."""
AROUND_M = (0.01, 0.03)
"""From where to where around the hand's pixels that is looked at, metres at their depth."""
LEAST_AROUND = 20
"""Of fewer pixels there nothing is said."""
MOST_HIDDEN = 16
"""Keypoints that lie in a true mask, behind the glass: the most of the bundled training frames; in
the hand's own mask half of them have 17 and more."""
LEAST_PRESENCE = 0.93
"""The segmentation's mean probability of a hand in the pixels where it sees one: 0.931 is the least
of the training and validation hands that pass all else."""


class NoHandError(ValueError):
    """There is no hand to be found in a frame; the message says why."""


@dataclass(frozen=True)
class HandCheck:
    """How 21 keypoints fit to what else is known of a frame; None: not known.

    Attributes:
        palm: The palm's length, 1 = an adult's.
        fingers: The fingers' lengths, each 1 = an adult's mean; their median.
        shortest: The bone that is shortest for its place; 1 = as the hand's others.
        longest: The bone that is longest for its place.
        glass_m: From the nearest keypoint to the glass in the picture, metres at that depth.
        gap_m: How far the keypoints lie behind the measured depth at their pixels, median, metres.
        skin_m: From the keypoints to the nearest point of the hand's pixels, median, metres.
        area_m2: What the hand's pixels cover, square metres.
        step_m: How far what is seen around the hand's pixels lies behind them, median, metres.
        presence: The mean probability of a hand in its pixels, 0..1.
        problems: Why it is no hand, or not the one in the picture; one clause each.
    """

    palm: float
    fingers: float
    shortest: float
    longest: float
    glass_m: float
    gap_m: float | None
    skin_m: float | None
    area_m2: float | None
    step_m: float | None
    presence: float | None
    problems: tuple[str, ...]


def check_hand(
    keypoints: npt.NDArray[np.float64],
    depth: FloatArray,
    camera: Intrinsics,
    mask: BoolArray,
    hand_mask: BoolArray | None = None,
    presence: float | None = None,
    *,
    given: bool = False,
) -> HandCheck:
    """Hold keypoints against a human hand's size, the glass, and the measured depth.

    Args:
        keypoints: Camera frame, metres, shape (21, 3).
        depth: Measured z-depth, metres, shape (H, W); 0 = missing. The glass's own does not count.
        camera: Intrinsics of depth and masks.
        mask: The glass's pixels, shape (H, W) bool; one at least.
        hand_mask: Pixels of hand and arm, shape (H, W) bool; None: not known.
        presence: Mean probability of a hand that a segmentation network gives these; None: its
            mask is not from one.
        given: They are no network's: then the hand's form counts, too.

    Returns:
        What was measured, and what does not fit.

    Raises:
        NoHandError: A keypoint does not lie in front of the camera.
    """
    if not (keypoints[:, 2] > 0).all():
        raise NoHandError(f"a keypoint lies {keypoints[:, 2].min():.3g} m before the camera")
    seen = np.where(mask, 0, depth)
    joints = np.linalg.norm(np.diff(keypoints[list(FINGERS.values())], axis=1), axis=2)  # (5, 3)
    palm = float(np.linalg.norm(keypoints[FINGERS["middle"][0]] - keypoints[0]) / PALM_M)
    fingers = float(np.median(joints.sum(axis=1) / list(FINGERS_M.values())))
    bones = _bones(keypoints) / _bones(_ADULT)
    shortest, longest = (float(f(bones) / max(np.median(bones), 1e-9)) for f in (np.min, np.max))
    glass = _to_glass(keypoints, camera, mask)
    gaps = _gaps(keypoints, seen, camera)
    known = np.isfinite(gaps)
    gap = float(np.median(gaps[known])) if known.sum() >= LEAST_SEEN else None
    skin = area = step = None
    if hand_mask is not None:
        there = hand_mask & (seen > 0)
        if there.any():
            skin, area = _skin(keypoints, seen, camera, there)
            area *= float(hand_mask.sum() / there.sum())
            step = _step(seen, camera, there, hand_mask)
    problems = [
        f"{name} {100 * factor:.0f} % of an adult's length"
        for name, factor in (("its palm has", palm), ("its fingers have", fingers))
        if not SIZES[0] <= factor <= SIZES[1]
    ]
    if given:
        problems += _deformed(keypoints, shortest, longest)
    elif longest > FOUND_BONES:
        problems.append(f"one of its bones has {100 * longest:.0f} % of a hand's proportions")
    if glass > FARTHEST_FROM_GLASS_M:
        problems.append(f"it is {100 * glass:.1f} cm away from the glass in the picture")
    if gap is not None:
        if not GAP_M[0] <= gap <= GAP_M[1]:
            side = "behind" if gap > 0 else "before"
            problems.append(
                f"its keypoints lie {100 * abs(gap):.1f} cm {side} the depth that was measured at "
                "their pixels"
            )
        elif given:
            problems += _unlike(keypoints, seen, camera)
    elif given:
        problems.append(f"it could not be compared: {int(known.sum())} of its keypoints meet depth")
    if skin is not None and skin > FARTHEST_FROM_SKIN_M:
        problems.append(f"its keypoints lie {100 * skin:.1f} cm away from the hand's pixels")
    if area is not None and not AREA_M2[0] <= area <= AREA_M2[1]:
        problems.append(f"its pixels cover {1e4 * area:.0f} square centimetres")
    if step is not None and step < LEAST_STEP_M:
        problems.append(
            f"its pixels don't stand out: what is around them lies {100 * abs(step):.1f} cm "
            f"{'behind' if step >= 0 else 'before'} them"
        )
    if presence is not None and presence < LEAST_PRESENCE:
        problems.append(f"its pixels have a mean probability of {presence:.2f} of being a hand's")
    uv = np.rint(project(keypoints, camera)).astype(int)
    column, row = uv[((uv >= 0) & (uv < mask.shape[::-1])).all(axis=1)].T
    hidden = int(mask[row, column].sum())
    if problems and hidden > MOST_HIDDEN:
        problems.append(f"{hidden} of its keypoints lie in the mask: is that the hand's?")
    return HandCheck(
        palm, fingers, shortest, longest, glass, gap, skin, area, step, presence, tuple(problems)
    )


_ADULT = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)


def _bones(keypoints: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(np.linalg.norm(np.diff(keypoints[np.array(BONES)], axis=1)[:, 0], axis=1))


def _deformed(keypoints: npt.NDArray[np.float64], shortest: float, longest: float) -> Iterator[str]:
    """Why the keypoints, in their order, make no human hand."""
    if shortest < BONE_SIZES[0] or longest > BONE_SIZES[1]:
        yield (
            f"its bones have {100 * shortest:.0f} to {100 * longest:.0f} % of a hand's proportions "
            "(are keypoints swapped?)"
        )
    knuckles = keypoints[[joints[0] for joints in list(FINGERS.values())[1:]]]
    apart = np.linalg.norm(knuckles[[0, -1]] - keypoints[FINGERS["thumb"][1]], axis=1)
    if apart[0] > apart[1] or (np.diff(knuckles @ (knuckles[-1] - knuckles[0])) <= 0).any():
        yield "its knuckles are not in a row from index, beside the thumb, to little finger"


def _to_glass(keypoints: npt.NDArray[np.float64], camera: Intrinsics, mask: BoolArray) -> float:
    """From the nearest keypoint to the glass in the picture, metres at the keypoint's depth."""
    pixels = np.argwhere(mask)[:, ::-1]
    glass = unproject(pixels, np.ones(len(pixels)), camera)
    away, _ = cKDTree(glass).query(keypoints / keypoints[:, 2:])
    return float((away * keypoints[:, 2]).min())


def _gaps(
    keypoints: npt.NDArray[np.float64], seen: FloatArray, camera: Intrinsics
) -> npt.NDArray[np.float64]:
    """How far keypoints lie behind what is measured at their pixels, metres; NaN: nothing is."""
    return np.array(
        [
            z - median_depth(seen, pixel, round(WINDOW_M * camera.fx / z))
            for pixel, z in zip(project(keypoints, camera), keypoints[:, 2], strict=True)
        ]
    )


def _unlike(
    keypoints: npt.NDArray[np.float64], seen: FloatArray, camera: Intrinsics
) -> Iterator[str]:
    """Why a hand is not the one whose depth was measured."""
    along = np.linspace(0, 1, 8)[:, None, None]
    start, end = keypoints[np.array(BONES).T]
    bones = ((1 - along) * start + along * end).reshape(-1, 3)
    column, row = np.rint(project(bones, camera)).astype(int).T
    there = (row >= 0) & (row < seen.shape[0]) & (column >= 0) & (column < seen.shape[1])
    there[there] = seen[row[there], column[there]] > 0
    gaps = bones[there, 2] - seen[row[there], column[there]]
    middle = keypoints.mean(axis=0)
    step = max(round(0.004 * camera.fx / middle[2]), 1)
    pixels = step * np.argwhere(seen[::step, ::step] > 0)[:, ::-1]
    points = unproject(pixels, seen[tuple(pixels.T[::-1])], camera)
    away, _ = cKDTree(bones).query(points[np.linalg.norm(points - middle, axis=1) < REACH_M])
    if len(gaps) < 2 * LEAST_SEEN:
        return
    shares = np.array(
        [
            ((gaps > UNDER_SKIN_M[0]) & (gaps < UNDER_SKIN_M[1])).mean(),
            (gaps < -AHEAD_M).mean(),
            (away > BESIDE_M).mean() if len(away) else 1.0,
        ]
    )
    odds = np.log((0.98 * shares + 0.01) / (0.99 - 0.98 * shares))
    if odds @ (1, -1, -0.5) < LEAST_FIT:
        under, ahead, beside = 100 * shares
        yield (
            f"it is not the hand that the depth camera saw: {under:.0f} % of its bones lie under "
            f"the skin, {ahead:.0f} % before what was measured there, and {beside:.0f} % of what "
            "was measured there lies beside them"
        )


def median_depth(depth: FloatArray, pixel: FloatArray, half: int) -> float:
    """Median of the depth known around a pixel (u, v), up to `half` pixels away; NaN: none is."""
    around = (
        slice(max(at - half, 0), max(at + half + 1, 0)) for at in np.rint(pixel[::-1]).astype(int)
    )
    window = depth[tuple(around)]
    known = window[window > 0]
    return float(np.median(known)) if known.size else np.nan


def _skin(
    keypoints: npt.NDArray[np.float64], seen: FloatArray, camera: Intrinsics, there: BoolArray
) -> tuple[float, float]:
    """Distance from the keypoints to the points of some pixels, median, and these pixels' area."""
    pixels = np.argwhere(there)[:, ::-1]
    z = seen[there].astype(float)
    away, _ = cKDTree(unproject(pixels, z, camera)).query(keypoints)
    return float(np.median(away)), float((z**2).sum()) / (camera.fx * camera.fy)


def _step(
    seen: FloatArray, camera: Intrinsics, there: BoolArray, hand_mask: BoolArray
) -> float | None:
    """How far what is seen around the hand's pixels lies behind the nearest of them, median."""
    pixels, nearest = ndimage.distance_transform_edt(~there, return_indices=True)
    z = seen[tuple(nearest)]
    away = pixels * z / camera.fx
    around = (away > AROUND_M[0]) & (away < AROUND_M[1]) & (seen > 0) & ~hand_mask
    behind = (seen - z)[around]
    return float(np.median(behind)) if behind.size >= LEAST_AROUND else None
