"""One scene: a hold put into the world, a camera that sees it, and the surroundings.

World frame: metres, z up, the object near the origin. All surfaces of a scene are given in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from hadr.camera import TRANSHAND_CAMERA, Intrinsics, ray_directions, transform_points
from hadr.hand import forward_kinematics, keypoints_from_skeleton
from hadr.synthesis.hand_mesh import SKIN_TONES, HandMesh, hand_mesh
from hadr.synthesis.holding import Hold
from hadr.synthesis.lights import AreaLight, Environment
from hadr.synthesis.objects import bodies, glass_object
from hadr.synthesis.raycast import Surroundings
from hadr.synthesis.shading import RayScene
from hadr.synthesis.surfaces import Surface
from hadr.synthesis.textures import COUNT

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """Everything that a frame is drawn from.

    Args:
        rays: The surfaces, lights and materials, world frame.
        camera: Intrinsics.
        world_from_camera: Pose of the OpenCV camera, shape (4, 4).
        keypoints: The 21 keypoints, world frame, metres, shape (21, 3).
        skeleton: The 22 joints, world frame, metres, shape (22, 3).
        world_from_object: Pose of the object, shape (4, 4).
        hold: The holding pose.
    """

    rays: RayScene
    camera: Intrinsics
    world_from_camera: Array
    keypoints: Array
    skeleton: Array
    world_from_object: Array
    hold: Hold


def look_at(eye: Array, target: Array, roll: float) -> Array:
    """Pose ``world_from_camera`` of an OpenCV camera that looks at a point, shape (4, 4).

    Args:
        eye: Camera centre, world, metres.
        target: The point in the image's middle, world, metres.
        roll: Turn about the optical axis, radians; 0 keeps the world's z up in the image.
    """
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose = np.eye(4)
    pose[:3, :3] = turn @ Rotation.from_euler("z", roll).as_matrix()
    pose[:3, 3] = eye
    return pose


def _place_hold(hold: Hold, rng: np.random.Generator) -> tuple[Array, Array]:
    """World poses of object and wrist: the object roughly upright, its middle at the origin."""
    item = glass_object(hold.object_id)
    lean = Rotation.from_euler("x", np.deg2rad(rng.uniform(0, 28)))
    turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    spin = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    world_from_object = np.eye(4)
    world_from_object[:3, :3] = (turn * lean * spin).as_matrix()
    world_from_object[:3, 3] = world_from_object[:3, :3] @ np.array([0, 0, -item.height / 2])
    return world_from_object, world_from_object @ np.linalg.inv(hold.wrist_from_object)


def _choose_camera(
    rays: RayScene, camera: Intrinsics, middle: Array, arm: Array, rng: np.random.Generator
) -> Array:
    """The first of some random views from which enough of the glass is seen, else the best."""
    small = camera.resized(48, 27)
    best, best_score = np.eye(4), -1.0
    for _ in range(18):
        distance = 0.42 + 0.5 * rng.random() ** 1.8
        azimuth, elevation = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(-8, 62))
        offset = np.array(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
            ]
        )
        target = middle + rng.normal(size=3) * 0.022 * distance / 0.6
        roll = np.deg2rad(float(np.clip(rng.normal() * 18, -40, 40)))
        pose = look_at(target + offset * distance, target, roll)
        # No view along the forearm, which would hide everything behind the elbow.
        if float(arm @ offset) > 0.80:
            continue
        directions = ray_directions(small).reshape(-1, 3) @ pose[:3, :3].T
        origins = np.broadcast_to(pose[:3, 3], directions.shape)
        seen = rays.first_kind(origins, directions)
        glass = rays.glass_alone(origins, directions)
        share = (seen == 2).sum() / max(glass.sum(), 1)
        border = glass.reshape(27, 48)
        cut = border[0].any() or border[-1].any() or border[:, 0].any() or border[:, -1].any()
        hand = (seen == 1).mean()
        area = float((seen == 2).mean())
        score = min(share, 0.62) + 0.4 * min(area / 0.022, 1.0) - 0.5 * cut - 0.3 * (hand < 0.02)
        if score > best_score:
            best, best_score = pose, score
        if score > 0.97:
            break
    return best


def _box_quads(low: Array, high: Array, inward: bool) -> list[Array]:
    """Corner rings (4, 3) of the six sides of a box."""
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (low, high):
            ring = np.empty((4, 3))
            ring[:, axis] = end[axis]
            ring[:, u] = [low[u], high[u], high[u], low[u]]
            ring[:, v] = [low[v], low[v], high[v], high[v]]
            flip = (end is high) == inward
            quads.append(ring[::-1] if flip else ring)
    return quads


def _surroundings(
    eye: Array, middle: Array, lowest: float, rng: np.random.Generator
) -> Surroundings:
    """A room with a table, pictures and boxes; all of it behind what is held."""
    quads: list[Array] = []
    scales: list[float] = []
    numbers: list[int] = []
    tints: list[Array] = []

    def add(quad: Array, scale: float, number: int, tint: Array) -> None:
        quads.append(quad)
        scales.append(scale)
        numbers.append(number)
        tints.append(tint)

    def tint() -> Array:
        return np.asarray(rng.uniform(0.75, 1.15) * (1 + 0.06 * rng.normal(size=3))).clip(0.4, 1.4)

    forward = (middle - eye) / np.linalg.norm(middle - eye)
    flat = np.array([forward[0], forward[1], 0.0]) / max(np.hypot(*forward[:2]), 1e-6)
    side = np.array([-flat[1], flat[0], 0.0])
    turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix()
    half = rng.uniform(1.15, 2.1, 3)
    half[2] = rng.uniform(1.1, 1.5)
    center = flat * rng.uniform(0.0, 0.25)
    for quad in _box_quads(-half, half, inward=True):
        wall = quad @ turn.T + center
        behind = float((wall.mean(0) - middle) @ flat)
        if wall[:, 2].min() > 0.5 or (np.ptp(wall[:, 2]) > 0.1 and behind < 0):
            continue
        add(wall, rng.uniform(0.55, 1.5), int(rng.integers(COUNT)), tint())
    if rng.random() < 0.75:
        top = lowest - rng.uniform(0.04, 0.30)
        if top > -half[2] + 0.15:
            size = np.array([rng.uniform(0.4, 0.9), rng.uniform(0.4, 0.9), 0.03])
            away = flat * rng.uniform(0.1, 0.55) + side * rng.normal() * 0.2
            spin = Rotation.from_euler("z", rng.uniform(0, np.pi)).as_matrix()
            place = np.array([away[0], away[1], top - 0.03])
            number, shade = int(rng.integers(COUNT)), tint()
            for quad in _box_quads(-size, size, inward=False):
                add(quad @ spin.T + place, rng.uniform(0.3, 0.7), number, shade)
    for _ in range(int(rng.integers(3, 9))):
        away = rng.uniform(0.45, 1.3)
        place = middle + forward * away + side * rng.normal() * 0.45 * (0.5 + away)
        place = place + np.array([0, 0, rng.normal() * 0.3])
        size = rng.uniform(0.04, 0.20, 3)
        reach = float(np.linalg.norm(size)) + 0.06
        if (
            np.linalg.norm(place - middle) < 0.28 + reach
            or np.linalg.norm(place - eye) < 0.3 + reach
        ):
            continue
        spin = Rotation.from_rotvec(rng.normal(size=3) * np.array([0.2, 0.2, 1.5])).as_matrix()
        number, shade = int(rng.integers(COUNT)), tint()
        for quad in _box_quads(-size, size, inward=False):
            add(quad @ spin.T + place, rng.uniform(0.2, 0.5), number, shade)
    corners = np.asarray(quads)
    along = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    across = np.linalg.norm(corners[:, 3] - corners[:, 0], axis=1)
    repeat = np.stack([along, across], axis=1) / np.asarray(scales)[:, None]
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    uv = square[None] * repeat[:, None] + rng.random((len(quads), 1, 2))
    # Pictures stand upright: the second coordinate runs down the wall.
    first = 4 * np.arange(len(quads))[:, None]
    faces = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    surface = Surface(corners.reshape(-1, 3), faces, np.repeat(normals, 4, axis=0))
    return Surroundings(
        surface,
        uv.reshape(-1, 2),
        np.repeat(np.asarray(numbers), 2),
        np.repeat(np.asarray(tints), 2, axis=0),
        np.repeat(np.asarray(scales), 2),
    )


def _lamps(
    eye: Array, middle: Array, rng: np.random.Generator
) -> tuple[Environment, tuple[AreaLight, ...]]:
    """The light from far away, and panels above and behind the camera."""
    back = (eye - middle) / np.linalg.norm(eye - middle)
    lamps = []
    for number in range(2):
        toward = back + np.array([0, 0, 0.8]) + 0.6 * rng.normal(size=3)
        toward /= np.linalg.norm(toward)
        center = middle + toward * rng.uniform(1.4, 2.0)
        side = np.cross([0, 0, 1.0], -toward)
        side /= np.linalg.norm(side)
        up = np.cross(-toward, side)
        wide, tall = rng.uniform(0.2, 0.5, 2)
        color = np.ones(3) * (9.0 if number == 0 else 4.0)
        lamps.append(AreaLight(center, side * wide, up * tall, color))
    image = np.ones((64, 128, 3), dtype=np.float32)
    image *= np.linspace(1.2, 0.5, 64, dtype=np.float32)[:, None, None]
    return Environment(image), tuple(lamps)


def make_scene(
    hold: Hold, rng: np.random.Generator, width: int, height: int, *, hand_step: float = 0.0025
) -> Scene:
    """Build the scene of one frame.

    Args:
        hold: The holding pose.
        rng: Everything that varies from frame to frame is drawn from it.
        width: Image width, pixels.
        height: Image height, pixels.
        hand_step: Grid of the hand's surface, metres.

    Returns:
        The scene; the same for the same hold and generator state.
    """
    camera = TRANSHAND_CAMERA.resized(width, height)
    world_from_object, world_from_wrist = _place_hold(hold, rng)
    skeleton = forward_kinematics(hold.angles, hold.shape)
    tone = np.asarray(SKIN_TONES[int(rng.choice(6, p=(0.27, 0.25, 0.18, 0.13, 0.1, 0.07)))])
    skin = hand_mesh(
        skeleton, hold.shape, tone=tone * (1 + 0.05 * rng.normal(size=3)), step=hand_step
    )
    hand = HandMesh(skin.surface.moved(world_from_wrist), skin.albedo, skin.gloss)
    item = glass_object(hold.object_id)
    glass = tuple(body.moved(world_from_object) for body in bodies(item))
    joints = transform_points(world_from_wrist, skeleton.joints)
    keypoints = keypoints_from_skeleton(joints)
    probe = RayScene(hand, glass, item.tint)
    middle = 0.62 * transform_points(world_from_object, [0, 0, item.height / 2]) + 0.38 * (
        keypoints[[5, 9, 13, 17]].mean(0)
    )
    arm = -world_from_wrist[:3, 1]
    pose = _choose_camera(probe, camera, middle, arm, rng)
    eye = pose[:3, 3]
    lowest = min(float(hand.surface.vertices[:, 2].min()), float(glass[0].vertices[:, 2].min()))
    surroundings = _surroundings(eye, middle, max(lowest, -0.45), rng)
    environment, lamps = _lamps(eye, middle, rng)
    rays = RayScene(hand, glass, item.tint, surroundings, lamps=lamps, environment=environment)
    return Scene(rays, camera, pose, keypoints, joints, world_from_object, hold)
