"""Where the error of a restored frame comes from: place or shape, and how new the pose is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy import stats
from torch import Tensor

from hadr.camera import BoolArray, FloatArray
from hadr.training.frames.batches import FrameTensors


@dataclass(frozen=True)
class FrameError:
    """The error of one frame on the object's pixels, metres.

    Attributes:
        object_id: The held object.
        rmse_m: Root mean square of the error; a pixel without a depth counts as depth 0.
        place_m: Size of the median error: the whole object stands too near or too far.
        bias_m: The median error with its sign: negative is too near, positive too far.
        shape_m: Root mean square that is left without the median error.
        tilt_m: Root mean square that is left without the best plane in pixels: what neither
            moving nor tilting the object heals.
    """

    object_id: str
    rmse_m: float
    place_m: float
    bias_m: float
    shape_m: float
    tilt_m: float


def frame_error(
    object_id: str, depth: FloatArray, truth: FloatArray, mask: BoolArray
) -> FrameError:
    """Take the error of a frame apart."""
    counted = mask & (truth > 0)
    if not counted.any():
        raise ValueError("no pixel of the object has a true depth")
    error = (depth - truth)[counted].astype(np.float64)
    row, column = np.nonzero(counted)
    basis = np.stack([row, column, np.ones_like(row)], axis=1).astype(np.float64)
    fit, *_ = np.linalg.lstsq(basis, error, rcond=None)
    middle = float(np.median(error))
    return FrameError(
        object_id,
        rmse_m=_root_mean_square(error),
        place_m=abs(middle),
        bias_m=middle,
        shape_m=_root_mean_square(error - middle),
        tilt_m=_root_mean_square(error - basis @ fit),
    )


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def hand_poses(frames: FrameTensors) -> Tensor:
    """Describe each hand in the camera's directions: keypoints around their median, m, (N, 63)."""
    points = frames.true_keypoints
    return (points - points.median(dim=1, keepdim=True).values).flatten(1)


def pose_distance(poses: Tensor, learned: Tensor) -> Tensor:
    """Mean distance (N,) of the 21 keypoints from those of the nearest learned pose, metres.

    Both are as `hand_poses` gives them; each of the learned ones (M, 63) counts mirrored as well.
    ValueError where nothing was learned.
    """
    if len(learned) == 0:
        raise ValueError("there is no learned pose")
    mirrored = learned.view(-1, 21, 3) * torch.tensor([-1.0, 1.0, 1.0])
    known = torch.cat((learned.view(-1, 21, 3), mirrored))
    nearest = [(known - pose.view(1, 21, 3)).norm(dim=2).mean(dim=1).min() for pose in poses]
    return torch.stack(nearest)


def summary(errors: list[FrameError], distance: Tensor) -> dict[str, Any]:
    """Summarise frames: parts of the error, each object, and near and far poses.

    From each frame's error and its distance from the nearest learned pose, metres, (N,):
    ``rmse_m``, ``place_m``, ``bias_m``, ``shape_m``, ``tilt_m``, means over the frames;
    ``by_object`` the same for each; ``by_pose``: thirds of the frames from the nearest to the
    farthest pose, each with its mean distance and RMSE; ``rank_correlation`` of distance and RMSE.
    """
    far = distance.numpy()
    thirds = np.array_split(np.argsort(far, kind="stable"), 3)
    rmse = np.array([error.rmse_m for error in errors])
    return {
        **_means(errors),
        "by_object": {
            name: _means([e for e in errors if e.object_id == name])
            for name in sorted({e.object_id for e in errors})
        },
        "by_pose": [
            {"distance_m": float(far[part].mean()), "rmse_m": float(rmse[part].mean())}
            for part in thirds
            if len(part)
        ],
        "rank_correlation": float(stats.spearmanr(far, rmse).statistic),
    }


def _means(errors: list[FrameError]) -> dict[str, Any]:
    names = ("rmse_m", "place_m", "bias_m", "shape_m", "tilt_m")
    values = {name: float(np.mean([getattr(e, name) for e in errors])) for name in names}
    return {"frames": len(errors), **values}
