"""The measured speed and memory as Markdown tables, from the JSON that the benchmarks wrote.

Sources: `benchmarks/restoration.py`, `benchmarks/perception.py`, `benchmarks/pairing.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

FORMULATIONS = {"walk": "walk through the grid", "dense": "every ray with every voxel"}


def restoration_table(measured: Mapping[str, Any]) -> str:
    """Set the times of restoring one frame, each beside a plain Swin-T's and what it costs.

    Args:
        measured: Content of `results/speed/restoration.json`.

    Returns:
        Markdown, one row a form of the network; the change of the error was measured with preset
        mini and stands in its rows alone.
    """
    change = measured["accuracy"]["change_percent"]
    rows = []
    for title, times in measured["times"].items():
        preset, _, form = title.partition(", ")
        cost = f"{change[form]:+.1f} %" if preset == "mini" and form in change else "–"
        ratio = measured["against_swin"]["cpu_median_ms"][title]
        rows.append(
            (
                title,
                f"{times['wall_median_ms']:.0f}",
                f"{times['cpu_median_ms']:.0f}",
                f"{ratio:.2f}",
                cost,
            )
        )
    head = ("network", "time, ms", "processor time, ms", "processor time / Swin-T's", "RMSE")
    return _markdown(head, rows)


def parts_table(measured: Mapping[str, Any]) -> str:
    """Set the processor time of each part of the network, one column a preset.

    Args:
        measured: Content of `results/speed/restoration.json`.
    """
    parts = measured["parts_cpu_ms"]
    names = dict.fromkeys(name for preset in parts.values() for name in preset)
    rows = [
        (name, *(f"{p[name]:.1f}" if name in p else "–" for p in parts.values())) for name in names
    ]
    return _markdown(("part, ms of processor time", *parts), rows)


def memory_table(measured: Mapping[str, Any]) -> str:
    """Set the memory of restoring one frame.

    Args:
        measured: Content of `results/speed/restoration.json`.
    """
    keys = ("weight_bytes", "tensor_bytes", "rss_bytes")
    rows = [
        (title, *(f"{needed[key] / 1e6:.0f}" for key in keys))
        for title, needed in measured["memory"].items()
    ]
    return _markdown(
        ("network", "weights, MB", "tensors at most, MB", "process grows by, MB"), rows
    )


def perception_table(measured: Mapping[str, Any]) -> str:
    """Set the times of the whole perception, by part, and its frames a second.

    Args:
        measured: Content of `results/speed/perception.json`.
    """
    rows = []
    for form, rate in measured["frames_per_second"].items():
        parts = [
            f"{measured['times'][f'{form}, {part}']['wall_median_ms']:.0f}"
            for part in ("mask", "keypoints", "restoration", "all")
        ]
        rows.append((form, *parts, f"{rate['wall_median']:.1f}"))
    head = (
        "networks",
        "mask, ms",
        "keypoints, ms",
        "restoration, ms",
        "all, ms",
        "frames a second",
    )
    return _markdown(head, rows)


def pairing_table(measured: Mapping[str, Any], series: str = "by_rays") -> str:
    """Set the times and memory of pairing in two formulations.

    Args:
        measured: Content of `results/speed/pairing.json`.
        series: "by_rays", "by_batch" or "by_cells".
    """
    rows = []
    for case in measured[series]:
        cells = [f"{case['frames']}", f"{case['rays']:,}", f"{case['voxels']:,}"]
        for name in FORMULATIONS:
            one = case.get(name)
            cells += (
                ["–", "–"]
                if one is None
                else [f"{one['cpu_median_ms']:.2f}", f"{one['tensor_bytes'] / 1e6:.1f}"]
            )
        rows.append(tuple(cells))
    head = ["frames", "rays", "voxels"]
    for title in FORMULATIONS.values():
        head += [f"{title}, ms", "MB"]
    return _markdown(head, rows)


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
