"""How long a data set took to make, read off the times at which its frames were finished.

    python benchmarks/speed/mini_run.py DIR --json results/generation/mini_run.json

A frame's log is written last, so its time is when the frame was finished. The rate over each
tenth of the frames shows whether the machine had other work.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from hadr.records.provenance import provenance
from hadr.records.result_file import write_sealed


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--note", default="", help="what else the machine did")
    args = parser.parse_args()
    logs = args.folder.glob("*/*/depth/log_json/*.json")
    times = np.sort([path.stat().st_mtime for path in logs])
    edges = np.linspace(0, len(times) - 1, 11).astype(int)
    tenths = np.diff(times[edges]) / np.diff(edges)
    settings = json.loads((args.folder / "generation.json").read_text(encoding="utf-8"))
    files = [path for path in args.folder.rglob("*") if path.is_file()]
    found = {
        "what": "Time to generate a data set, from the times at which its frames were finished",
        "folder_settings": settings,
        "frames": len(times),
        "workers": args.workers,
        "seconds": times[-1] - times[0],
        "seconds_a_frame_by_tenth": [round(float(value), 3) for value in tenths],
        "minutes_at_the_pace_of_the_quickest_tenth": float(tenths.min()) * len(times) / 60,
        "megabytes": sum(path.stat().st_size for path in files) / 1e6,
        "note": args.note,
        "provenance": provenance(),
    }
    print(json.dumps({k: v for k, v in found.items() if k != "provenance"}, indent=1))
    if args.json:
        write_sealed(args.json, found)


if __name__ == "__main__":
    main()
