"""Infrared pictures of a scene under a dot projector: what a stereo camera's imagers receive.

Light follows the laws of `hadr.synthesis.rendering.refraction` both ways. An imager's rays are
split and bent at every glass surface until they end on something opaque. The projector's beams are
followed the same way, so that dots fall through the glass onto what stands behind it, displaced and
blurred. Glass itself scatters nothing: there are no dots on it, only mirror images.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from hadr.camera import Array
from hadr.records.caches import kept
from hadr.synthesis.rendering.raycast import GLASS, HAND, SURROUNDINGS, RayCaster
from hadr.synthesis.rendering.refraction import Beams, Ends, follow
from hadr.synthesis.rendering.shading import texture_color
from hadr.synthesis.scene.contents import Contents
from hadr.synthesis.textures.noise import look_up

#: Width of the pattern's picture, pixels.
_TEXTURE = 2048
#: Packets of light that stand for one dot on its way through glass.
_PACKETS = 48
#: The projector's own brightness, seen in a perfect mirror, and light from where nothing is.
_GLINT, _BEYOND = 60.0, 0.35
#: Shares of red, green and blue in an infrared grey: red is nearest to it.
_GREY = np.array([0.6, 0.3, 0.1])


@dataclass(frozen=True)
class Projector:
    """A projector of static random dots.

    Args:
        dots: Number of dots over the whole field.
        field: Horizontal and vertical field of projection, degrees.
        dot_width: Standard deviation of a dot's beam, radians.
        strength: Irradiance in the middle of a dot on a wall at one metre, against that of the
            room's light.
        aperture: Radius of the opening that glass mirrors as a glint, metres.
    """

    dots: int = 6000
    field: tuple[float, float] = (86.0, 57.0)
    dot_width: float = 1.5e-3
    strength: float = 3.0
    aperture: float = 1.5e-3

    @property
    def reach(self) -> tuple[float, float]:
        """Half of the field as tangents, horizontal and vertical."""
        across, down = np.tan(np.deg2rad(self.field) / 2)
        return float(across), float(down)

    @kept(4)
    def directions(self) -> Array:
        """Where the dots go, as tangents (x, y), shape (N, 2): a jittered grid, always the same."""
        rng, reach = np.random.default_rng(435), self.reach
        columns = max(round(np.sqrt(self.dots * reach[0] / reach[1])), 1)
        rows = max(round(self.dots / columns), 1)
        y, x = np.mgrid[0:rows, 0:columns].astype(float)
        x = (x + 0.5 + rng.uniform(-0.5, 0.5, x.shape)) / columns
        y = (y + 0.5 + rng.uniform(-0.5, 0.5, y.shape)) / rows
        return np.stack([(2 * x.ravel() - 1) * reach[0], (2 * y.ravel() - 1) * reach[1]], axis=1)


@kept(4)
def _pattern(projector: Projector) -> npt.NDArray[np.float32]:
    """The pattern as a picture over the field, 1 in the middle of a dot, (H, W) float32."""
    half_x, half_y = projector.reach
    height = round(_TEXTURE * half_y / half_x)
    scale = _TEXTURE / (2 * half_x)
    sigma = projector.dot_width * scale
    # The grid carries each dot's energy on its four nearest texels; blurring makes it round.
    image = np.zeros((height, _TEXTURE))
    at = (projector.directions() + np.array([half_x, half_y])) * scale - 0.5
    low = np.floor(at).astype(int)
    part = at - low
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            x = np.clip(low[:, 0] + dx, 0, _TEXTURE - 1)
            y = np.clip(low[:, 1] + dy, 0, height - 1)
            np.add.at(image, (y, x), weight)
    blurred = cv2.GaussianBlur(image, (0, 0), sigma) * (2 * np.pi * sigma**2)
    return np.asarray(blurred, dtype=np.float32)


class InfraredScene:
    """A scene as infrared light sees it, with a projector at a position, world frame, metres.

    The columns of its ``rotation`` (3, 3) are its x, y and viewing axes in the world.
    """

    def __init__(
        self, contents: Contents, projector: Projector, position: Array, rotation: Array
    ) -> None:
        self._caster = RayCaster(replace(contents, transmittance=(1.0,)))
        self._projector, self._position, self._rotation = projector, position, rotation
        self._packets = self._beams_through_glass()

    def _from_projector(self, tangents: Array) -> tuple[Array, Array]:
        d = tangents / np.linalg.norm(tangents, axis=1, keepdims=True) @ self._rotation.T
        return np.broadcast_to(self._position, d.shape), d

    def _beams_through_glass(self) -> tuple[cKDTree, Array] | None:
        """Where the dots behind glass land: a search tree of packets, and each one's light."""
        if not self._caster.contents.glass:
            return None
        width = self._projector.dot_width
        tangents = self._projector.directions()
        centre = np.concatenate([tangents, np.ones((len(tangents), 1))], axis=1)
        near = np.zeros(len(centre), dtype=bool)
        for x, y in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            beam = centre + 2.5 * width * np.array([x, y, 0.0])
            hits = self._caster.first(*self._from_projector(beam))
            near |= self._caster.kind(hits.mesh) == GLASS
        beams = np.repeat(centre[near], _PACKETS, axis=0)
        beams[:, :2] += width * np.random.default_rng(4350).normal(size=(len(beams), 2))
        ends, _ = follow(self._caster, *self._from_projector(beams))
        ends = ends.take(np.flatnonzero((ends.hits.mesh >= 0) & (ends.crossed > 0)))
        if not len(ends.crossed):
            return None
        # A whole dot's light, were it spread by a Gaussian of one metre's standard deviation.
        light = self._projector.strength * width**2 / _PACKETS * ends.beams.weight[:, 0]
        return cKDTree(ends.point), light

    def dots(self, points: Array, normals: Array) -> Array:
        """Irradiance by the projector at points (N, 3), against the room's light, (N,)."""
        away = points - self._position
        distance = np.linalg.norm(away, axis=1)
        away /= np.maximum(distance, 1e-9)[:, None]
        hits = self._caster.first(np.broadcast_to(self._position, away.shape), away)
        facing = -(away * normals).sum(1)
        lit = (hits.distance > distance * (1 - 2e-3) - 1e-3) & (facing > 0)
        light = np.zeros(len(points))
        strength = self._projector.strength * facing[lit] / distance[lit] ** 2
        light[lit] = strength * self._pattern_at(away[lit] @ self._rotation)
        shaded = np.flatnonzero((self._caster.kind(hits.mesh) == GLASS) & ~lit)
        if self._packets is not None and len(shaded):
            tree, packets = self._packets
            blur = 0.5 * self._projector.dot_width * np.maximum(distance[shaded], 0.2)[:, None]
            gap, which = tree.query(points[shaded], k=24, distance_upper_bound=3 * blur.max())
            kernel = np.exp(-0.5 * (gap / blur) ** 2) / blur**2
            light[shaded] = (np.append(packets, 0.0)[which] * kernel).sum(1)
        return light

    def _pattern_at(self, directions: Array) -> Array:
        """The pattern in directions of the projector's frame, 0 to about 1, shape (N,)."""
        half_x, half_y = self._projector.reach
        pattern = _pattern(self._projector)
        scale = pattern.shape[1] / (2 * half_x)
        ahead = np.maximum(directions[:, 2], 1e-6)
        x = (directions[:, 0] / ahead + half_x) * scale - 0.5
        y = (directions[:, 1] / ahead + half_y) * scale - 0.5
        return look_up(pattern, x, y, cv2.BORDER_CONSTANT)

    def _glints(self, mirrored: Beams) -> Array:
        """Light of the projector itself, mirrored by glass."""
        there = self._position - mirrored.origin
        distance = np.linalg.norm(there, axis=1)
        aside = np.linalg.norm(np.cross(there, mirrored.direction), axis=1)
        ahead = (there * mirrored.direction).sum(1) > 0
        width = 3 * self._projector.aperture + 0.004 * distance
        glint = _GLINT * np.exp(-0.5 * (aside / width) ** 2) * ahead
        return np.asarray(mirrored.weight[:, 0] * glint)

    def radiance(self, origins: Array, directions: Array, pixel: float) -> Array:
        """Infrared light that arrives along rays, (N,); 1 is a white wall in the room's light.

        Origins (world frame, metres) and unit directions of looking are (N, 3); a pixel's width is
        a tangent.
        """
        ends, mirrored = follow(self._caster, origins, directions)
        light = self._beyond(ends)
        met = np.flatnonzero(ends.hits.mesh >= 0)
        solid = ends.take(met)
        smooth, flat = self._caster.normals(solid.hits)
        skin = self._caster.kind(solid.hits.mesh) == HAND
        normal = np.where(skin[:, None], smooth, flat)
        normal *= -np.sign((flat * solid.beams.direction).sum(1, keepdims=True))
        room = 0.75 + 0.25 * normal[:, 2]
        light[met] = self._albedo(solid, pixel) * (room + self.dots(solid.point, normal))
        brought = ends.beams.weight[:, 0] * light
        total = np.bincount(ends.beams.row, brought, minlength=len(origins))
        total += np.bincount(mirrored.row, self._glints(mirrored), minlength=len(origins))
        return np.asarray(total)

    def _beyond(self, ends: Ends) -> Array:
        """Light from where there is no surface."""
        light = np.full(len(ends.crossed), _BEYOND)
        missed = np.flatnonzero(ends.hits.mesh < 0)
        environment = self._caster.contents.environment
        if environment is not None:
            color = environment.radiance(ends.beams.direction[missed])
            light[missed] = np.minimum(color @ _GREY, 2.0)
        return light

    def _albedo(self, ends: Ends, pixel: float) -> Array:
        """Reflectance near 850 nm: paler and flatter than in colour; all skins are alike."""
        hits = ends.hits
        albedo = np.full(len(hits.mesh), 0.5)
        kind = self._caster.kind(hits.mesh)
        around, hand = self._caster.contents.surroundings, self._caster.contents.hand
        if around is not None:
            rows = np.flatnonzero(kind == SURROUNDINGS)
            length = ends.beams.travelled[rows] + hits.distance[rows]
            color = texture_color(around, hits.take(rows), length * pixel)
            albedo[rows] = 0.25 + 0.55 * np.clip(color @ _GREY, 0.0, 1.0)
        if hand is not None:
            rows = np.flatnonzero(kind == HAND)
            corners = hand.surface.faces[hits.face[rows]]
            albedo[rows] = 0.45 + 0.25 * hand.albedo[corners[:, 0]].mean(axis=1)
        return albedo
