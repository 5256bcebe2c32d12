"""Draw the frames on which the networks of the handover's camera are trained.

    python benchmarks/handover/handover_frames.py --out DIR --train 2400 --val 240 --jobs 2

Writes TransHand's layout, which `hadr train --data DIR` reads. Frames that are there are kept.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from tqdm import tqdm

from hadr.data.frame import frame_log_path, write_frame
from hadr.simulation.camera.training_frames import FRAME_OBJECTS, camera_frame


def draw(out: Path, seed: int, which: tuple[str, int]) -> bool:
    """Draw one frame, unless it is there; say whether it shows the object."""
    split, number = which
    object_id = FRAME_OBJECTS[number % len(FRAME_OBJECTS)]
    if frame_log_path(out, split, object_id, f"{number:06d}").exists():
        return True
    frame = camera_frame(split, number, seed)
    if not frame.object_mask.any():
        return False
    write_frame(out, frame, depth_format="png", normals="none")
    return True


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder in TransHand's layout")
    parser.add_argument("--train", type=int, default=2400, help="frames for training")
    parser.add_argument("--val", type=int, default=240, help="frames for validation")
    parser.add_argument("--test", type=int, default=120, help="frames to score with")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    sizes = {"val": args.val, "test": args.test, "train": args.train}
    wanted = [(split, number) for split, size in sizes.items() for number in range(size)]
    with ProcessPoolExecutor(args.jobs) as pool:
        found = pool.map(partial(draw, args.out, args.seed), wanted, chunksize=32)
        missing = sum(not there for there in tqdm(found, total=len(wanted), unit="frame"))
    print(f"{len(wanted) - missing} frames in {args.out}, {missing} without the object left out")


if __name__ == "__main__":
    main()
