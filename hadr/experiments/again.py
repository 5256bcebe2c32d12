"""Run a row of a result file once more, from the configuration that it records."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from hadr.experiments.runner import Bench, Run
from hadr.experiments.scoring import COLUMNS, EVALUATION_SIZE, score_cheap
from hadr.records.result_file import digest, read_result_file
from hadr.training.presets import recipe_from_dict


@dataclass(frozen=True)
class Again:
    """A row beside what it gave the second time.

    Attributes:
        run: The run's name.
        recorded: The first seed's numbers as the file has them, by column.
        now: The same of the second time.
        threads: With how many threads the row was trained; None where nothing was.
        device: On what it was trained.
    """

    run: str
    recorded: dict[str, float]
    now: dict[str, float]
    threads: int | None
    device: str

    @property
    def same(self) -> bool:
        """Whether all numbers agree to a millionth of their value."""
        return all(self._agrees(name) for name in self.recorded)

    def _agrees(self, name: str) -> bool:
        value = self.recorded[name]
        return abs(self.now[name] - value) <= 1e-6 * abs(value)

    def text(self) -> str:
        """Both side by side, for readers."""
        lines = [f"{self.run:<24} {'recorded':>12} {'again':>12}"]
        for name, value in self.recorded.items():
            mark = "" if self._agrees(name) else "  differs"
            lines.append(f"  {name:<22} {value:12.6f} {self.now[name]:12.6f}{mark}")
        return "\n".join(lines)


def measure_again(bench: Bench, file: str | Path, method: str) -> Again:
    """Train and score a row's first seed again, from its recorded configuration.

    The recipe is the one in the file, not the present one of that name, and so is the number of
    threads. A training that was stopped goes on; one that came to its end is forgotten.

    Args:
        bench: Data, corruption and limit; the second run goes to ``again`` below its output.
        file: A result file with the rows known, unknown, ablation or ledger.
        method: The row's method.

    Returns:
        Both sets of numbers.

    Raises:
        ValueError: As `row_to_run`.
        FileNotFoundError: There is no such file.
    """
    row = row_to_run(bench, file, method)
    configuration = row["configuration"]
    experiment, name, seed = configuration["run"].split("/")
    run = Run(experiment, name, int(seed.removeprefix("seed-")))
    recorded = {column: row["by_seed"][column][0] for column in COLUMNS}
    if configuration["recipe"] is None:
        scores = score_cheap(bench.frames(run, "test", EVALUATION_SIZE), name)
    else:
        before = torch.get_num_threads()
        torch.set_num_threads(row.get("threads") or before)
        try:
            recipe = recipe_from_dict(configuration["recipe"])
            folder = bench.out / "again" / run.name
            scores = bench.score(run, recipe, bench.train(run, recipe, folder).model)
        finally:
            torch.set_num_threads(before)
        shutil.rmtree(folder)  # or the next time would compare with this one
    columns = scores.columns()
    again = {column: float(columns[column]) for column in COLUMNS}
    return Again(run.name, recorded, again, row.get("threads"), row.get("device", "cpu"))


def row_to_run(bench: Bench, file: str | Path, method: str) -> dict[str, Any]:
    """Find a row of a result file that can be run again on a bench.

    Args:
        bench: Data, corruption and limit.
        file: A result file with the rows known, unknown, ablation or ledger.
        method: The row's method.

    Returns:
        The row.

    Raises:
        ValueError: The file was edited, has no such row, or the row has no recipe recorded; or
            the bench's data, corruption or limit are others than the row's.
        FileNotFoundError: There is no such file.
    """
    content = read_result_file(file)
    if any("given" in row for row in content.rows):
        raise ValueError(
            f"{file} has networks under other conditions, which were not trained for it; run their "
            "rows of known.json again"
        )
    try:
        row = content.row(method=method)
    except KeyError as error:
        raise ValueError(f"{file}: {error.args[0]}") from error
    configuration: dict[str, Any] = row.get("configuration") or {}
    if "recipe" not in configuration or digest(configuration) != row["config_sha256"][0]:
        raise ValueError(f"{file}: row {method!r} has no whole configuration to run again")
    then, now = configuration["data"], bench.data
    for part, option in (
        ("corruption", "--corruption"),
        ("limit", "--preset"),
        ("sha256", "--data"),
    ):
        if then[part] != now[part]:
            raise ValueError(
                f"{file}: row {method!r} was measured with {part} = {then[part]}, and {option} "
                f"gives {now[part]}"
            )
    if configuration["evaluation_size"] != list(EVALUATION_SIZE):
        raise ValueError(
            f"{file}: row {method!r} was scored at {configuration['evaluation_size']}, and this "
            f"version scores at {list(EVALUATION_SIZE)}"
        )
    return row
