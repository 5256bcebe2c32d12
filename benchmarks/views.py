"""Measure what frames show of glass and hand, beside what the paper's tables and pictures tell.

    hadr generate --preset tiny --frames 240 --width 160 --height 90 --frames-per-hold 1 \\
        --normals none --out out/views
    python benchmarks/views.py out/views data_samples/frames --json results/generation/views.json

Masks and depth alone are measured, so frames without path-traced pictures do. The paper's depth of
the glass is its mean absolute error over its relative error, in the middle of its tables' rows; the
shares of the picture are those of the one frame whose masks it prints.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from hadr.data.transhand import SPLITS, TransHand
from hadr.records.provenance import provenance
from hadr.records.result_file import write_sealed
from hadr.synthesis.generation.statistics import frame_statistics

PAPER = Path(__file__).resolve().parents[1] / "results" / "paper_tables.json"
#: Edges of the histograms: metres, then parts of the picture and of the glass.
EDGES = {
    "glass_depth_m": np.linspace(0.15, 1.05, 37),
    "glass_share": np.linspace(0, 0.24, 37),
    "hand_share": np.linspace(0, 0.36, 37),
    "visible_share": np.linspace(0, 1, 41),
}


def published() -> dict[str, float]:
    """What the paper tells of its own frames."""
    tables = json.loads(PAPER.read_text(encoding="utf-8"))
    rows = [row for name in ("known", "unknown") for row in tables[name].values()]
    depth = np.median([mae / rel for _, rel, mae, *_ in rows])
    return {"glass_depth_m": float(depth), "glass_share": 0.062, "hand_share": 0.077}


def measured(folder: Path) -> dict[str, Any]:
    """Percentiles and histograms of a folder's frames; what lies beyond counts at the ends."""
    frames = TransHand(folder, SPLITS)
    found = frame_statistics(frames)
    made = json.loads((folder / "generation.json").read_text(encoding="utf-8"))
    columns = {}
    for name, edges in EDGES.items():
        values = getattr(found, name)
        values = values[np.isfinite(values)]
        points = np.percentile(values, (0, 10, 25, 50, 75, 90, 100))
        counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
        columns[name] = {"percentiles": points, "edges": edges, "frames": counts}
    return {"edition": made.get("edition", 1), "frames": len(frames), "columns": columns}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    paper, folders = published(), {folder.name: measured(folder) for folder in args.folders}
    print("least, 10, 25, 50, 75, 90 %, most; the paper's")
    for folder, what in folders.items():
        print(f"{folder}: {what['frames']} frames, edition {what['edition']}")
        for name, column in what["columns"].items():
            points = " ".join(f"{value:6.3f}" for value in column["percentiles"])
            print(f"  {name:14s} {points}   {paper.get(name, float('nan')):.3f}")
    if args.json:
        report = {"paper": paper, "folders": folders, "provenance": provenance()}
        write_sealed(args.json, report)


if __name__ == "__main__":
    main()
