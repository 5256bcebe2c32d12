"""One scene: a hold put into the world, a camera that sees it, and the surroundings.

World frame: metres, z up, the object near the origin. All surfaces of a scene are given in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import TRANSHAND_CAMERA, Array, Intrinsics, pixel_grid, transform_points
from hadr.hand import forward_kinematics, keypoints_from_skeleton
from hadr.handover.poses import camera_at
from hadr.synthesis.glass.objects import bodies, glass_object
from hadr.synthesis.hand.mesh import SKIN_TONES, HandMesh, hand_mesh
from hadr.synthesis.hand.signed_distance import FOREARM_LENGTH
from hadr.synthesis.holding.hold import Hold
from hadr.synthesis.rendering.raycast import GLASS, HAND, RayCaster, rays_through
from hadr.synthesis.scene.contents import Contents, Scene
from hadr.synthesis.scene.lights import make_lights
from hadr.synthesis.scene.surroundings import make_surroundings

#: How often each of the skin tones is drawn, light to dark.
SKIN_TONE_WEIGHTS = (0.30, 0.27, 0.17, 0.12, 0.08, 0.06)
#: Least and greatest distance of the camera from what is held, metres.
CLOSEST, FARTHEST = 0.29, 0.62
#: Least and greatest part of the glass that a view is to leave unhidden by the hand.
FREE = 0.45, 1.0
#: Least and greatest radius of the lens's opening, metres; it blurs what is far behind the hand.
APERTURE = 0.0015, 0.006


@dataclass(frozen=True)
class HoldScene(Scene):
    """A hold before a camera: everything that a frame is made from.

    Args:
        keypoints: The 21 keypoints, world frame, metres, shape (21, 3).
        world_from_object: Pose of the object, shape (4, 4).
        hold: The holding pose.
    """

    keypoints: Array
    world_from_object: Array
    hold: Hold


def _place_hold(hold: Hold, rng: np.random.Generator) -> tuple[Array, Array]:
    """World poses of object and wrist: mostly upright or tilted; the object's middle is at 0."""
    item = glass_object(hold.object_id)
    kind = rng.random()
    tilts = ((0.62, (0, 25)), (0.87, (25, 60)), (0.96, (60, 105)), (1.0, (140, 180)))
    degrees = next(bounds for below, bounds in tilts if kind < below)
    lean = Rotation.from_euler("x", np.deg2rad(rng.uniform(*degrees)))
    heading = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    spin = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    world_from_object = np.eye(4)
    world_from_object[:3, :3] = (heading * lean * spin).as_matrix()
    world_from_object[:3, 3] = world_from_object[:3, :3] @ np.array([0, 0, -item.height / 2])
    return world_from_object, world_from_object @ np.linalg.inv(hold.wrist_from_object)


@dataclass(frozen=True)
class _Held:
    """What the camera is to look at: hand, glass and where the forearm goes."""

    caster: RayCaster
    middle: Array
    wrist: Array
    elbow: Array


def _view_score(
    held: _Held, small: Intrinsics, pose: Array, full: Intrinsics, free: float
) -> float:
    """How well a view shows the glass in the hand, about a part ``free`` of it unhidden; best 1."""
    rays = rays_through(pixel_grid(small), small, pose)
    seen = held.caster.kind(held.caster.first(*rays).mesh)
    glass = held.caster.glass_alone(*rays)
    visible = (seen == GLASS).sum() / max(glass.sum(), 1)
    border = glass.reshape(small.shape)
    cut = border[0].any() or border[-1].any() or border[:, 0].any() or border[:, -1].any()
    hand = float((seen == HAND).mean())
    area = float((seen == GLASS).mean())
    score = 1 - abs(visible - free) - 0.4 * max(1 - area / 0.05, 0.0) - 0.8 * cut
    score -= 0.4 * (hand < 0.02) + 0.5 * (hand > 0.40) + 0.8 * (area == 0)
    # The elbow must lie outside of the picture, or behind the camera.
    elbow = (held.elbow - pose[:3, 3]) @ pose[:3, :3]
    if elbow[2] > 0.02:
        u = full.fx * elbow[0] / elbow[2] + full.cx
        v = full.fy * elbow[1] / elbow[2] + full.cy
        edge = 0.06 * full.fx / elbow[2]
        inside = (-edge < u < full.width + edge) and (-edge < v < full.height + edge)
        score -= 1.0 * inside
    return float(score)


