"""What the arm looks like: the UR5's housings and tubes, and the gripper on its flange.

Each link is built once in its own DH frame; a pose only moves it. The parts are for pictures and
for the camera's depth: rounded solids of about the real sizes, a centimetre off in places. Metres.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from hadr.camera import Array
from hadr.handover import ur5
from hadr.handover.grasping.gripper import (
    FINGER_HEIGHT,
    FINGER_LENGTH,
    FINGER_WIDTH,
    FLANGE_FROM_TOOL,
    LARGEST_OPENING,
    PAD_THICKNESS,
)
from hadr.records.caches import kept
from hadr.synthesis.glass.surfaces import Surface, merged, revolve

Color = tuple[float, float, float]
Part = tuple[Surface, Color]

SHELL: Color = (0.50, 0.52, 0.54)
"""Light grey of the housings, linear RGB reflectance."""
TUBE: Color = (0.40, 0.415, 0.43)
"""The two long tubes."""
LID: Color = (0.16, 0.33, 0.50)
"""Grey-blue of the joints' lids."""
SEAM: Color = (0.05, 0.055, 0.06)
"""Dark rings between the links, and the gripper's pads."""
METAL: Color = (0.34, 0.35, 0.36)
"""Aluminium of flange and fingers."""
BODY: Color = (0.09, 0.095, 0.105)
"""The gripper's dark housing."""


def round_bar(sections: tuple[tuple[float, float], ...], fillet: float, sides: int = 40) -> Surface:
    """A solid of revolution about z from its corners (r, z), rounded; metres."""
    corners = np.array([(0.0, sections[0][1]), *sections, (0.0, sections[-1][1])])
    curve = [corners[:1]]
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        back, on = before - corner, after - corner
        room = float(min(np.linalg.norm(back), np.linalg.norm(on))) / 2
        cut = min(fillet, 0.98 * room)
        start, end = (corner + cut * leg / np.linalg.norm(leg) for leg in (back, on))
        t = np.linspace(0.0, 1.0, 4)[:, None]
        arc = (1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end
        # one point close to each end keeps the straight sides' normals straight
        curve += [start + 0.02 * cut * back / np.linalg.norm(back) + np.zeros((1, 2)), arc]
        curve += [end + 0.02 * cut * on / np.linalg.norm(on) + np.zeros((1, 2))]
    return revolve(np.concatenate([*curve, corners[-1:]]), segments=sides)


def _along(axis: str, at: tuple[float, float, float]) -> Array:
    """The pose that turns z into one of the axes x, y, z and then shifts; shape (4, 4)."""
    columns = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}[axis]
    pose = np.eye(4)
    pose[:3, :3] = np.eye(3)[:, list(columns)]
    pose[:3, 3] = at
    return pose


def bar(
    axis: str,
    radius: float,
    low: float,
    high: float,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    fillet: float = 0.006,
) -> Surface:
    """A round bar along an axis through a point, from low to high along it; metres."""
    return round_bar(((radius, low), (radius, high)), fillet).moved(_along(axis, at))


def rounded_block(half_x: float, half_y: float, low: float, high: float) -> Surface:
    """A block along z whose section is a superellipse, with rounded ends; metres."""
    solid = round_bar(((1.0, low), (1.0, high)), 0.008, 64)
    x, y = solid.vertices[:, 0], solid.vertices[:, 1]
    radius = np.hypot(x, y)
    angle = np.arctan2(y, x)
    stretch = (np.abs(np.cos(angle)) ** 5 + np.abs(np.sin(angle)) ** 5) ** (-1 / 5)
    vertices = solid.vertices.copy()
    vertices[:, 0] = half_x * radius * stretch * np.cos(angle)
    vertices[:, 1] = half_y * radius * stretch * np.sin(angle)
    mesh = trimesh.Trimesh(vertices, solid.faces, process=False)
    return Surface(vertices, solid.faces, np.array(mesh.vertex_normals))


def colored(*parts: tuple[Color, list[Surface]]) -> tuple[Part, ...]:
    """Parts, each of several surfaces of one colour."""
    return tuple((merged(tuple(surfaces)), color) for color, surfaces in parts)


