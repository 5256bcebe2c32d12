"""A scene whose hand, object and arm move from frame to frame, drawn without new search trees.

Building a search tree over a hand or a glass takes longer than asking it. The trees of hand and
object are built once, each in its own frame; for a new frame the rays are moved into that frame.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hadr.camera import Array, Intrinsics, project, ray_directions
from hadr.simulation.camera.depth_sensor import Depth, Mask
from hadr.simulation.camera.room import Room, with_parts
from hadr.simulation.robot.arm_shape import Part
from hadr.simulation.world.scenes import HeldScene
from hadr.synthesis.glass.surfaces import merged
from hadr.synthesis.rendering.raycast import GLASS, HAND, SURROUNDINGS, Hits, search_tree
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.contents import Contents

_USED = ("tfar", "primID", "geomID", "u", "v")
"""What the ray caster reads of a tree's answer."""


class SeenLabels(NamedTuple):
    """Depth of the first surface and with the object taken away, masks; each of shape (H, W).

    The arm's mask is of what is seen with the object taken away.
    """

    depth: Depth
    background_depth: Depth
    hand_mask: Mask
    object_mask: Mask
    arm_mask: Mask


class _MovedTree:
    """A search tree that is asked in another frame than its own."""

    def __init__(self, tree: Any, base_from_own: Array) -> None:
        self._tree = tree
        own_from_base = np.linalg.inv(base_from_own)
        self._turn = np.ascontiguousarray(own_from_base[:3, :3].T, dtype=np.float32)
        self._shift = own_from_base[:3, 3].astype(np.float32)

    def run(self, origins: Any, directions: Any, **settings: Any) -> Any:
        start = origins @ self._turn + self._shift
        return self._tree.run(start, directions @ self._turn, **settings)


class _JoinedTree:
    """Two search trees as one; the faces of the second are counted after those of the first."""

    def __init__(self, first: Any, second: Any, first_faces: int) -> None:
        self._first, self._second, self._faces = first, second, first_faces

    def run(self, origins: Any, directions: Any, **settings: Any) -> Any:
        found = self._first.run(origins, directions, **settings)
        other = self._second.run(origins, directions, **settings)
        nearer = (other["primID"] >= 0) & (other["tfar"] < found["tfar"])
        other["primID"] = other["primID"] + self._faces
        other["geomID"][nearer] = 0
        return {name: np.where(nearer, other[name], found[name]) for name in _USED}


class MovingView(RayTracer):
    """A held object in a room, seen at any moment."""

    def __init__(self, scene: HeldScene, room: Room) -> None:
        self._own_hand, self._own_glass = scene.hand(0.004), scene.glass()  # metres of a step
        things = self._own_hand, self._own_glass, scene.item.transmittance
        super().__init__(Contents(*things, room.surroundings, room.lamps, room.environment))
        # the order in which RayCaster lists its trees: surroundings, hand, then glass
        self._room, (_, self._hand_tree) = room, self._solid[1]
        self._glass_tree = self._clear[0][1]

    def at(
        self, base_from_wrist: Array, base_from_object: Array, arm: Sequence[Part]
    ) -> MovingView:
        """Give the same scene at another moment: poses (4, 4) of hand and object, metres.

        The robot's surfaces are written in the base frame, with their linear RGB.
        """
        now = copy.copy(self)
        hand, around = self._own_hand, self._room.surroundings
        hand = replace(hand, surface=hand.surface.moved(base_from_wrist))
        glass = tuple(body.moved(base_from_object) for body in self._own_glass)
        number, room_tree = self._solid[0]
        if arm:
            tree = search_tree(merged([part for part, _ in arm]))
            room_tree = _JoinedTree(room_tree, tree, len(around.surface.faces))
            around = with_parts(around, arm)
        now.contents = replace(self.contents, hand=hand, glass=glass, surroundings=around)
        now._opaque = [(SURROUNDINGS, around.surface), (HAND, hand.surface)]
        now.meshes = [*now._opaque, *((GLASS, body) for body in glass)]
        now._solid = [(number, room_tree), (1, _MovedTree(self._hand_tree, base_from_wrist))]
        now._clear = [(2, _MovedTree(self._glass_tree, base_from_object))]
        now._all = [*now._solid, *now._clear]
        return now

    def first_at(
        self, base_from_wrist: Array, base_from_object: Array, origins: Array, directions: Array
    ) -> Hits:
        """What `first` gives `at` another moment without an arm, for a few rays (N, 3)."""
        hand = 1, _MovedTree(self._hand_tree, base_from_wrist)
        glass = 2, _MovedTree(self._glass_tree, base_from_object)
        return self._trace([self._solid[0], hand, glass], origins, directions)

    def seen(self, camera: Intrinsics, base_from_camera: Array) -> SeenLabels:
        """Cast one ray through every pixel's centre of a camera at a pose (4, 4), metres.

        In single precision, as Embree computes: exact to some micrometres, and several times as
        fast as `hadr.synthesis.rendering.raycast.RayCaster.labels`.
        """
        local = ray_directions(camera).reshape(-1, 3)
        directions = local @ base_from_camera[:3, :3].T
        origins = np.broadcast_to(base_from_camera[:3, 3], directions.shape)
        behind = self._trace(self._solid, origins, directions)
        near = np.full(len(local), np.inf)
        rows = self._rows_near_glass(camera, base_from_camera)
        near[rows] = self._trace(self._clear, origins[rows], directions[rows]).distance
        glass = near < behind.distance
        of_room = self._kinds[behind.mesh] == SURROUNDINGS
        shape = camera.shape

        def depth(distance: Array) -> Depth:
            z = np.where(np.isfinite(distance), distance * local[:, 2], 0.0)
            return z.astype(np.float32).reshape(shape)

        return SeenLabels(
            depth(np.minimum(near, behind.distance)),
            depth(behind.distance),
            ((self._kinds[behind.mesh] == HAND) & ~glass).reshape(shape),
            glass.reshape(shape),
            (of_room & (behind.face >= len(self._room.surroundings.surface.faces))).reshape(shape),
        )

    def _rows_near_glass(self, camera: Intrinsics, base_from_camera: Array) -> Any:
        """Numbers of the pixels within the box around the object's picture."""
        vertices = np.concatenate([body.vertices for body in self.contents.glass])
        own = (vertices - base_from_camera[:3, 3]) @ base_from_camera[:3, :3]
        numbers = np.arange(camera.height * camera.width).reshape(camera.shape)
        if (own[:, 2] < 0.05).any():
            return numbers.ravel()
        uv = project(own, camera)
        left, top = np.floor(uv.min(axis=0)).astype(int).clip(0)
        right, bottom = np.ceil(uv.max(axis=0)).astype(int).clip(-1) + 1
        return numbers[top:bottom, left:right].ravel()

    def light(
        self, camera: Intrinsics, base_from_camera: Array, rng: np.random.Generator | None
    ) -> Array:
        """Linear RGB that reaches every pixel, shape (H, W, 3); see `RayTracer.radiance`."""
        directions = ray_directions(camera).reshape(-1, 3) @ base_from_camera[:3, :3].T
        origins = np.broadcast_to(base_from_camera[:3, 3], directions.shape)
        return self.radiance(origins, directions, 1.0 / camera.fx, rng).reshape(*camera.shape, 3)
