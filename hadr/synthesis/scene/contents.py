"""What a scene holds, whoever draws or measures it: surfaces, what covers them, and lights."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hadr.camera import Array, Intrinsics
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.scene.lights import AreaLight, Environment


@dataclass(frozen=True)
class Surroundings:
    """Opaque textured surfaces.

    Args:
        surface: The triangles, world frame.
        uv: Texture coordinates per vertex, in repeats, shape (V, 2).
        texture: Number of the texture per face, shape (F,).
        tint: Factor on the texture's colour per face, shape (F, 3).
        repeat: Height of one repeat per face, metres, shape (F,).
        photographs: Files that negative numbers of textures stand for.
    """

    surface: Surface
    uv: Array
    texture: npt.NDArray[np.int64]
    tint: Array
    repeat: Array
    photographs: tuple[Path, ...] = ()


@dataclass(frozen=True, eq=False)
class Contents:
    """The things of a scene, world frame, metres.

    Args:
        hand: The skinned hand, or None.
        glass: The closed glass bodies; overlapping ones count as one.
        transmittance: Of a centimetre of the glass, one value per colour of the light.
        surroundings: Everything else, or None.
        lamps: Rectangles that shine; the first one is the key light.
        environment: Light from far away; without, an even grey.
    """

    hand: HandMesh | None = None
    glass: tuple[Surface, ...] = ()
    transmittance: tuple[float, ...] = (0.95, 0.975, 0.965)
    surroundings: Surroundings | None = None
    lamps: tuple[AreaLight, ...] = ()
    environment: Environment | None = None


@dataclass(frozen=True)
class Scene:
    """Contents before a camera.

    Args:
        contents: The surfaces, lights and materials, world frame.
        camera: Intrinsics.
        world_from_camera: Pose of the OpenCV camera, shape (4, 4).
        aperture: Radius of the lens, metres; 0 is a pinhole. Only path-traced colour is blurred.
        focus: z-depth that is sharp, metres.
    """

    contents: Contents
    camera: Intrinsics
    world_from_camera: Array
    aperture: float = field(default=0.0, kw_only=True)
    focus: float = field(default=1.0, kw_only=True)
