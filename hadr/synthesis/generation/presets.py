"""What the frames of a data set have in common, and the presets of ``hadr generate``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hadr.data.frame import Normals
from hadr.synthesis.generation.recipes import FrameRecipe, SplitBy, frame_recipe

Quality = Literal["fast", "fine"]
Engine = Literal["photo", "raycast"]


@dataclass(frozen=True)
class GenerationSettings:
    """All that the bytes of a frame depend on, besides its index.

    Args:
        seed: Seed of everything.
        width: Image width, pixels.
        height: Image height, pixels; TransHand-14K's pictures are 16:9.
        engine: ``photo`` traces paths (needs ``hadr[generate]``), ``raycast`` needs nothing.
        variant: Of Mitsuba, which draws for ``photo``; None for that of the frames that are there
            already, else for the fastest that works.
        samples: Paths a pixel of ``photo``.
        quality: Of ``raycast``: ``fine`` has shadows and four rays a pixel, ``fast`` one ray.
        sensor: With the raw depth of a simulated depth camera.
        objects: The objects to alternate between; None for all eight.
        split_by: What a split keeps together: ``holding``, ``frame`` or ``object``.
        frames_per_hold: How many frames share a holding pose.
        hold_shift: See :func:`hadr.synthesis.generation.recipes.frame_recipe`.
        recordings: Folder of recorded holds; None makes holds from the seed.
        backgrounds: Folder of photographs for the surroundings; None computes textures.
        depth_format: ``npy`` (float metres) or ``png`` (16 bits, 0.1 mm a step).
        jpeg_quality: Stores colour as JPEG; None as PNG.
        rest_step: Rounds the depth of what is neither hand nor glass, metres; None keeps it.
        raw_format: Raw depth as ``depth`` (16 bits, 1 mm a step), or as the depth camera's
            ``disparity``, which is smaller: 1/16 pixel, beyond 1 m 1/8 pixel.
        normals: Where normals are stored: ``all``, ``held``, ``object`` or ``none``.

    Raises:
        ValueError: A value is out of range.
    """

    seed: int = 0
    width: int = 448
    height: int = 252
    engine: Engine = "raycast"
    variant: str | None = None
    samples: int = 8
    quality: Quality = "fine"
    sensor: bool = False
    objects: tuple[str, ...] | None = None
    split_by: SplitBy = "holding"
    frames_per_hold: float = 2
    hold_shift: int = 0
    recordings: str | None = None
    backgrounds: str | None = None
    depth_format: Literal["npy", "png"] = "npy"
    jpeg_quality: int | None = None
    rest_step: float | None = None
    raw_format: Literal["depth", "disparity"] = "depth"
    normals: Normals = "all"

    def __post_init__(self) -> None:
        choices = {
            "engine": ("photo", "raycast"),
            "quality": ("fast", "fine"),
            "depth_format": ("npy", "png"),
            "raw_format": ("depth", "disparity"),
            "normals": ("all", "held", "object", "none"),
        }
        for name, allowed in choices.items():
            if getattr(self, name) not in allowed:
                known = ", ".join(repr(a) for a in allowed[:-1])
                raise ValueError(
                    f"{name} must be {known} or {allowed[-1]!r}, got {getattr(self, name)!r}"
                )
        if self.width < 16 or self.height < 9:
            raise ValueError(f"a frame needs at least 16x9 pixels, got {self.width}x{self.height}")
        if self.seed < 0 or self.samples < 1:
            raise ValueError(f"need seed >= 0 and samples >= 1, got {self.seed} and {self.samples}")
        if self.jpeg_quality is not None and not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality must lie in 1..100, got {self.jpeg_quality}")
        self.recipe(0)

    def recipe(self, index: int) -> FrameRecipe:
        """What frame ``index`` shows."""
        return frame_recipe(
            index,
            seed=self.seed,
            objects=self.objects,
            frames_per_hold=self.frames_per_hold,
            split_by=self.split_by,
            hold_shift=self.hold_shift,
        )


@dataclass(frozen=True)
class Preset:
    """A data set by name.

    Args:
        frames: How many frames it has.
        settings: What they have in common.
        purpose: One line for the command's help.
        bundled_recordings: Poses come from the recordings that are part of the project.
    """

    frames: int
    settings: GenerationSettings
    purpose: str
    bundled_recordings: bool = False


PRESETS: dict[str, Preset] = {
    "tiny": Preset(
        16,
        GenerationSettings(
            width=128, height=72, quality="fast", depth_format="png", jpeg_quality=92
        ),
        "16 ray-cast frames of 128x72 in seconds, to try things out",
    ),
    "samples": Preset(
        480,
        GenerationSettings(
            engine="photo",
            sensor=True,
            depth_format="png",
            jpeg_quality=86,
            rest_step=0.001,
            raw_format="disparity",
            normals="object",
        ),
        "the project's sample frames: 480 of 448x252 from 240 recorded holds",
        bundled_recordings=True,
    ),
    "gallery": Preset(
        12,
        GenerationSettings(
            seed=11,
            width=1280,
            height=720,
            engine="photo",
            samples=16,
            sensor=True,
            frames_per_hold=1,
            hold_shift=5,
            depth_format="png",
            jpeg_quality=86,
            rest_step=0.001,
            raw_format="disparity",
            normals="object",
        ),
        "12 frames of 1280x720 to look at",
    ),
    "mini": Preset(
        4000,
        GenerationSettings(
            seed=1,
            width=256,
            height=144,
            engine="photo",
            sensor=True,
            frames_per_hold=2.5,
            depth_format="png",
            jpeg_quality=92,
            normals="none",
        ),
        "a training set: 4,000 frames of 256x144 from 1,600 holds that the samples don't have",
    ),
    "paper": Preset(
        14100,
        GenerationSettings(
            seed=2,
            width=1280,
            height=720,
            engine="photo",
            sensor=True,
            depth_format="png",
            jpeg_quality=95,
        ),
        "as many frames as TransHand-14K and as large: 14,100 of 1280x720; for a cluster",
    ),
}
