"""Hands on glass, and clouds, that a reader turns in the browser without kernel and network.

The page draws with plain WebGL: no library, no other host.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import manifold3d
import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_rgb
from scipy.spatial import cKDTree

from hadr.camera import Array
from hadr.figures.panels import FINGER_COLORS
from hadr.figures.solids.scrubber import Page, filled_page
from hadr.hand import SKELETON_NAMES, SKELETON_PARENTS, HandShape, Skeleton, forward_kinematics
from hadr.records.caches import kept
from hadr.synthesis.glass.objects import bodies, glass_object
from hadr.synthesis.glass.shape import GlassObject
from hadr.synthesis.glass.surfaces import Surface, merged
from hadr.synthesis.hand.mesh import SKIN_TONES, hand_mesh
from hadr.synthesis.hand.template import MIDDLE_STEP
from hadr.synthesis.holding.hold import Hold

#: Longest forearm that is shown, metres behind the wrist; it fades out over the last third.
FOREARM_SHOWN = 0.13
_MOST_VERTICES = 65535
# z up, from OpenCV's camera frame.
_UP_FROM_CAMERA = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
_NOTHING = Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros((0, 3)))
# object_from_wrist of a hand without an object: z along the fingers, y into the back of the hand.
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class HandOnGlass:
    """One hold as the turntable shows it, in the object's frame, metres: z is the glass's axis.

    The reader chooses by the name; the note stands below the picture. Both surfaces are closed; the
    hand has a colour per vertex, sRGB, (V, 3) uint8, and 22 joints, (22, 3). The viewer stands
    first at an azimuth about z from x and raised by an elevation, degrees. The hand's opacity at p
    is n . p + d, kept within 0 and 1, with (n, d) the fade.
    """

    name: str
    note: str
    glass: Surface
    hand: Surface
    hand_colors: npt.NDArray[np.uint8]
    joints: Array
    azimuth_deg: float
    elevation_deg: float = 14.0
    fade: Array | tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)

    @property
    def sphere(self) -> tuple[Array, float]:
        """Middle and radius around glass and joints, metres; the forearm may reach out of it."""
        points = np.concatenate([self.glass.vertices, self.joints])
        center: Array = (points.min(axis=0) + points.max(axis=0)) / 2
        return center, float(np.linalg.norm(points - center, axis=1).max())


@dataclass(frozen=True)
class Cloud:
    """Points, (N, 3), at least one, as the turntable shows them, in the camera's frame, metres.

    The reader chooses by the name; the note stands below the picture. Colours are sRGB, uint8. The
    view turns around the center and shows what lies within the radius; neighbours are `spacing`
    apart.
    """

    name: str
    note: str
    points: npt.NDArray[np.floating]
    colors: npt.NDArray[np.uint8]
    center: npt.NDArray[np.floating]
    radius: float
    spacing: float


def simplified(surface: Surface, tolerance: float) -> Surface:
    """A closed surface of fewer triangles, each vertex moved at most by a tolerance in metres."""
    if tolerance == 0 or (solid := solid_of(surface)).is_empty():
        return surface
    return _surface(solid.simplify(tolerance), surface)


def solid_of(surface: Surface) -> Any:
    """A surface as manifold3d's body; an empty one where it isn't closed."""
    vertices, faces = np.array(surface.vertices, float), np.array(surface.faces, np.uint64)
    return manifold3d.Manifold(manifold3d.Mesh64(vertices, faces))


def _surface(solid: Any, like: Surface) -> Surface:
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties, dtype=float)[:, :3]
    faces = np.array(mesh.tri_verts, dtype=np.int64)
    _, nearest = cKDTree(like.vertices).query(vertices)
    return Surface(vertices, faces, like.normals[nearest])


def _without_elbow(surface: Surface, length: float, *, closed: bool) -> Surface:
    """Cut the forearm ``length`` metres behind the wrist (wrist frame, along -y)."""
    solid = solid_of(surface) if closed else None
    if solid is not None and not solid.is_empty():
        return _surface(solid.trim_by_plane((0.0, 1.0, 0.0), -length), surface)
    kept = (surface.vertices[surface.faces][:, :, 1] > -length).all(axis=1)
    used, faces = np.unique(surface.faces[kept], return_inverse=True)
    return Surface(surface.vertices[used], faces.reshape(-1, 3), surface.normals[used])


def bare_hand(skeleton: Skeleton, shape: HandShape) -> HandOnGlass:
    """A hand without a glass, fingers up: z is the wrist's y, the viewer sees the palm."""
    hand, colors = _hand_shown(skeleton, shape, 0.0003)
    note = f"{shape.side} hand"
    joints = skeleton.joints @ _UPRIGHT[:3, :3].T
    fade = _fade(shape, np.linalg.inv(_UPRIGHT))
    shown = hand.moved(_UPRIGHT)
    return HandOnGlass(note, note, _NOTHING, shown, colors, joints, -90.0, 0.0, fade)


