"""What the arm looks like: the UR5's housings and tubes, the flange, a gripper of two fingers.

Each link is built once in its own DH frame; a pose only moves it. The parts are for pictures and
for the camera's depth: rounded solids of about the real sizes, a centimetre off in places.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from hadr.handover import ur5
from hadr.handover.dimensions import (
    FINGER_HEIGHT,
    FINGER_LENGTH,
    FINGER_WIDTH,
    FLANGE_TO_TOOL,
    LARGEST_OPENING,
    PAD_THICKNESS,
)
from hadr.records.caches import kept
from hadr.simulation.film.world_parts import box
from hadr.synthesis.glass.surfaces import Surface, merged, revolve

Array = npt.NDArray[np.float64]
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

_GIVE = 0.002
_BODY_TOP, _BODY_END = -0.145, -0.082


def _round_bar(
    sections: tuple[tuple[float, float], ...], fillet: float, sides: int = 40
) -> Surface:
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


def _bar(
    axis: str,
    radius: float,
    low: float,
    high: float,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    fillet: float = 0.006,
) -> Surface:
    """A round bar along an axis through a point, from low to high along it; metres."""
    return _round_bar(((radius, low), (radius, high)), fillet).moved(_along(axis, at))


def _rounded_block(half_x: float, half_y: float, low: float, high: float) -> Surface:
    """A block along z whose section is a superellipse, with rounded ends; metres."""
    solid = _round_bar(((1.0, low), (1.0, high)), 0.008, 64)
    x, y = solid.vertices[:, 0], solid.vertices[:, 1]
    radius = np.hypot(x, y)
    angle = np.arctan2(y, x)
    stretch = (np.abs(np.cos(angle)) ** 5 + np.abs(np.sin(angle)) ** 5) ** (-1 / 5)
    vertices = solid.vertices.copy()
    vertices[:, 0] = half_x * radius * stretch * np.cos(angle)
    vertices[:, 1] = half_y * radius * stretch * np.sin(angle)
    mesh = trimesh.Trimesh(vertices, solid.faces, process=False)
    return Surface(vertices, solid.faces, np.array(mesh.vertex_normals))


def _colored(*parts: tuple[Color, list[Surface]]) -> tuple[Part, ...]:
    return tuple((merged(tuple(surfaces)), color) for color, surfaces in parts)


@kept(1)
def _links() -> tuple[tuple[Part, ...], ...]:
    """The parts of link 0 (base) to link 6 (flange), each in its own DH frame."""
    s = ur5.SHOULDER_OFFSET
    e = s + ur5.ELBOW_OFFSET
    elbow, wrist = -ur5.DH_A[1], -ur5.DH_A[2]
    to_wrist = -(ur5.DH_D[3] - e)
    base = _round_bar(((0.075, 0.0), (0.075, 0.014), (0.064, 0.024), (0.061, 0.036)), 0.004)
    return (
        _colored((SHELL, [base]), (SEAM, [_bar("z", 0.0575, 0.03, 0.042)])),
        _colored(
            (
                SHELL,
                [
                    _bar("y", 0.060, 0.042 - ur5.DH_D[0], 0.062, fillet=0.026),
                    _bar("z", 0.060, -0.050, s - 0.066),
                ],
            ),
            (LID, [_bar("z", 0.056, -0.064, -0.045, fillet=0.008)]),
            (SEAM, [_bar("z", 0.0565, s - 0.07, s - 0.058)]),
        ),
        _colored(
            (
                SHELL,
                [
                    _bar("z", 0.060, s - 0.062, s + 0.054, (elbow, 0, 0), fillet=0.012),
                    _bar("z", 0.057, s - 0.058, s + 0.050, fillet=0.012),
                    _bar("x", 0.055, 0.045, 0.095, (0, 0, s), fillet=0.005),
                    _bar("x", 0.057, elbow - 0.1, elbow - 0.045, (0, 0, s), fillet=0.005),
                ],
            ),
            (
                LID,
                [
                    _bar("z", 0.056, s + 0.05, s + 0.068, (elbow, 0, 0), 0.008),
                    _bar("z", 0.053, s + 0.046, s + 0.063, fillet=0.008),
                ],
            ),
            (TUBE, [_bar("x", 0.052, 0.0, elbow, (0, 0, s))]),
            (SEAM, [_bar("z", 0.052, s - 0.064, s - 0.05)]),
        ),
        _colored(
            (
                SHELL,
                [
                    _bar("z", 0.053, e - 0.046, s - 0.062, (wrist, 0, 0), 0.012),
                    _bar("z", 0.040, e - 0.038, e + 0.046, fillet=0.010),
                    _bar("x", 0.043, 0.03, 0.07, (0, 0, e), 0.004),
                    _bar("x", 0.048, wrist - 0.09, wrist - 0.04, (0, 0, e), 0.005),
                ],
            ),
            (
                LID,
                [
                    _bar("z", 0.050, e - 0.058, e - 0.04, (wrist, 0, 0), 0.008),
                    _bar("z", 0.037, e - 0.05, e - 0.034, fillet=0.007),
                ],
            ),
            (TUBE, [_bar("x", 0.0415, 0.0, wrist, (0, 0, e))]),
            (SEAM, [_bar("z", 0.036, e + 0.04, e + 0.05)]),
        ),
        _colored(
            (
                SHELL,
                [
                    _bar("y", 0.038, to_wrist + 0.049, 0.040, fillet=0.012),
                    _bar("z", 0.038, -0.040, 0.046),
                ],
            ),
            (LID, [_bar("z", 0.036, -0.051, -0.036, fillet=0.007)]),
            (SEAM, [_bar("z", 0.0345, 0.04, 0.05)]),
        ),
        _colored(
            (
                SHELL,
                [
                    _bar("y", 0.038, -0.040, ur5.DH_D[4] - 0.049, fillet=0.012),
                    _bar("z", 0.038, -0.040, 0.032),
                ],
            ),
            (LID, [_bar("z", 0.036, -0.051, -0.036, fillet=0.007)]),
            (SEAM, [_bar("z", 0.0345, 0.028, 0.037)]),
        ),
        _colored(
            (SHELL, [_bar("z", 0.0375, 0.035 - ur5.DH_D[5], -0.010, fillet=0.005)]),
            (METAL, [_bar("z", 0.0315, -0.02, 0.0, fillet=0.002)]),
        ),
    )


@kept(4)
def _gripper(adapter: float) -> tuple[Part, ...]:
    """The gripper's fixed parts in the tool frame; the adapter's length in metres."""
    reach = LARGEST_OPENING / 2 + FINGER_WIDTH + 0.004
    top = _BODY_TOP - adapter
    rail = box((-reach, -0.009, _BODY_END - 0.012), (reach, 0.009, _BODY_END + 0.008))
    return _colored(
        (
            BODY,
            [
                _rounded_block(0.042, 0.034, _BODY_TOP, _BODY_END - 0.004),
                _rounded_block(0.057, 0.020, _BODY_END - 0.018, _BODY_END),
            ],
        ),
        (METAL, [_bar("z", 0.0335, top, _BODY_TOP + 0.006, fillet=0.003), rail]),
        (LID, [_bar("z", 0.0352, _BODY_TOP - 0.006, _BODY_TOP - 0.002, fillet=0.001)]),
    )


@kept(1)
def _finger() -> tuple[Part, ...]:
    """The finger on the side of +x in the tool frame, its pad's face in the plane x = 0."""
    y, tip = FINGER_HEIGHT / 2, FINGER_LENGTH
    return _colored(
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


def arm_surfaces(
    joints: Array, gripper_width: float, flange_from_tool: Array | None = None
) -> list[Part]:
    """The arm and its gripper at one pose.

    Args:
        joints: Joint angles in radians, shape (6,).
        gripper_width: Distance between the pads, metres; 2 mm beyond its limits pass, since soft
            pads give way in a simulation.
        flange_from_tool: Where the point between the fingertips stands in the flange's frame,
            shape (4, 4); 16 cm along z where left out.

    Returns:
        Closed surfaces in the base frame (metres) with their linear RGB reflectance.

    Raises:
        ValueError: The joints or the pose are no such thing, or the width is not from 0 to 85 mm.
    """
    if not -_GIVE <= gripper_width <= LARGEST_OPENING + _GIVE:
        raise ValueError(
            f"gripper_width must lie between 0 and {LARGEST_OPENING} m, got {gripper_width}"
        )
    gripper_width = max(0.0, gripper_width)
    if flange_from_tool is None:
        flange_from_tool = np.eye(4)
        flange_from_tool[2, 3] = FLANGE_TO_TOOL
    tool_in_flange = ur5.check_pose(flange_from_tool, "flange_from_tool")
    frames = ur5.BASE_LINK_FROM_DH_BASE @ ur5.joint_frames(joints)
    tool = frames[6] @ tool_in_flange
    parts = [
        (surface.moved(frame), color)
        for frame, link in zip(frames, _links(), strict=True)
        for surface, color in link
    ]
    adapter = max(0.002, float(tool_in_flange[2, 3]) + _BODY_TOP)
    parts += [(surface.moved(tool), color) for surface, color in _gripper(round(adapter, 4))]
    for turn in (np.diag([1.0, 1.0, 1.0, 1.0]), np.diag([-1.0, -1.0, 1.0, 1.0])):
        turn[0, 3] = turn[0, 0] * gripper_width / 2
        parts += [(surface.moved(tool @ turn), color) for surface, color in _finger()]
    return parts
