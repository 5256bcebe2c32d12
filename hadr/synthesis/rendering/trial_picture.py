"""A small picture with all that ours are made of, to find out whether Mitsuba can draw here.

Run as a module, it tells by its output why LLVM can't; in an empty line, where it can.
"""

from __future__ import annotations

import os

import numpy as np

from hadr.camera import Intrinsics
from hadr.synthesis.glass.objects import bodies, glass_object
from hadr.synthesis.glass.surfaces import Surface, revolve
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.rendering.mitsuba_variant import LLVM, llvm_problem
from hadr.synthesis.rendering.photo import photograph
from hadr.synthesis.scene.contents import Contents, Scene, Surroundings
from hadr.synthesis.scene.lights import AreaLight, Environment


def trial_scene(lamps: int) -> Scene:
    """Skin, glass, a wall, lamps and a sky, seen through a lens; no hold was searched for it.

    Mitsuba's kernels for it are those for frames with so many lamps, but for the camera's numbers.
    """
    angle = np.linspace(-np.pi / 2, np.pi / 2, 17)
    ball = revolve(0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1), segments=24)
    place = np.eye(4)
    place[:3, 3] = 0.04, 0.0, 0.5
    skin = ball.moved(place)
    hand = HandMesh(skin, np.full((len(skin.vertices), 3), 0.4), np.full(len(skin.vertices), 0.3))
    place[:3, 3] = -0.03, 0.0, 0.5
    glass = tuple(body.moved(place) for body in bodies(glass_object("0000")))
    corners = np.array([[-2, -2, 1.5], [-2, 2, 1.5], [2, 2, 1.5], [2, -2, 1.5]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    flat = Surface(corners, faces, np.tile([0.0, 0.0, -1.0], (4, 1)))
    uv = np.array([[0, 0], [0, 4], [4, 4], [4, 0.0]])
    wall = Surroundings(flat, uv, np.zeros(2, dtype=np.int64), np.ones((2, 3)), np.ones(2))
    sides = np.array([0.2, 0, 0]), np.array([0, 0.2, 0])
    light = tuple(AreaLight(np.array([x, -0.8, 0]), *sides, np.full(3, 9.0)) for x in (-0.5, 0.5))
    sky = Environment(np.full((128, 256, 3), 0.5, dtype=np.float32))
    things = Contents(hand, glass, surroundings=wall, lamps=light[:lamps], environment=sky)
    camera = Intrinsics(40.0, 40.0, 23.5, 13.0, 48, 27)
    return Scene(things, camera, np.eye(4), aperture=0.003, focus=0.5)


def draw_trial() -> str:
    """Draw with LLVM, each scene twice: what is wrong with the pictures, else nothing.

    What a library spoils may show at its second use only; what is wrong with it ends the process.
    """
    for seed in (1, 2):
        for lamps in (1, 2):
            scene = trial_scene(lamps)
            spread = photograph(scene, seed=seed, samples=2, variant=LLVM).std()
            if spread < 1:
                return f"a small picture has one colour, its standard deviation is {spread}"
    return ""


if __name__ == "__main__":
    with os.fdopen(os.dup(1), "w") as answer:
        os.dup2(2, 1)  # what a library prints is no answer
        print(llvm_problem() or draw_trial(), file=answer)
