"""The report's smaller tables, from result files made by hand."""

from pathlib import Path
from typing import Any

from hadr.press.report import real_table, switches_table
from hadr.records.result_file import write_result_file


def cells(table: str) -> list[list[str]]:
    return [[c.strip() for c in line.strip("|").split("|")] for line in table.splitlines()]


def run(turned: str, row: int, rmse: list[float]) -> dict[str, Any]:
    frames = {"rmse_m": rmse, "shape_m": [0.01] * len(rmse)}
    given = {key: {"per_frame": frames} for key in ("true keypoints", "predicted keypoints")}
    return {"turned": turned, "row": row, "given": given}


def test_a_switch_has_the_doubt_of_frames_and_of_seeds(tmp_path: Path) -> None:
    rows = [
        run("as it is", 0, [0.04] * 4),
        run("a little worse", 3, [0.08, 0.08, 0.06, 0.06]),
        run("as it is", 0, [0.06] * 4),
        run("far worse", 29, [0.1] * 4),
    ]
    path = tmp_path / "switches.json"
    write_result_file(path, "what", rows, {"holds": ["a", "a", "b", "b"]})
    _, _, base, little, far = cells(switches_table(path))
    # Two seeds, 4 and 6 cm: a deviation of the square root of 2.
    assert base[:3] == ["", "as it is", "5.00 ±\N{NO-BREAK SPACE}1.41"]
    # Gaps of 3 and 1 cm in two holds: 1 cm of standard error; of the seeds the root of 2 (1 + 1/2).
    assert little[:3] == ["[3](#ledger-3)", "a little worse", "+2.00 ±\N{NO-BREAK SPACE}2.00"]
    assert far[2] == "**+5.00 ±\N{NO-BREAK SPACE}1.73**"
    assert far[3] == "+0.00 ±\N{NO-BREAK SPACE}0.00"
    assert far[4] == far[2]


def test_a_real_scene_is_a_column_and_a_hand_a_range(tmp_path: Path) -> None:
    def row(method: str, scene: str, rmse: float, **more: float) -> dict[str, Any]:
        return {"method": method, "scene": scene, "rmse_m": rmse, "coverage": 0.5, **more}

    rows = [
        row("raw", "0001", 0.06),
        row("HADR, stand-in hand", "0001", 0.1, rmse_low_m=0.07, rmse_high_m=0.14),
        row("raw", "0002", 0.03),
        row("HADR, stand-in hand", "0002", 0.05, rmse_low_m=0.04, rmse_high_m=0.06),
    ]
    path = tmp_path / "real.json"
    write_result_file(
        path, "what", rows, {"scenes": {"0001": {"glasses": 4}, "0002": {"glasses": 2}}}
    )
    head, _, raw, hadr = cells(real_table(path))
    assert head == ["method", "4 glasses: RMSE (cm)", "of 4 restored (%)", "2 glasses: RMSE (cm)",
                    "of 2 restored (%)"]  # fmt: skip
    assert raw == ["the sensor's own depth", "6.0", "50", "3.0", "50"]
    assert hadr[1:] == ["10.0 (7.0 to 14.0)", "50", "5.0 (4.0 to 6.0)", "50"]