def _fade(shape: HandShape, wrist_from_object: npt.NDArray[Any]) -> Array:
    """The forearm fades out over its last third; the plane is given in the object's frame."""
    slope = 1.0 / (0.35 * FOREARM_SHOWN * shape.scale)
    return np.asarray(slope * wrist_from_object[1] + [0.0, 0.0, 0.0, 1.0 / 0.35])


def bare_glass(item: GlassObject) -> HandOnGlass:
    """A glass that nobody holds, standing on the origin; its joints lie on its foot."""
    colors = np.zeros((0, 3), dtype=np.uint8)
    joints = np.zeros((len(SKELETON_NAMES), 3))
    glass = merged(bodies(item))
    return HandOnGlass(item.name, item.object_id, glass, _NOTHING, colors, joints, -75.0, 12.0)


def _hand_shown(
    skeleton: Skeleton, shape: HandShape, tolerance: float, step: float = MIDDLE_STEP
) -> tuple[Surface, npt.NDArray[np.uint8]]:
    """The hand without its elbow in the wrist frame, and sRGB per vertex."""
    full = hand_mesh(skeleton, shape, tone=SKIN_TONES[1], step=step)
    length = FOREARM_SHOWN * shape.scale
    cut = _without_elbow(full.surface, length, closed=tolerance > 0)
    hand = simplified(cut, tolerance)
    _, nearest = cKDTree(full.surface.vertices).query(hand.vertices)
    linear = np.clip(full.albedo[nearest], 0.0, 1.0)
    bent = 1.055 * linear ** (1 / 2.4) - 0.055
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, bent)
    return hand, np.round(255 * srgb).astype(np.uint8)


@kept(32)
def _simple_glass(object_id: str, tolerance: float) -> Surface:
    return simplified(merged(bodies(glass_object(object_id))), tolerance)


def held_glass(hold: Hold, *, tolerance: float = 0.0003, step: float = MIDDLE_STEP) -> HandOnGlass:
    """Build what the turntable shows of a hold, in the object's frame.

    Args:
        hold: The pose.
        tolerance: How far triangles may stray from the exact surfaces, metres; 0 keeps all of
            the hand's and leaves the forearm's end open, which is quicker and larger.
        step: Coarsest distance of the hand's vertices, metres; larger is quicker.
    """
    item = glass_object(hold.object_id)
    skeleton = forward_kinematics(hold.angles, hold.shape)
    hand, colors = _hand_shown(skeleton, hold.shape, tolerance, step)
    object_from_wrist = np.asarray(np.linalg.inv(hold.wrist_from_object), dtype=np.float64)
    thumb_side = object_from_wrist[:3, 0] * (1.0 if hold.shape.side == "right" else -1.0)
    palm_side = object_from_wrist[:3, 2]
    looked_from = thumb_side + 0.35 * palm_side
    if hold.kind == "handle":  # from the thumb's side the mug hides its handle
        looked_from = palm_side + 0.2 * thumb_side
    touching = ", ".join(part for part in hold.gaps if part in hold.touching)
    return HandOnGlass(
        f"{item.name}: {hold.kind}",
        f"{hold.shape.side} hand, on the glass: {touching}",
        _simple_glass(hold.object_id, tolerance / 3 or 0.0002),
        hand.moved(object_from_wrist),
        colors,
        skeleton.joints @ object_from_wrist[:3, :3].T + object_from_wrist[:3, 3],
        float(np.rad2deg(np.arctan2(looked_from[1], looked_from[0]))),
        fade=_fade(hold.shape, hold.wrist_from_object),
    )


