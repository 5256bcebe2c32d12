"""Grasp candidates: the rows of 17 numbers, axes by name, the pose before and after the grasp.

graspnetAPI writes a grasp's rotation with the approach axis first: R[:, 0] approach, R[:, 1]
closing, R[:, 2] height. The paper calls the approach axis z. `Grasps.poses` is the only place where
one convention becomes the other.
"""

from dataclasses import dataclass, fields, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hadr.camera import Array

Axis = Literal["approach", "closing", "height"]
FinalMove = Literal["past_grasp", "from_pre_grasp"]

ROW_NAMES: tuple[str, ...] = (
    *("score", "width", "height", "depth"),
    *(f"r{row}{column}" for row in range(3) for column in range(3)),
    *("tx", "ty", "tz", "object_id"),
)
"""Names of a row's 17 numbers."""
BACK, FORWARD = 0.10, 0.05
"""The paper's way in: from so far before the predicted grasp to so far past it, metres."""


class Way(NamedTuple):
    """The final move of a grasp: what is checked in planning is what is gone.

    Attributes:
        back: It begins so far before the predicted grasp, metres.
        forward: It ends so far past it.
        feel: So much farther the fingers may go on, feeling for the object, metres: as far as hand
            and scene leave free and the arm reaches; the object itself is what they feel for.
    """

    back: float = BACK
    forward: float = FORWARD
    feel: float = 0.0

    @property
    def last(self) -> float:
        """How far past the predicted grasp the fingers may come, metres."""
        return self.forward + self.feel


PAPER_WAY = Way()
FEELING_STEP = 0.01
"""While nothing is felt the final move is made longer by this at a time, metres."""
_COLUMN = {"approach": 0, "closing": 1, "height": 2}


@dataclass(frozen=True)
class Grasps:
    """Parallel-gripper grasps in one frame.

    Attributes:
        scores: What the detector thinks of each, shape (n,).
        widths: Opening between the fingers, shape (n,), metres.
        heights: Thickness of a finger along the height axis, shape (n,), metres.
        depths: How far the fingertips stand past the grasp's point, shape (n,), metres.
        rotations: frame_from_grasp in graspnetAPI's order of axes, shape (n, 3, 3).
        translations: The grasps' points in the frame, shape (n, 3), metres.
        object_ids: Which object, shape (n,); -1 where unknown.
        frame: Name of the frame that rotations and translations are written in.
    """

    scores: Array
    widths: Array
    heights: Array
    depths: Array
    rotations: Array
    translations: Array
    object_ids: NDArray[np.int64]
    frame: str = "camera"

    def __post_init__(self) -> None:
        if (self.widths < 0).any():
            raise ValueError(f"widths must be 0 or more metres, got {self.widths.min()}")
        product = np.einsum("nij,nkj->nik", self.rotations, self.rotations)
        off = np.abs(product - np.eye(3)).max(axis=(1, 2), initial=0.0)
        wrong = np.flatnonzero((off > 1e-4) | (np.linalg.det(self.rotations) < 0))
        if len(wrong):
            row = int(wrong[0])
            raise ValueError(
                f"grasp {row}: R must be a proper rotation (R R^T = I, det +1), got R R^T off by "
                f"{off[row]:.3g} and det {np.linalg.det(self.rotations[row]):.3g}"
            )

    def __len__(self) -> int:
        return len(self.scores)

    @classmethod
    def from_rows(cls, rows: ArrayLike, frame: str = "camera") -> "Grasps":
        """Read graspnetAPI's array, shape (n, 17), columns as in `ROW_NAMES`, metres.

        ValueError names the row with NaN or infinity, or whose R is no rotation.
        """
        table = np.asarray(rows, dtype=np.float64)
        if table.ndim != 2 or table.shape[1] != 17:
            raise ValueError(
                "grasp rows must have shape (n, 17): score, width, height, depth, R (9), t (3), "
                f"object_id; got shape {table.shape}"
            )
        bad = np.argwhere(~np.isfinite(table))
        if len(bad):
            row, column = bad[0]
            raise ValueError(
                f"grasp {row}: {ROW_NAMES[column]} must be finite, got {table[row, column]}"
            )
        rotations, ids = table[:, 4:13].reshape(-1, 3, 3), table[:, 16].astype(np.int64)
        scores, widths, heights, depths = table[:, :4].T
        return cls(scores, widths, heights, depths, rotations, table[:, 13:16], ids, frame)

    def to_rows(self) -> Array:
        """Write graspnetAPI's array, shape (n, 17)."""
        rotations = self.rotations.reshape(-1, 9)
        columns = (self.scores, self.widths, self.heights, self.depths, rotations)
        return np.column_stack([*columns, self.translations, self.object_ids])

    def axis(self, name: Axis) -> Array:
        """Unit vectors of an axis by its name, in the grasps' frame, shape (n, 3)."""
        vectors: Array = self.rotations[:, :, _COLUMN[name]]
        return vectors

    @property
    def poses(self) -> Array:
        """frame_from_tool in the paper's convention, shape (n, 4, 4), metres.

        x is the closing axis, y the height axis, z the approach axis.
        """
        poses = np.tile(np.eye(4), (len(self), 1, 1))
        for column, name in enumerate(("closing", "height", "approach")):
            poses[:, :3, column] = self.rotations[:, :, _COLUMN[name]]
        poses[:, :3, 3] = self.translations
        return poses

    def select(self, index: NDArray[np.bool_] | NDArray[np.int64]) -> "Grasps":
        """The grasps at a boolean mask (n,) or at indices, in that order."""
        names = [field.name for field in fields(self) if field.name != "frame"]
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def in_frame(self, new_from_old: Array, frame: str) -> "Grasps":
        """The same grasps in the frame of a name, to which a transform (4, 4) leads, metres."""
        rotation, shift = new_from_old[:3, :3], new_from_old[:3, 3]
        turned, moved = rotation @ self.rotations, self.translations @ rotation.T + shift
        return replace(self, rotations=turned, translations=moved, frame=frame)


def pre_grasp(grasps: Grasps, distance: float = BACK, *, axis: Axis = "approach") -> Array:
    """Where the gripper waits: frame_from_tool in the paper's convention, (n, 4, 4), metres.

    It is so far back along the approach axis, the paper's "z". graspnetAPI's z, the third column,
    is the height axis and would put it beside the object; it is here to be looked at (ledger, row
    17).
    """
    poses = grasps.poses
    poses[:, :3, 3] -= distance * grasps.axis(axis)
    return poses


def forward_of(pose: Array, distance: float) -> Array:
    """A tool pose (..., 4, 4) moved forward along its approach axis z, metres; negative is back."""
    moved = np.array(pose, dtype=np.float64)
    moved[..., :3, 3] += distance * moved[..., :3, 2]
    return moved


def final_travel(
    reading: FinalMove = "past_grasp", *, back: float = BACK, forward: float = FORWARD
) -> float:
    """Metres along the approach axis from the pre-grasp to where the gripper closes.

    "past_grasp": 5 cm past the predicted grasp, so 15 cm. "from_pre_grasp": 5 cm from where it
    waits, which leaves it 5 cm short (ledger, row 21). ValueError for another reading.
    """
    if reading not in ("past_grasp", "from_pre_grasp"):
        raise ValueError(f"reading must be past_grasp or from_pre_grasp, got {reading!r}")
    return back + forward if reading == "past_grasp" else forward
