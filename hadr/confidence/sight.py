"""What a depth network sees in a frame, and how unusual that is.

Between a network's input and its answer lies what it sees: the map of one of its parts, taken in
the glass. In training these vectors keep near a few main directions; what lies off them is one
more feature of a frame (`hadr.confidence.frame_features`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hadr.camera import Array, BoolArray, FloatArray, Intrinsics
from hadr.confidence.calibration import within_learned
from hadr.confidence.frame_features import frame_features, outline_features
from hadr.records.reading import structured

if TYPE_CHECKING:
    from torch import Tensor

    from hadr.models.network_input import HADRInput


DIRECTIONS = 8
"""Main directions of what a network sees; what lies off them is a feature."""


@dataclass(frozen=True)
class Observation:
    """What a network answered of one frame, and what is compared with its ground.

    Attributes:
        output: Its answer.
        features: What was measured of the frame.
        seen: What it saw in the glass, shape (E,).
    """

    output: Any
    features: dict[str, float]
    seen: Array


@dataclass(frozen=True)
class Sight:
    """What a network usually sees: mean and main directions of its own features in the glass.

    Attributes:
        mean: Shape (E,).
        spread: Standard deviations, shape (E,).
        directions: Orthonormal, in the standardised features, shape (K, E).
    """

    mean: Array
    spread: Array
    directions: Array

    @classmethod
    def fit(cls, seen: FloatArray) -> Sight:
        """Fit it to what the network saw in N training frames, shape (N, E)."""
        mean, spread = seen.mean(axis=0), np.maximum(seen.std(axis=0), 1e-6)
        _, _, axes = np.linalg.svd((seen - mean) / spread, full_matrices=False)
        return cls(mean, spread, axes[:DIRECTIONS])

    def strangeness(self, seen: FloatArray) -> float:
        """How much of what it sees, shape (E,), lies off the main directions; 1 is usual."""
        off = (seen - self.mean) / self.spread
        rest = off - off @ self.directions.T @ self.directions
        return float(np.sqrt((rest**2).mean()))

    def with_strangeness(self, one: Observation) -> dict[str, float]:
        """The features of an observation, with that of what the network saw."""
        return {**one.features, "seen": self.strangeness(one.seen)}

    def to_dict(self) -> dict[str, Any]:
        """The numbers, rounded, for a checkpoint's record."""
        return {name: rounded(numbers) for name, numbers in vars(self).items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Sight:
        """Build it from `to_dict`, or from the same read from JSON; errors as `Field.from_dict`."""
        stored = structured(values, _StoredSight, "sight", further=True)
        return cls(**{name: np.asarray(numbers) for name, numbers in vars(stored).items()})


@dataclass(frozen=True)
class _StoredSight:
    """A sight as records store it."""

    mean: list[float]
    spread: list[float]
    directions: list[list[float]]

    def __post_init__(self) -> None:
        if {len(self.mean)} != {len(self.spread), *map(len, self.directions)}:
            raise ValueError("mean, spread and directions must be of one length")


def observe(
    network: Any,
    part: str,
    inputs: HADRInput,
    measured: FloatArray,
    depth_range_m: tuple[float, float] | None,
    color: npt.NDArray[np.uint8],
    mask: BoolArray,
) -> Observation:
    """Ask a depth network about one frame, a batch of one whose mask has a pixel, and measure it.

    The map of the part of this name, (1, E, h, w), is what it sees. Further it takes z-depth (H, W)
    at this size as the camera measured it, in the glass too, metres, 0 = missing; the depths of the
    object in training, metres, None if unknown; picture, RGB, uint8, and mask at their own size.
    """
    import torch
    from torch.nn import functional

    from hadr.models.window import lay_windows, nearest

    maps: list[Tensor] = []

    def keep(_module: Any, _given: Any, found: Any) -> None:
        maps.append(found[0] if isinstance(found, tuple) else found)

    handle = network.get_submodule(part).register_forward_hook(keep)
    try:
        output = network(inputs)
    finally:
        handle.remove()
    seen = maps[0]  # (1, E, h, w)
    weight = torch.ones_like(seen[:, :1])
    if not hasattr(network, "crop"):  # a crop lies around the glass; a picture shows more
        view = network.config.view
        glass = inputs.mask if view is None else nearest(lay_windows(inputs, view), inputs.mask)
        weight = functional.adaptive_avg_pool2d(
            glass[:, None].to(seen.dtype), (seen.shape[2], seen.shape[3])
        )
    vector = (seen * weight).sum(dim=(2, 3)) / weight.sum()  # (1, E)
    found = (output.depth * within_learned(output, depth_range_m))[0]  # (H, W)
    height, width = inputs.depth.shape[1:]
    fx, fy, cx, cy = inputs.intrinsics[0].tolist()
    camera = Intrinsics(fx, fy, cx, cy, width, height)
    hand = inputs.keypoints[0].double().numpy()
    features = frame_features(
        measured, found.numpy(), camera, inputs.mask[0].numpy(), hand if hand.any() else None
    )
    features |= outline_features(color, mask)
    return Observation(output, features, vector[0].double().numpy())


def rounded(values: Array) -> Any:
    """Round to four digits and make lists, for a checkpoint's record."""
    return np.vectorize(lambda x: float(f"{x:.4g}"))(values).tolist()