def box(low: npt.ArrayLike, high: npt.ArrayLike) -> Surface:
    """A box between two corners (3,) in metres, with flat sides."""
    solid = trimesh.creation.box(bounds=np.array([low, high], dtype=np.float64))
    vertices = np.array(solid.triangles).reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return Surface(vertices, faces, np.repeat(np.array(solid.face_normals), 3, axis=0))


TABLE_NEAR, TABLE_FAR, FLOOR = -0.40, 0.42, -0.75
"""Edges of the robot's table along x, whose top lies at z = 0, and the floor's height, metres."""
_S = ur5.SHOULDER_OFFSET
_E = _S + ur5.ELBOW_OFFSET
_ELBOW, _WRIST = -ur5.DH_A[1], -ur5.DH_A[2]
_TO_WRIST = _E - ur5.DH_D[3]
_BARS: tuple[tuple[int, Color, str, float, float, float, float, float, float], ...] = (
    (0, SEAM, "z", 0.0575, 0.03, 0.042, 0, 0, 0.006),
    (1, SHELL, "y", 0.060, 0.042 - ur5.DH_D[0], 0.062, 0, 0, 0.026),
    (1, SHELL, "z", 0.060, -0.050, _S - 0.066, 0, 0, 0.006),
    (1, LID, "z", 0.056, -0.064, -0.045, 0, 0, 0.008),
    (1, SEAM, "z", 0.0565, _S - 0.07, _S - 0.058, 0, 0, 0.006),
    (2, SHELL, "z", 0.060, _S - 0.062, _S + 0.054, _ELBOW, 0, 0.012),
    (2, SHELL, "z", 0.057, _S - 0.058, _S + 0.050, 0, 0, 0.012),
    (2, SHELL, "x", 0.055, 0.045, 0.095, 0, _S, 0.005),
    (2, SHELL, "x", 0.057, _ELBOW - 0.1, _ELBOW - 0.045, 0, _S, 0.005),
    (2, LID, "z", 0.056, _S + 0.05, _S + 0.068, _ELBOW, 0, 0.008),
    (2, LID, "z", 0.053, _S + 0.046, _S + 0.063, 0, 0, 0.008),
    (2, TUBE, "x", 0.052, 0.0, _ELBOW, 0, _S, 0.006),
    (2, SEAM, "z", 0.052, _S - 0.064, _S - 0.05, 0, 0, 0.006),
    (3, SHELL, "z", 0.053, _E - 0.046, _S - 0.062, _WRIST, 0, 0.012),
    (3, SHELL, "z", 0.040, _E - 0.038, _E + 0.046, 0, 0, 0.010),
    (3, SHELL, "x", 0.043, 0.03, 0.07, 0, _E, 0.004),
    (3, SHELL, "x", 0.048, _WRIST - 0.09, _WRIST - 0.04, 0, _E, 0.005),
    (3, LID, "z", 0.050, _E - 0.058, _E - 0.04, _WRIST, 0, 0.008),
    (3, LID, "z", 0.037, _E - 0.05, _E - 0.034, 0, 0, 0.007),
    (3, TUBE, "x", 0.0415, 0.0, _WRIST, 0, _E, 0.006),
    (3, SEAM, "z", 0.036, _E + 0.04, _E + 0.05, 0, 0, 0.006),
    (4, SHELL, "y", 0.038, _TO_WRIST + 0.049, 0.040, 0, 0, 0.012),
    (4, SHELL, "z", 0.038, -0.040, 0.046, 0, 0, 0.006),
    (4, LID, "z", 0.036, -0.051, -0.036, 0, 0, 0.007),
    (4, SEAM, "z", 0.0345, 0.04, 0.05, 0, 0, 0.006),
    (5, SHELL, "y", 0.038, -0.040, ur5.DH_D[4] - 0.049, 0, 0, 0.012),
    (5, SHELL, "z", 0.038, -0.040, 0.032, 0, 0, 0.006),
    (5, LID, "z", 0.036, -0.051, -0.036, 0, 0, 0.007),
    (5, SEAM, "z", 0.0345, 0.028, 0.037, 0, 0, 0.006),
    (6, SHELL, "z", 0.0375, 0.035 - ur5.DH_D[5], -0.010, 0, 0, 0.005),
    (6, METAL, "z", 0.0315, -0.02, 0.0, 0, 0, 0.002),
)
"""Round bars of link 0 (base) to link 6 (flange), each in its own DH frame: link, colour, axis,
radius, from and to along the axis, the axis's x and z, and the edges' fillet; metres."""


