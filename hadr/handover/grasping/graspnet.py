"""A user's own grasp detector in the sampler's place: arrays of graspnetAPI, read and converted.

graspnetAPI's `GraspGroup.save_npy` writes one row of 17 numbers for each grasp, in the camera
frame and in metres: score, width, height, depth, R (9, row by row; its first column approaches),
t (3), object_id.
"""

import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hadr.camera import Array, transform_points
from hadr.handover.grasping.candidates import NoCandidateError
from hadr.handover.grasping.grasps import Grasps
from hadr.handover.grasping.gripper import LARGEST_OPENING
from hadr.handover.poses import check_pose

Detect = Callable[[Array], ArrayLike]
"""From the object's points in the camera frame (n, 3), metres, to rows (m, 17)."""
ROUNDING = 1e-6
"""A width above the largest opening by less than this, metres, is that opening in float32."""
METRES = 0.5
"""No parallel gripper opens wider, metres: a larger number is a width in millimetres."""
FARTHEST = 0.03
"""Grasps further than this from the object's points belong to something else and are left out: the
filter by the object's mask. Metres."""
SCORES = (-1.0, 3.0)
"""Where a score must lie to be weighed against the other two terms of the rescoring.
graspnet-baseline is trained on ln(u_max / u), u the friction that a grasp needs: 0 to about 2.5,
not 0 to 1, and what a network predicts may be a little below 0. Percentages do not belong here."""


def from_graspnet(source: str | Path | ArrayLike, base_from_camera: Array | None = None) -> Grasps:
    """Read a detector's grasps, best first; those too wide for the gripper are left out.

    The network was trained for 100 mm, to which it cuts its widths; a warning says how many are
    left out.

    Args:
        source: A `.npy` file of `GraspGroup.save_npy`, or its array `grasp_group_array`, shape
            (n, 17), or (n, 16) without object_id.
        base_from_camera: The camera's calibration, shape (4, 4), metres; where left out the grasps
            stay in the camera frame.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It holds no rows of 17 real numbers, or one is no grasp, see `Grasps.from_rows`;
            a width looks like millimetres, a score lies outside `SCORES`; or the calibration is no
            rigid transform.
    """
    table = _read(Path(source)) if isinstance(source, str | Path) else np.asarray(source)
    if table.size == 0:
        table = np.zeros((0, 17))
    if table.dtype.kind not in "fiu":
        what = f"an array of {table.dtype}" if table.ndim else repr(source)
        raise ValueError(
            f"grasp rows must be real numbers, got {what} (a GraspGroup's are its "
            "grasp_group_array)"
        )
    if table.ndim == 2 and table.shape[1] == 16:
        table = np.concatenate([table, -np.ones((len(table), 1))], axis=1)
    grasps, (low, high) = Grasps.from_rows(table, "camera"), SCORES
    if len(grasps):  # rows of a text file have few digits, and poses are asked for more
        proper = Rotation.from_matrix(grasps.rotations).as_matrix()
        grasps = replace(grasps, rotations=proper)
    for row in np.flatnonzero(grasps.widths > METRES)[:1]:
        raise ValueError(
            f"grasp {row}: width must be in metres, at most {METRES}; {grasps.widths[row]:g} looks "
            "like millimetres"
        )
    for row in np.flatnonzero((grasps.scores < low) | (grasps.scores > high))[:1]:
        raise ValueError(
            f"grasp {row}: score must lie in {low:g}..{high:g}, got {grasps.scores[row]:g}: scale "
            "the detector's scores first"
        )
    if base_from_camera is not None:
        grasps = grasps.in_frame(check_pose(base_from_camera, "base_from_camera"), "base")
    order = np.argsort(-grasps.scores, kind="stable")
    fits = grasps.widths <= LARGEST_OPENING + ROUNDING
    if not fits.all():
        warnings.warn(_left_out(fits, f"they need more than {LARGEST_OPENING} m"), stacklevel=2)
    kept = grasps.select(order[fits[order]])
    return replace(kept, widths=np.minimum(kept.widths, LARGEST_OPENING))


def _left_out(kept: NDArray[np.bool_], why: str) -> str:
    return f"{np.count_nonzero(~kept)} of {len(kept)} grasps are left out: {why}"


def _read(path: Path) -> NDArray[np.generic]:
    """The array of a file of numpy.save."""
    if not path.exists():
        raise FileNotFoundError(f"there is no file {path} of grasps")
    try:
        found = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is not an array that numpy.save wrote: {error}") from error
    if not isinstance(found, np.ndarray):
        found.close()
        raise ValueError(f"{path} is not an array that numpy.save wrote, but an archive of several")
    return found


@dataclass(frozen=True)
class DetectedGrasps:
    """Gives `GraspSelection` a detector's grasps instead of sampled ones.

        detect = lambda points: network(points).grasp_group_array     # yours, camera frame
        choose = GraspSelection(rng, eye, source=DetectedGrasps(detect, base_from_camera))

    A grasp is what its point is: from there the robot's moves are counted, and the depth tells only
    whether the fingertips are at the object.

    Attributes:
        detect: From the object's points in the camera frame, (n, 3) in metres, to rows (m, 17); it
            may leave the points aside and work on a picture of its own.
        base_from_camera: The camera's calibration, shape (4, 4), metres.
    """

    detect: Detect
    base_from_camera: Array

    def __post_init__(self) -> None:
        check_pose(self.base_from_camera, "base_from_camera")

    def __call__(self, points: Array) -> Grasps:
        """The detector's grasps of an object's points (n, 3), metres, base frame, best first.

        Warns how many lie beside the object; NoCandidateError where no grasp is left.
        """
        camera_from_base = np.linalg.inv(self.base_from_camera)
        rows = self.detect(transform_points(camera_from_base, points))
        grasps = from_graspnet(rows, self.base_from_camera)
        # the grasp's point stands before the surface: look at the fingertips too
        tips = grasps.translations + grasps.depths[:, None] * grasps.axis("approach")
        tree = cKDTree(points)
        near = np.minimum(tree.query(grasps.translations)[0], tree.query(tips)[0]) <= FARTHEST
        if not near.any():
            raise NoCandidateError(
                f"of the detector's {np.shape(rows)[0]} grasps {len(grasps)} fit the gripper, "
                f"and none of them lies within {FARTHEST} m of the object"
            )
        if not near.all():
            far = f"they lie more than {FARTHEST} m from the object"
            warnings.warn(_left_out(near, far), stacklevel=2)
        return grasps.select(near)
