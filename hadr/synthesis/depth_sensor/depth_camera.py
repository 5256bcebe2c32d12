"""An active-stereo depth camera that fails on glass as real ones do.

Two infrared imagers look at the scene under a projector's dots
(`hadr.synthesis.depth_sensor.infrared`), a matcher finds disparities and refuses what it is unsure
of (`hadr.synthesis.depth_sensor.stereo_matching`), and the depth is aligned to the colour camera.

Free parameters (number of dots and their strength, the matcher's window, NCC, texture and
edge thresholds) were chosen so that glasses on a table, drawn with seed 435, fail about as much as
those of two real D435 frames; `benchmarks/cameras/depth_camera.py` compares both on another seed.

Idealised: the imagers are perfectly rectified, glass is clean (no dust, no fingerprints, nothing
scatters on it), skin and surroundings are matt, the room's light throws no shadows, and there is
one exposure without motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Array, Intrinsics, pixel_grid
from hadr.synthesis.depth_sensor.infrared import InfraredScene, Projector
from hadr.synthesis.depth_sensor.stereo_matching import Matching, align_to_color, match
from hadr.synthesis.rendering.raycast import rays_through
from hadr.synthesis.scene.contents import Scene

Float = npt.NDArray[np.float32]
Picture = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class StereoCamera:
    """A camera like Intel's RealSense D435.

    Baseline 50 mm, depth field 87 x 58 degrees, infrared dot projector of 86 x 57 degrees at
    850 nm: the D400 series' datasheet (337029). Published factory calibrations of several D435
    give an imager's focal length of 423 to 427 pixels in the mode 848x480, and the colour camera
    14.6 to 15.1 mm to the left of the left imager. Only that part of the imagers' field is drawn
    which the colour camera can see.

    Args:
        baseline: Distance of the two imagers, metres.
        left_imager: Place of the left imager on the colour camera's x axis, metres.
        projector_place: The projector's distance from the left imager, metres.
        focal: The imagers' focal length, pixels.
        closest: Least depth that the drawn field must hold, metres.
        farthest: Larger depths are not reported, metres.
        step: Unit of the reported depth, metres.
        blur: Standard deviation of the lens's blur, pixels.
        exposure: Mean grey value that the automatic exposure aims at.
        noise: Standard deviation of the imager's read noise, grey values.
        full_well: Electrons of a white pixel; their number is random (shot noise).
        projector: The dots.
        matching: The matcher.
    """

    baseline: float = 0.050
    left_imager: float = 0.015
    projector_place: float = 0.029
    focal: float = 425.0
    closest: float = 0.17
    farthest: float = 4.0
    step: float = 0.001
    blur: float = 0.55
    exposure: float = 80.0
    noise: float = 1.2
    full_well: float = 6000.0
    projector: Projector = field(default_factory=Projector)
    matching: Matching = field(default_factory=Matching)


_D435 = StereoCamera()


@dataclass(frozen=True)
class InfraredPair:
    """What the two imagers saw, each (H, W) uint8, with the intrinsics of both."""

    left: Picture
    right: Picture
    imager: Intrinsics
    margin: int
    """Columns on the left of the left picture, the search range, that were not drawn: 0."""


def _imager(color: Intrinsics, camera: StereoCamera) -> Intrinsics:
    """The drawn part of the imagers' field, with the margin of the search range on its left."""
    f, shift = camera.focal, camera.left_imager / camera.closest
    low_x = int(np.floor(f * (-(color.cx + 0.5) / color.fx - shift))) - 2
    low_x -= camera.matching.disparities
    high_x = int(np.ceil(f * (color.width - 0.5 - color.cx) / color.fx)) + 2
    low_y = int(np.floor(-f * (color.cy + 0.5) / color.fy)) - 2
    high_y = int(np.ceil(f * (color.height - 0.5 - color.cy) / color.fy)) + 2
    return Intrinsics(f, f, -low_x, -low_y, high_x - low_x + 1, high_y - low_y + 1)


def infrared_pair(scene: Scene, seed: int, camera: StereoCamera = _D435) -> InfraredPair:
    """Draw what the two infrared imagers of a depth camera see; ``seed`` is that of their noise."""
    imager, margin = _imager(scene.camera, camera), camera.matching.disparities
    pose = scene.world_from_camera
    projector = pose[:3, 3] + pose[:3, 0] * (camera.left_imager + camera.projector_place)
    infrared = InfraredScene(scene.contents, camera.projector, projector, pose[:3, :3])
    height, width = imager.shape
    uv = pixel_grid(imager)
    # The left imager's margin is never matched, so it is not drawn.
    rays = (
        rays_through(uv[:, margin:], imager, pose, camera.left_imager),
        rays_through(uv, imager, pose, camera.left_imager + camera.baseline),
    )
    origins, directions = (np.concatenate(both) for both in zip(*rays, strict=True))
    light = infrared.radiance(origins, directions, 1.0 / imager.fx)
    rng = np.random.default_rng([seed, 435])
    gain = camera.exposure / max(float(np.minimum(light, 2.0).mean()), 1e-3)
    left, right = (
        _expose(np.minimum(part.reshape(height, -1), 8.0) * gain, camera, rng)
        for part in np.split(light, [height * (width - margin)])
    )
    return InfraredPair(np.pad(left, ((0, 0), (margin, 0))), right, imager, margin)


def _expose(light: Array, camera: StereoCamera, rng: np.random.Generator) -> Picture:
    """Lens blur, shot and read noise, eight bits."""
    image = cv2.GaussianBlur(light, (0, 0), camera.blur)
    spread = np.sqrt(camera.noise**2 + 255.0 * np.maximum(image, 0) / camera.full_well)
    noisy = image + spread * rng.standard_normal(image.shape)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), dtype=np.uint8)


def capture_depth(scene: Scene, seed: int, camera: StereoCamera = _D435) -> Float:
    """Measure a scene's depth, metres, aligned to its colour camera, (H, W) float32; 0 is missing.

    The same seed (of the imagers' noise) gives the same depth.
    """
    pair = infrared_pair(scene, seed, camera)
    disparity = match(pair.left, pair.right, camera.matching)
    disparity[:, : pair.margin] = 0
    seen = disparity > 0
    z = camera.focal * camera.baseline / np.where(seen, disparity, 1.0)
    z = np.rint(z / camera.step) * camera.step
    depth = np.where(seen & (z <= camera.farthest), z, 0.0).astype(np.float32)
    return align_to_color(depth, pair.imager, scene.camera, camera.left_imager)