@kept(1)
def _links() -> tuple[tuple[Part, ...], ...]:
    """The parts of each link, one surface a colour."""
    foot = round_bar(((0.075, 0.0), (0.075, 0.014), (0.064, 0.024), (0.061, 0.036)), 0.004)
    looks: list[dict[Color, list[Surface]]] = [{SHELL: [foot]}, *({} for _ in range(6))]
    for link, color, axis, radius, low, high, x, z, fillet in _BARS:
        solid = bar(axis, radius, low, high, (x, 0, z), fillet)
        looks[link].setdefault(color, []).append(solid)
    return tuple(colored(*look.items()) for look in looks)


_GIVE = 0.002
_BODY_TOP, _BODY_END = -0.145, -0.082


@kept(1)
def _housing() -> tuple[Part, ...]:
    """The fixed parts in the tool frame."""
    reach = LARGEST_OPENING / 2 + FINGER_WIDTH + 0.004
    rail = box((-reach, -0.009, _BODY_END - 0.012), (reach, 0.009, _BODY_END + 0.008))
    return colored(
        (
            BODY,
            [
                rounded_block(0.042, 0.034, _BODY_TOP, _BODY_END - 0.004),
                rounded_block(0.057, 0.020, _BODY_END - 0.018, _BODY_END),
            ],
        ),
        (METAL, [bar("z", 0.0335, -FLANGE_FROM_TOOL[2, 3], _BODY_TOP + 0.006, fillet=0.003), rail]),
        (LID, [bar("z", 0.0352, _BODY_TOP - 0.006, _BODY_TOP - 0.002, fillet=0.001)]),
    )


@kept(1)
def _finger() -> tuple[Part, ...]:
    """The finger on the side of +x in the tool frame, its pad's face in the plane x = 0."""
    y, tip = FINGER_HEIGHT / 2, FINGER_LENGTH
    return colored(
        (
            METAL,
            [
                box((PAD_THICKNESS, -y, -tip), (FINGER_WIDTH, y, 0.0)),
                box((0.0, -0.009, 0.001 - tip), (PAD_THICKNESS + 0.001, 0.009, -0.042)),
                box((-0.002, -0.013, -tip - 0.014), (FINGER_WIDTH + 0.003, 0.013, -tip)),
            ],
        ),
        (SEAM, [box((0.0, -y, -0.042), (PAD_THICKNESS, y, 0.0))]),
    )


def gripper_surfaces(tool: Array, width: float) -> list[Part]:
    """The gripper's look at a tool pose (4, 4), open by a width, metres.

    ValueError for a width beyond 0 to 85 mm by more than 2 mm: soft pads give way by so much.
    """
    if not -_GIVE <= width <= LARGEST_OPENING + _GIVE:
        raise ValueError(f"gripper_width must lie between 0 and {LARGEST_OPENING} m, got {width}")
    parts = [(surface.moved(tool), color) for surface, color in _housing()]
    for turn in (np.diag([1.0, 1.0, 1.0, 1.0]), np.diag([-1.0, -1.0, 1.0, 1.0])):
        turn[0, 3] = turn[0, 0] * max(0.0, width) / 2
        parts += [(surface.moved(tool @ turn), color) for surface, color in _finger()]
    return parts


def arm_surfaces(joints: Array, gripper_width: float) -> list[Part]:
    """The arm at joint angles (6,) in radians, with its gripper open by a width in metres.

    Gives closed surfaces in the base frame (metres) with their linear RGB reflectance.
    """
    frames = ur5.BASE_LINK_FROM_DH_BASE @ ur5.joint_frames(joints)
    parts = [
        (surface.moved(frame), color)
        for frame, link in zip(frames, _links(), strict=True)
        for surface, color in link
    ]
    return parts + gripper_surfaces(frames[6] @ FLANGE_FROM_TOOL, gripper_width)