def _choose_camera(held: _Held, camera: Intrinsics, rng: np.random.Generator) -> Array:
    """The first of some random views from which enough of the glass is seen, else the best."""
    small = camera.resized(48, 27)
    best, best_score = np.eye(4), -np.inf
    free = rng.uniform(*FREE)
    for _ in range(28):
        distance = CLOSEST + (FARTHEST - CLOSEST) * rng.random() ** 2.0
        azimuth = rng.uniform(0, 2 * np.pi)
        elevation = np.deg2rad(rng.uniform(-6, 40) if rng.random() < 0.75 else rng.uniform(40, 72))
        level = np.cos(elevation)
        offset = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
        eye = held.middle + distance * np.array(offset)
        target = held.middle + rng.normal(size=3) * 0.045 * distance
        roll = np.deg2rad(float(np.clip(rng.normal() * 19, -42, 42)))
        pose = camera_at(eye, target)
        pose[:3, :3] = pose[:3, :3].copy() @ Rotation.from_euler("z", roll).as_matrix()
        # No forearm that passes close by the camera.
        arm = held.elbow - held.wrist
        along = max(float((eye - held.wrist) @ arm), 0.0) / float(np.linalg.norm(arm)) ** 2
        nearest = held.wrist + arm * min(along, 1.0)
        if np.linalg.norm(eye - nearest) < 0.24:
            continue
        score = _view_score(held, small, pose, camera, free)
        if score > best_score:
            best, best_score = pose, score
        if score > 0.95:
            break
    if not np.isfinite(best_score):
        raise ValueError("no camera position keeps clear of the forearm")
    return best


def make_scene(
    hold: Hold,
    rng: np.random.Generator,
    width: int,
    height: int,
    *,
    hand_step: float = 0.0025,
    backgrounds: Sequence[Path] = (),
) -> HoldScene:
    """Build the scene of one frame, a picture of so many pixels.

    Everything that varies from frame to frame is drawn from ``rng``. The hand's surface has a grid
    of ``hand_step`` metres; backdrops, tables and floors show ``backgrounds``, photographs, or
    painted textures without them.
    """
    camera = TRANSHAND_CAMERA.resized(width, height)
    world_from_object, world_from_wrist = _place_hold(hold, rng)
    skeleton = forward_kinematics(hold.angles, hold.shape)
    tone = np.asarray(SKIN_TONES[int(rng.choice(6, p=SKIN_TONE_WEIGHTS))])
    tone = tone * (1 + 0.05 * rng.normal(size=3))
    skin = hand_mesh(skeleton, hold.shape, tone=tone, step=hand_step)
    hand = HandMesh(skin.surface.moved(world_from_wrist), skin.albedo, skin.gloss)
    item = glass_object(hold.object_id)
    glass = tuple(body.moved(world_from_object) for body in bodies(item))
    joints = transform_points(world_from_wrist, skeleton.joints)
    keypoints = keypoints_from_skeleton(joints)
    middle = transform_points(world_from_object, [0, 0, item.height / 2])
    middle = 0.62 * middle + 0.38 * keypoints[[5, 9, 13, 17]].mean(0)
    wrist = world_from_wrist[:3, 3]
    elbow = wrist - world_from_wrist[:3, 1] * FOREARM_LENGTH * hold.shape.scale
    contents = Contents(hand, glass, item.transmittance)
    held = _Held(RayCaster(contents), middle, wrist, elbow)
    pose = _choose_camera(held, camera, rng)
    eye = pose[:3, 3]
    lowest = min(float(hand.surface.vertices[:, 2].min()), float(glass[0].vertices[:, 2].min()))
    surroundings = make_surroundings(eye, middle, lowest, rng, backgrounds)
    environment, lamps = make_lights(eye, middle, rng)
    contents = replace(contents, surroundings=surroundings, lamps=lamps, environment=environment)
    lens = {"aperture": rng.uniform(*APERTURE), "focus": float((middle - eye) @ pose[:3, 2])}
    return HoldScene(contents, camera, pose, keypoints, world_from_object, hold, **lens)
