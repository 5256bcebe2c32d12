"""`benchmarks/networks/switches.py`: which rows of a file are not run again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from hadr.records.result_file import read_result_file


@pytest.mark.parametrize("script", ["switches", "tune"])
def test_a_row_of_other_data_or_code_is_run_again(
    script: str,
    load_benchmark: Callable[[str], ModuleType],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    ran: list[str] = []
    module, switches = (load_benchmark(f"networks/{name}") for name in (script, "switches"))
    bench = switches.BENCHES["plus"] if script == "switches" else module.BENCH
    few = switches.replace(
        bench,
        runs=bench.runs[:2],
        measure=lambda change, *_: ran.append(change.turned) or {"rmse_m": 0.1},
    )
    names = [change.turned for change, _ in few.runs]
    monkeypatch.setattr(switches, "code_of", lambda *_: "code")

    def run(data: str) -> list[str]:
        ran.clear()
        frames = SimpleNamespace(origin=lambda: {"data": data, "holds": []})
        switches.run(few, frames, tmp_path / "rows.json", None)
        rows = read_result_file(tmp_path / "rows.json").rows
        assert [row["turned"] for row in rows] == names
        return list(ran)

    assert run("one") == names
    assert run("one") == []
    assert run("another") == names
    monkeypatch.setattr(switches, "code_of", lambda *_: "other code")
    assert run("another") == names
