"""How far the glass is from where each kind of depth says, in front of the handover's camera.

    python benchmarks/handover/handover_depth.py --json results/mini/handover_depth.json

Eight objects, holds 920 to 925, on which the handover's settings were found; the arm at home. The
error of a scene is that of its object points' median depth along the camera's axis.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.stats import spearmanr

from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file
from hadr.simulation.camera.robot_camera import RobotCamera
from hadr.simulation.camera.sight import SOURCES, Sight
from hadr.simulation.trials import TRIAL_OBJECTS
from hadr.simulation.world.hand_motions import motion_for
from hadr.simulation.world.physics import World
from hadr.simulation.world.scenes import held_scene

HOLDS = range(920, 926)


def measure() -> list[dict[str, Any]]:
    """One row a source."""
    errors: dict[str, list[float]] = {source: [] for source in SOURCES}
    confidences: dict[str, list[float]] = {source: [] for source in SOURCES}
    for object_id in TRIAL_OBJECTS:
        for hold in HOLDS:
            scene, camera = held_scene(object_id, hold), RobotCamera()
            state = World(scene, motion_for(scene, hold).moved).state()
            found = {a: Sight(scene, camera, a).look(state, with_points=True) for a in SOURCES}
            truth = found["perfect"].object_points
            for source, seen in found.items():
                both = seen.object_points is not None and truth is not None
                middle = np.median(seen.object_points[:, 2]) if both else np.nan
                errors[source].append(float(middle - np.median(truth[:, 2])) if both else np.nan)
                confidences[source].append(np.nan if seen.confidence is None else seen.confidence)
    rows = []
    for source in SOURCES:
        error = np.array(errors[source])
        seen = np.isfinite(error)
        row: dict[str, Any] = {
            "condition": source,
            "scenes": len(error),
            "scenes_with_points": int(seen.sum()),
            "median_error_m": float(np.median(np.abs(error[seen]))),
            "bias_m": float(error[seen].mean()),
            "within_2_cm": float((np.abs(error[seen]) < 0.02).sum() / len(error)),
        }
        sure = np.array(confidences[source])
        if np.isfinite(sure).all():
            rank = spearmanr(sure, np.abs(error), nan_policy="omit").statistic
            row["confidence_rank_correlation"] = float(rank)
        rows.append(row)
    return rows


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, required=True, help="file of the results")
    args = parser.parse_args()
    torch.set_num_threads(1)
    what = (
        "error of the median depth of the object's points along the camera's axis, eight objects, "
        "holds 920 to 925, masks and keypoints from the simulator with noise"
    )
    write_result_file(args.json, what, measure(), provenance())


if __name__ == "__main__":
    main()
