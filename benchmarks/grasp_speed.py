"""Time of sampling, choosing and tracking for the handover, one frame a call.

    python benchmarks/grasp_speed.py [--json results/speed/grasps.json] [--threads 2]

Points are those that a camera beside the robot would see of the first eight development holds
(numbers 920 and 921 of four objects) without any error of depth. Tracking has 3 mm of noise.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from measuring import arguments, interleaved, turning

from hadr.handover.grasping.candidates import sample_grasps
from hadr.handover.grasping.selection import GraspSelection
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.tracking import hand_motion
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import write_result_file
from hadr.simulation.trials import TRIAL_OBJECTS
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.synthesis.glass.surfaces import Surface

EYE = np.array([0.05, 0.62, 0.62])


def seen_points(scene: HeldScene, rng: np.random.Generator, most: int = 3000) -> np.ndarray:
    """Points of the outside of the object that face the camera, spread evenly, base frame."""
    surface: Surface = scene.glass()[0].moved(scene.base_from_object)
    corners = surface.vertices[surface.faces]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = ((EYE - corners.mean(axis=1)) * sides).sum(axis=1) > 0
    pose = scene.base_from_object
    from_axis = (corners.mean(axis=1) - pose[:3, 3]) @ pose[:3, :3]
    outside = (from_axis[:, :2] * (sides @ pose[:3, :3])[:, :2]).sum(axis=1) >= 0
    rows = np.flatnonzero(facing & outside)
    area = np.linalg.norm(sides[rows], axis=1)
    chosen = rng.choice(rows, most, p=area / area.sum())
    share = rng.dirichlet([1.0, 1.0, 1.0], most)
    points: np.ndarray = np.einsum("ni,nij->nj", share, corners[chosen])
    return points


def main() -> None:
    args = arguments(__doc__, turns=40, seconds=60.0).parse_args()
    torch.set_num_threads(args.threads)

    rng = np.random.default_rng(0)
    # a tumbler, a flute, a bottle and a mug: what fits between the fingers at most places
    scenes = [held_scene(TRIAL_OBJECTS[i], hold) for i in (0, 2, 3, 4) for hold in (920, 921)]
    points = [seen_points(scene, rng) for scene in scenes]
    robot, choose = SimulatedUR5(), GraspSelection(rng, EYE)
    moved = [scene.keypoints + rng.normal(0, 0.003, (21, 3)) for scene in scenes]
    found: list[int] = []

    def sample(i: int) -> None:
        found.append(len(sample_grasps(points[i], rng, viewpoint=EYE, frame="base")))

    works: dict[str, Callable[[int], Any]] = {
        "sample": sample,
        "choose": lambda i: choose(points[i], scenes[i].keypoints, robot),
        "track": lambda i: hand_motion(scenes[i].keypoints, moved[i]),
        "track, robust": lambda i: hand_motion(scenes[i].keypoints, moved[i], robust=True),
    }
    calls = {name: turning(work, len(scenes)) for name, work in works.items()}
    times = interleaved(calls, args.turns, args.seconds)
    rows = [{"step": name, **row} for name, row in times.items()]
    rows[0]["grasps_median"], rows[0]["grasps_min"] = int(np.median(found)), min(found)
    for row in rows:
        print(
            f"{row['step']:14s} wall {row['wall_median_ms']:7.2f} (least "
            f"{row['wall_min_ms']:6.2f}) cpu {row['cpu_median_ms']:7.2f} ms"
        )
    print(f"scored grasps of one call: {rows[0]['grasps_median']} (least {min(found)})")
    if args.json:
        write_result_file(
            args.json,
            "Handover, one frame a call: drawing and scoring grasps, choosing one (with collision "
            "and reach), the hand's motion; 3000 points of the seen side of eight held objects, "
            f"{args.threads} threads; {machine_text()}",
            rows,
            provenance(),
        )


if __name__ == "__main__":
    main()
