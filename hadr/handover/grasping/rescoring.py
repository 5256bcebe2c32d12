"""Which grasp suits a handover: the paper's formula, and what its authors describe.

The formula (paper, equation 4) compares a direction with itself after R_g. R_g maps gripper
coordinates into some frame, so the value depends on which frame that is, and is largest where
R_g = I whatever the directions are. The described intention, a grasp that faces the human and
points down, compares the approach axis with the directions; it is the same in every frame.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from hadr.camera import Array
from hadr.handover.grasping.grasps import Grasps

Form = Literal["literal", "intended"]
AxisOrder = Literal["paper", "graspnet"]


@dataclass(frozen=True)
class Weights:
    """Weights of the three terms; the paper's values where left out."""

    score: float = 1.0
    robot_to_human: float = 0.4
    up_to_down: float = 0.2


@dataclass(frozen=True)
class Directions:
    """The two directions that a handover cares for, as unit vectors in one named frame.

    Attributes:
        robot_to_human: v_r2h, shape (3,); any length, it is normalised.
        up_to_down: v_u2d, shape (3,), along gravity; it is normalised.
        frame: Name of the frame that both are written in.
    """

    robot_to_human: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    up_to_down: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    frame: str = "base"

    def __post_init__(self) -> None:
        for name in ("robot_to_human", "up_to_down"):
            vector = np.asarray(getattr(self, name), dtype=np.float64)
            length = np.linalg.norm(vector)
            if vector.shape != (3,) or not np.isfinite(length) or length < 1e-9:
                raise ValueError(f"{name} must be a direction (3,) of length > 0, got {vector}")
            object.__setattr__(self, name, vector / length)

    def in_frame(self, rotation: Array, frame: str) -> "Directions":
        """The same directions in another frame; rotation (3, 3) maps the old frame to the new."""
        return Directions(rotation @ self.robot_to_human, rotation @ self.up_to_down, frame)


def literal_score(
    scores: ArrayLike, rotations: ArrayLike, directions: Directions, weights: Weights | None = None
) -> Array:
    """The formula as printed: C = w_s s + w_r2h v^T (R_g v) + w_u2d u^T (R_g u), shape (n,).

    The scores s (n,) are the detector's; R_g (n, 3, 3) is written in the frame of the directions v
    and u. Source: paper, equation 4; ledger row 16.
    """
    w = weights or Weights()
    v, u, r = directions.robot_to_human, directions.up_to_down, np.asarray(rotations)
    toward, down = (np.einsum("i,nij,j->n", d, r, d) for d in (v, u))
    total: Array = w.score * np.asarray(scores) + w.robot_to_human * toward + w.up_to_down * down
    return total


def literal_at_best_turn(
    approach: ArrayLike,
    directions: Directions,
    *,
    axes: AxisOrder = "paper",
    weights: Weights | None = None,
) -> Array:
    """Largest w_r2h v^T (R_g v) + w_u2d u^T (R_g u) over all turns about axes (n, 3): (n,).

    An approach axis leaves the gripper's turn about it free, and the printed formula depends on
    it: with M = w_r2h v v^T + w_u2d u u^T it is the trace of R_g M, a constant and one sine of the
    turn. The maximum is found in closed form. `axes` says which column of R_g is the approach axis:
    "paper" z, "graspnet" x.
    """
    w = weights or Weights()
    v, u = directions.robot_to_human, directions.up_to_down
    m = w.robot_to_human * np.outer(v, v) + w.up_to_down * np.outer(u, u)
    front, first, second = (2, 0, 1) if axes == "paper" else (0, 1, 2)  # second = front x first
    a = np.asarray(approach, dtype=np.float64)
    side = np.cross(a, np.eye(3)[np.abs(a).argmin(axis=1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)  # (n, 3)
    other = np.cross(a, side)  # (n, 3)
    cosine = side @ m[first] + other @ m[second]
    sine = other @ m[first] - side @ m[second]
    best: Array = a @ m[front] + np.hypot(cosine, sine)
    return best


def intended_score(
    scores: ArrayLike, approach: ArrayLike, directions: Directions, weights: Weights | None = None
) -> Array:
    """What the text describes: C = w_s s + w_r2h (a . v) + w_u2d (a . u), shape (n,).

    The printed formula with R_g R_0^T for R_g, R_0 a pose whose approach axis is v, then u. The
    unit approach axes a (n, 3) are written in the directions' frame.
    """
    w = weights or Weights()
    wish = w.robot_to_human * directions.robot_to_human + w.up_to_down * directions.up_to_down
    total: Array = w.score * np.asarray(scores) + np.asarray(approach) @ wish
    return total


def rescore(
    grasps: Grasps,
    directions: Directions,
    *,
    form: Form = "intended",
    axes: AxisOrder = "paper",
    weights: Weights | None = None,
) -> Array:
    """Score grasps for a handover: C, shape (n,); higher is better.

    `axes` is the order of columns that R_g has in the literal form: the paper's (z approaches) or
    graspnetAPI's (x approaches). The intended form, the workflow's, does not depend on it.
    ValueError for grasps and directions in different frames, or an unknown form.
    """
    if grasps.frame != directions.frame:
        raise ValueError(
            f"grasps are written in frame {grasps.frame!r}, directions in {directions.frame!r}; "
            "bring both into one frame first (Grasps.in_frame)"
        )
    if form == "intended":
        return intended_score(grasps.scores, grasps.axis("approach"), directions, weights)
    if form == "literal":
        rotations = grasps.poses[:, :3, :3] if axes == "paper" else grasps.rotations
        return literal_score(grasps.scores, rotations, directions, weights)
    raise ValueError(f"form must be 'intended' or 'literal', got {form!r}")
