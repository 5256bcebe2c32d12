"""Keep the frames that chapter 1 sets side by side: real, and of the simulated depth camera.

Real: two D435 frames of ClearGrasp, from the sample data of its public repository (Apache-2.0).
Every pixel that is kept is one of the original's; the depth is rounded to 0.5 mm. The table behind
the glass, which the analytic model needs, is a plane that is fitted to what stands around.
Simulated: two of the tables of `depth_camera.py`.

    python benchmarks/cameras/sensor_pictures.py [--real DIR] [--seed 1435] [--out results/sensor]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
from depth_camera import REAL, read_real, table_scene

from hadr.camera import Intrinsics, back_project, ray_directions
from hadr.camera_file import load_intrinsics
from hadr.figures.depth.corruption_examples import CorruptionExample, write_examples
from hadr.records.provenance import provenance
from hadr.synthesis.depth_sensor.depth_camera import StereoCamera, capture_depth
from hadr.synthesis.rendering.shading import RayTracer

SIZE = (448, 252)
WHAT = {"000000080": "bottles on a table", "000000130": "cups on a table"}


def fitted_plane(
    points: npt.NDArray[np.float64], seed: int = 0, *, within_m: float = 0.004
) -> tuple[npt.NDArray[np.float64], float, float]:
    """Find the plane n . p = d of most points (N, 3), and the share of them within the tolerance.

    By random triples and least squares; n is a unit normal (3,), d in metres.
    """
    rng, best = np.random.default_rng(seed), np.zeros(len(points), bool)
    for _ in range(300):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        near = np.abs((points - a) @ normal) < within_m
        best = near if near.sum() > best.sum() else best
    for _ in range(3):
        middle = points[best].mean(axis=0)
        normal = np.linalg.svd(points[best] - middle, full_matrices=False)[2][2]
        best = np.abs((points - middle) @ normal) < within_m
    return normal, float(normal @ middle), float(best.mean())


def real_example(folder: Path, scene: str) -> tuple[CorruptionExample, dict[str, float]]:
    """A real frame at the small size, and what is known of its table."""
    whole = load_intrinsics(folder / "camera_intrinsics.yaml")
    columns, rows = (
        ((np.arange(small) + 0.5) * large / small).astype(int)
        for small, large in zip(SIZE, (whole.width, whole.height), strict=True)
    )
    pick = np.ix_(rows, columns)
    raw, truth, mask = (image[pick] for image in read_real(folder, scene))
    camera = whole.resized(*SIZE)
    around = (truth > 0.3) & (truth < 1.0) & ~mask
    points = back_project(truth, camera)[around].astype(np.float64)
    normal, distance, share = fitted_plane(points)
    table = distance / (ray_directions(camera) @ normal) * ray_directions(camera)[..., 2]
    table = np.where((table > 0) & (table < 3), table, 0.0)
    seen = mask & (truth > 0) & (raw > 0)
    known = {
        "plane_share": share,
        "measured_minus_plane_median_m": float(np.median((raw - table)[seen])),
        "measured_within_1cm_of_plane": float((np.abs(raw - table)[seen] < 0.01).mean()),
    }
    depths = [np.asarray(depth, dtype=np.float32) for depth in (raw, truth, table)]
    example = CorruptionExample(WHAT[scene], camera, depths[0], depths[1], depths[2], mask)
    return example, known


def simulated_example(seed: int, camera: Intrinsics) -> CorruptionExample:
    """A table of the simulation, measured by the simulated camera."""
    scene = table_scene(seed, camera)
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    raw = np.nan_to_num(capture_depth(scene, seed, StereoCamera())).astype(np.float32)
    return CorruptionExample(
        "glasses on a simulated table",
        camera,
        raw,
        labels.depth,
        labels.background_depth,
        labels.object_mask,
    )


def main() -> None:
    """Make the examples and write them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--real", type=Path, default=REAL)
    parser.add_argument("--seed", type=int, default=1435)
    parser.add_argument("--out", type=Path, default=Path("results/sensor"))
    args = parser.parse_args()
    real = {scene: real_example(args.real, scene) for scene in WHAT}
    camera = next(iter(real.values()))[0].camera
    examples = {f"real-{scene[-3:]}": example for scene, (example, _) in real.items()}
    for number in range(2):
        examples[f"simulated-{number}"] = simulated_example(args.seed + number, camera)
    content = {
        "what": "Depth measured by a real and by the simulated camera beside the true one, for "
        "chapter 1. Real: two D435 frames of ClearGrasp (Sajjan et al. 2020), from the sample "
        "data of its public repository, Apache-2.0; every third pixel or so, rounded to 0.5 mm; "
        "their truth is the same camera's depth of spray-painted twins, their background a plane "
        "fitted to the table",
        "tables": {scene[-3:]: known for scene, (_, known) in real.items()},
        "seed": args.seed,
        "provenance": provenance(),
    }
    write_examples(args.out / "pictures.npz", examples, content)


if __name__ == "__main__":
    main()
