"""The speed tables say what the measurement says."""

import pytest

from hadr.figures.tables.speed import (
    memory_table,
    pairing_table,
    parts_table,
    perception_table,
    restoration_table,
)


def times(wall: float, cpu: float) -> dict[str, float]:
    return {"wall_median_ms": wall, "cpu_median_ms": cpu}


def cells(table: str, row: int) -> list[str]:
    return [cell.strip() for cell in table.splitlines()[row].strip("|").split("|")]


def test_restoration_tables() -> None:
    measured = {
        "times": {
            "Swin-T": times(80, 140),
            "mini, all rays": times(40, 52.4),
            "paper, all rays": times(120, 182),
            "mini, half the rays": times(30, 35),
        },
        "against_swin": {
            "cpu_median_ms": {
                "Swin-T": 1.0,
                "mini, all rays": 0.374,
                "paper, all rays": 1.3,
                "mini, half the rays": 0.25,
            }
        },
        "accuracy": {"change_percent": {"all rays": 0.0, "half the rays": -0.94}},
        "parts_cpu_ms": {"mini": {"backbone": 23.04, "all": 52}, "paper": {"backbone": 143.3}},
        "memory": {"Swin-T": {"weight_bytes": 1.1e8, "tensor_bytes": 2.04e7, "rss_bytes": 2e8}},
    }
    table = restoration_table(measured)
    assert cells(table, 2) == ["Swin-T", "80", "140", "1.00", "–"]
    assert cells(table, 3) == ["mini, all rays", "40", "52", "0.37", "+0.0 %"]
    assert cells(table, 4) == ["paper, all rays", "120", "182", "1.30", "–"]
    assert cells(table, 5)[-1] == "-0.9 %"
    assert cells(parts_table(measured), 0) == ["part, ms of processor time", "mini", "paper"]
    assert cells(parts_table(measured), 2) == ["backbone", "23.0", "143.3"]
    assert cells(parts_table(measured), 3) == ["all", "52.0", "–"]
    assert cells(memory_table(measured), 2) == ["Swin-T", "110", "20", "200"]


def test_perception_table() -> None:
    parts = {"mask": 10.4, "keypoints": 6, "restoration": 40, "all": 56}
    measured = {
        "times": {f"as it is, {part}": times(value, 0) for part, value in parts.items()},
        "frames_per_second": {"as it is": {"wall_median": 17.86}},
    }
    assert cells(perception_table(measured), 2) == ["as it is", "10", "6", "40", "56", "17.9"]


@pytest.mark.parametrize("series", ["by_rays", "by_batch"])
def test_pairing_table(series: str) -> None:
    walk = {"cpu_median_ms": 1.504, "tensor_bytes": 2_000_000}
    dense = {"cpu_median_ms": 30.0, "tensor_bytes": 5.55e7}
    case = {"frames": 1, "rays": 2000, "voxels": 40, "walk": walk, "dense": dense}
    large = {"frames": 32, "rays": 64000, "voxels": 1280, "walk": walk}
    table = pairing_table({series: [case, large]}, series)
    assert cells(table, 2) == ["1", "2,000", "40", "1.50", "2.0", "30.00", "55.5"]
    assert cells(table, 3) == ["32", "64,000", "1,280", "1.50", "2.0", "–", "–"]
