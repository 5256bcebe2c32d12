"""What is left for rescoring to choose from, and whether it then chooses otherwise.

    python benchmarks/handover/rescored_grasps.py --json results/mini/handover_grasps.json

Eight objects, holds 920 to 925, on which the handover's settings were found; the hand at its start,
the arm at home. Of the candidates of one round (fingers that reach far over the glass): how many
keep off the hand, off everything else, and are within reach; and which one is chosen from exactly
these candidates, by rescoring and by their own score.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hadr.camera import Array, transform_points
from hadr.handover.grasping.candidates import NoCandidateError
from hadr.handover.grasping.grasps import Grasps
from hadr.handover.grasping.selection import (
    CLEARANCES,
    HALF_TURN,
    GraspSelection,
    _alike,
    _Surroundings,
)
from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file
from hadr.simulation.camera.robot_camera import RobotCamera
from hadr.simulation.camera.sight import DepthSource, Sight
from hadr.simulation.trials import TRIAL_OBJECTS
from hadr.simulation.trials.trial import ATTEMPT_ARM, ATTEMPT_CONFIG, ATTEMPT_MOTION
from hadr.simulation.world.hand_motions import motion_for
from hadr.simulation.world.physics import World
from hadr.simulation.world.scenes import held_scene

HOLDS = range(920, 926)
DEPTHS: tuple[DepthSource, ...] = ("hadr", "hadr-plus", "perfect")


class Counted(GraspSelection):
    """A selection that keeps how many candidates each filter of its first round left."""

    counts: tuple[int, ...] = ()

    def _best(self, grasps: Grasps, around: _Surroundings, aside: Array) -> Any:
        if not self.counts:
            off_hand = grasps.select(around.room(grasps) >= min(CLEARANCES))
            free = off_hand.select(around.free(off_hand))
            reached = [bool(around.turned(pose, np.zeros((1, 3)))) for pose in free.poses]
            self.counts = (len(grasps), len(off_hand), len(free), sum(reached))
        return super()._best(grasps, around, aside)


def scene_row(object_id: str, hold: int, source: DepthSource) -> dict[str, Any]:
    """What is left in one scene, and what is chosen from it either way."""
    scene, camera = held_scene(object_id, hold), RobotCamera()
    world = World(scene, motion_for(scene, hold).moved, ATTEMPT_ARM, ATTEMPT_MOTION)
    seen = Sight(scene, camera, source).look(world.state(), with_points=True)
    row: dict[str, Any] = {"condition": source, "scene": f"{object_id}-{hold}"}
    if seen.object_points is None or seen.keypoints is None or seen.scene_points is None:
        return {**row, "left": None}
    points, hand, rest = (
        transform_points(camera.calibration, cloud)
        for cloud in (seen.object_points, seen.keypoints, seen.scene_points)
    )
    eye = camera.calibration[:3, 3]
    try:
        grasps = GraspSelection(np.random.default_rng(hold), eye).candidates(points)
    except NoCandidateError:
        return {**row, "left": None}
    chosen: list[Array | None] = []
    for rescoring in (True, False):
        choose = Counted(np.random.default_rng(hold), eye, rescoring, lambda _: grasps)
        found = choose(points, hand, world.robot, rest, ATTEMPT_CONFIG.way)
        chosen.append(None if found is None else found.pose)
        counted = choose.counts
    row["left"] = dict(zip(("all", "off the hand", "free", "within reach"), counted, strict=True))
    if chosen[0] is None or chosen[1] is None:
        return row
    apart = np.linalg.norm(chosen[0][:3, 3] - chosen[1][:3, 3])
    alike = any(_alike(chosen[0], other) for other in (chosen[1], chosen[1] @ HALF_TURN))
    return {**row, "chosen_apart_m": float(apart), "chosen_alike": bool(alike)}


def rows() -> Iterator[dict[str, Any]]:
    """One row a scene and kind of depth."""
    for source in DEPTHS:
        for object_id in TRIAL_OBJECTS:
            for hold in HOLDS:
                row = scene_row(object_id, hold, source)
                print(row, flush=True)
                yield row


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, required=True, help="file of the results")
    args = parser.parse_args()
    torch.set_num_threads(1)
    what = (
        "candidates for grasps that each filter leaves in one round, and the grasps that rescoring "
        "and own scores choose from them; eight objects, holds 920 to 925"
    )
    write_result_file(args.json, what, list(rows()), provenance())


if __name__ == "__main__":
    main()