def turntable(scenes: Sequence[HandOnGlass | Cloud], title: str = "Hands on glass") -> Page:
    """Make the page that turns holds or clouds; the reader chooses among them by their names."""
    names: dict[str, str] = {}  # of arrays
    inks = [to_rgb(FINGER_COLORS.get(name.split("_")[0], "#404040")) for name in SKELETON_NAMES]
    data = {
        "scenes": [
            _cloud(scene, names) if isinstance(scene, Cloud) else _hold(scene, names)
            for scene in scenes
        ],
        "arrays": {name: text for text, name in names.items()},
        "parents": SKELETON_PARENTS,
        "jointNames": [name.replace("_", " ") for name in SKELETON_NAMES],
        "jointColors": np.rint(255 * np.array(inks)).astype(int).tolist(),
    }
    return filled_page("turntable.html", title, data, "height:480px")


def _hold(scene: HandOnGlass, names: dict[str, str]) -> dict[str, Any]:
    return {
        "name": scene.name,
        "note": scene.note,
        "yaw": float(np.deg2rad(scene.azimuth_deg)),
        "pitch": float(np.deg2rad(scene.elevation_deg)),
        "center": np.round(scene.sphere[0], 5).tolist(),
        "radius": round(scene.sphere[1], 5),
        "hand": _mesh(scene.hand, names, scene.hand_colors),
        "glass": _mesh(scene.glass, names),
        "joints": np.round(scene.joints, 5).tolist(),
        "fade": np.round(scene.fade, 5).tolist(),
    }


def _cloud(scene: Cloud, names: dict[str, str]) -> dict[str, Any]:
    """A cloud, z up, first seen from the camera."""
    told = _positions(scene.points @ _UP_FROM_CAMERA.T, names)
    return {
        "name": scene.name,
        "note": scene.note,
        "yaw": -np.pi / 2,
        "pitch": 0.0,
        "center": np.round(_UP_FROM_CAMERA @ scene.center, 5).tolist(),
        "radius": round(scene.radius, 5),
        "spacing": round(scene.spacing, 6),
        "points": told | {"colors": _kept(scene.colors, names)},
    }


def _mesh(
    surface: Surface, names: dict[str, str], colors: npt.NDArray[np.uint8] | None = None
) -> dict[str, Any]:
    """Positions in 16 bits, normals and colours in 8; equal arrays get one of the names."""
    if len(surface.vertices) > _MOST_VERTICES:
        raise ValueError(
            f"a surface of {len(surface.vertices)} vertices is too fine for a page: at most "
            f"{_MOST_VERTICES}; simplify it"
        )
    told = _positions(surface.vertices, names) | {
        "normals": _kept(np.round(127 * surface.normals).astype("i1"), names),
        "faces": _kept(surface.faces.astype("<u2"), names),
    }
    return told if colors is None else told | {"colors": _kept(colors, names)}


def _positions(points: npt.NDArray[Any], names: dict[str, str]) -> dict[str, Any]:
    low = points.min(axis=0)
    step = float(np.ptp(points, axis=0).max()) / _MOST_VERTICES or 1.0
    stored = _kept(np.round((points - low) / step).astype("<u2"), names)
    return {"low": low.tolist(), "step": step, "positions": stored}


def _kept(values: npt.NDArray[Any], names: dict[str, str]) -> str:
    text = base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
    return names.setdefault(text, f"a{len(names)}")
