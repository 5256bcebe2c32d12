"""What benchmarks that look at finished runs share: their arguments, their bench, their file."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from hadr.experiments.runner import Bench
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import write_result_file


def arguments(description: str | None) -> argparse.ArgumentParser:
    """Give a parser of what all of them take; a benchmark may add its own."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--runs", type=Path, required=True, help="OUT/runs of hadr reproduce")
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--preset", default="mini", help="of the runs")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    return parser


def open_runs(args: argparse.Namespace) -> Bench:
    """Set the number of threads, and open the bench of the runs."""
    torch.set_num_threads(args.threads)
    return Bench(args.data, args.runs, args.preset)


def write_rows(path: Path, what: str, rows: Sequence[Mapping[str, Any]], bench: Bench) -> None:
    """Write a result file with where its numbers come from."""
    origin = {**provenance(), "machine": machine_text(), "data": bench.data}
    write_result_file(path, what, rows, origin)
