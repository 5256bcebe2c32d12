"""Augmentation of training frames: other colours, and the same scene seen by another camera.

The geometric changes are exact, because each of them is a camera that really could have taken the
picture: a mirror's camera (a left hand holds the glass then), one with a longer focal length that
looks at a part (zoom and crop), one that is turned about its optical axis (roll). The z-depth of a
surface point is the same for all of them; only its pixel, the intrinsics, and x and y of the
keypoints change. Depth and masks are taken from the nearest pixel, colour is interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from hadr.data.augmentation import augment_color
from hadr.models.window import WindowConfig, lay_windows, nearest, seen_through
from hadr.training.frames.batches import FrameTensors
from hadr.training.frames.predicted import pixels_of
from hadr.training.recipe import Preset

_TRIES = 5
Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class OtherCamera:
    """A camera at the same place that sees the same scene otherwise.

    Attributes:
        camera_from_old: Takes points of the old camera frame to the new one, (3, 3): a roll about
            the optical axis, perhaps a mirror.
        pixel_from_old: Affine map of old pixels (column, row, 1) to new ones, (2, 3).
        intrinsics: fx, fy, cx, cy of the new camera in pixels, shape (4,).
    """

    camera_from_old: Matrix
    pixel_from_old: Matrix
    intrinsics: Matrix


def other_camera(
    intrinsics: npt.ArrayLike,
    size: tuple[int, int],
    *,
    mirror: bool = False,
    zoom: float = 1.0,
    corner: tuple[float, float] = (0.0, 0.0),
    roll: float = 0.0,
) -> OtherCamera:
    """Describe a camera that looks elsewhere than one of fx, fy, cx, cy; both of (width, height).

    It rolls about the optical axis, radians from x to y; then everything becomes `zoom` times as
    large, and the part stays whose upper left corner is (column, row), pixels from the picture's
    edge; a mirror swaps left and right at last.
    """
    fx, fy, cx, cy = np.asarray(intrinsics, dtype=np.float64)
    sine, cosine = np.sin(roll), np.cos(roll)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
    new = np.array(
        [
            fx * zoom,
            fy * zoom,
            (cx + 0.5 - corner[0]) * zoom - 0.5,
            (cy + 0.5 - corner[1]) * zoom - 0.5,
        ]
    )
    if mirror:
        turn = np.diag([-1.0, 1.0, 1.0]) @ turn
        new[2] = size[0] - 1 - new[2]
    pixel = _matrix(new) @ turn @ np.linalg.inv(_matrix(np.array([fx, fy, cx, cy])))
    return OtherCamera(turn, pixel[:2], new)


def _matrix(intrinsics: Matrix) -> Matrix:
    fx, fy, cx, cy = intrinsics
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def seen_by(frame: FrameTensors, camera: OtherCamera) -> FrameTensors:
    """Give one frame as the other camera sees it; beyond the old edge there is only its colour."""
    given = frame.inputs
    turn = torch.from_numpy(camera.camera_from_old).float()
    pixel = torch.from_numpy(camera.pixel_from_old).float()
    uv = given.keypoints_uv @ pixel[:, :2].T + pixel[:, 2]
    known = (given.keypoints != 0).any().to(uv.dtype)
    height, width = given.depth.shape[1:]
    source = _sources(camera, width, height)
    inputs = replace(
        given,
        color=_smooth(given.color, camera),
        depth=_nearest(given.depth, source),
        mask=_nearest(given.mask, source),
        intrinsics=_batch(camera.intrinsics.astype(np.float32)),
        keypoints=given.keypoints @ turn.T,
        keypoints_uv=uv * known,
    )
    return FrameTensors(
        inputs=inputs,
        true_depth=_nearest(frame.true_depth, source),
        hand_mask=_nearest(frame.hand_mask, source),
        object_mask=_nearest(frame.object_mask, source),
        true_keypoints=frame.true_keypoints @ turn.T,
        stems=frame.stems,
    )


def _sources(camera: OtherCamera, width: int, height: int) -> npt.NDArray[np.int64]:
    """Number of the old pixel nearest to each new one, -1 beyond the old picture: (H, W)."""
    old = cv2.invertAffineTransform(camera.pixel_from_old)
    column, row = np.arange(width), np.arange(height)[:, None]
    x = np.floor(old[0, 0] * column + old[0, 1] * row + old[0, 2] + 0.5).astype(np.int64)
    y = np.floor(old[1, 0] * column + old[1, 1] * row + old[1, 2] + 0.5).astype(np.int64)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return np.where(inside, y * width + x, -1)


def _nearest(images: Tensor, source: npt.NDArray[np.int64]) -> Tensor:
    """Take the pixels of a single picture (1, H, W); zeros where the source is -1."""
    taken = np.take(images.numpy().reshape(-1), source)  # -1 takes any
    return torch.from_numpy(taken * (source >= 0))[None].to(images.dtype)


def _smooth(images: Tensor, camera: OtherCamera) -> Tensor:
    """Interpolate a single picture (1, C, H, W) bilinearly; the edge goes on beyond it."""
    height, width = images.shape[2:]
    warped = cv2.warpAffine(
        images[0].permute(1, 2, 0).numpy(),
        cv2.invertAffineTransform(camera.pixel_from_old),
        (width, height),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return _batch(warped).permute(0, 3, 1, 2).contiguous()


def _batch(image: npt.NDArray[np.generic]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(image))[None]


def draw_camera(frame: FrameTensors, recipe: Preset, rng: np.random.Generator) -> OtherCamera:
    """Draw a camera that sees all of the object's pixels; where none does, only the mirror's."""
    height, width = frame.true_depth.shape[1:]
    intrinsics = frame.inputs.intrinsics[0].numpy()
    mirror = bool(rng.random() < recipe.mirror)
    rows, columns = np.nonzero((frame.object_mask | frame.inputs.mask)[0].numpy())
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=1)
    for _ in range(_TRIES if recipe.zoom > 1 or recipe.roll_deg > 0 else 0):
        zoom = float(rng.uniform(1, recipe.zoom))
        free = np.array([width, height]) * (1 - 1 / zoom)
        camera = other_camera(
            intrinsics,
            (width, height),
            mirror=mirror,
            zoom=zoom,
            corner=tuple(rng.uniform(0, free)),
            roll=float(np.radians(rng.uniform(-recipe.roll_deg, recipe.roll_deg))),
        )
        moved = pixels @ camera.pixel_from_old.T
        if ((moved > -0.5) & (moved < np.array([width, height]) - 0.5)).all():
            return camera
    return other_camera(intrinsics, (width, height), mirror=mirror)


def with_keypoint_noise(
    frame: FrameTensors, deviation: float, rng: np.random.Generator
) -> FrameTensors:
    """Give one frame's keypoints an error of this deviation, metres; half is the whole hand's."""
    keypoints = frame.inputs.keypoints
    if not bool((keypoints != 0).any()):
        return frame  # no hand is known
    error = np.sqrt(0.5) * deviation * (rng.normal(size=(21, 3)) + rng.normal(size=(1, 3)))
    moved = keypoints + torch.from_numpy(error).to(keypoints.dtype)
    uv = pixels_of(moved, frame.inputs.intrinsics)
    return replace(frame, inputs=replace(frame.inputs, keypoints=moved, keypoints_uv=uv))


def through_view(
    frame: FrameTensors, view: WindowConfig, chance: torch.Generator | None = None
) -> FrameTensors:
    """Give frames as they are seen through their windows, laid by chance if there is one."""
    crop = lay_windows(frame.inputs, view, chance)
    return replace(
        frame,
        inputs=seen_through(crop, frame.inputs),
        true_depth=nearest(crop, frame.true_depth),
        hand_mask=nearest(crop, frame.hand_mask),
        object_mask=nearest(crop, frame.object_mask),
    )


def augment_frames(
    batch: FrameTensors, numbers: Sequence[int], recipe: Preset, seed: int, epoch: int
) -> FrameTensors:
    """Augment each frame of a batch, colour in 0..1, by chance of its own; windows come last.

    A frame's number among the training frames decides, with seed and epoch, everything, so that it
    does not matter which process does it.
    """
    geometric = recipe.mirror > 0 or recipe.zoom > 1 or recipe.roll_deg > 0
    view: WindowConfig | None = getattr(recipe.model, "view", None)
    if not (recipe.augment or geometric or recipe.keypoint_noise or view):
        return batch
    frames = []
    for row, number in enumerate(numbers):
        rng = np.random.default_rng((seed, epoch, number))
        frame = batch.take([row])
        if recipe.augment:
            picture = (frame.inputs.color[0] * 255).round().to(torch.uint8).permute(1, 2, 0)
            color = _batch(augment_color(picture.numpy(), rng)).permute(0, 3, 1, 2).float() / 255
            frame = replace(frame, inputs=replace(frame.inputs, color=color))
        if geometric:
            frame = seen_by(frame, draw_camera(frame, recipe, rng))
        if recipe.keypoint_noise:
            frame = with_keypoint_noise(frame, recipe.keypoint_noise, rng)
        if view:
            chance = torch.Generator().manual_seed(int(rng.integers(2**63)))
            frame = through_view(frame, view, chance)
        frames.append(frame)
    return FrameTensors.join(frames)
