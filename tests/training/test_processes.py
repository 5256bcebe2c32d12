from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from torch import nn

from hadr.training.processes import Share, average_gradients, shares
from hadr.training.task import shared_mean

SCRIPT = Path(__file__).with_name("two_processes.py")


def start(processes: int, out: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(SCRIPT), str(processes), str(out)],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stderr=subprocess.PIPE,
        text=True,
    )


def test_two_processes_learn_like_one_with_twice_the_batch(tmp_path: Path) -> None:
    # The glasses have 8 to 56 pixels: a mean of the processes' means would be another number.
    files = {processes: tmp_path / f"{processes}.json" for processes in (1, 2)}
    started = [start(processes, out) for processes, out in files.items()]
    for process in started:
        _, errors = process.communicate(timeout=300)
        assert process.returncode == 0, errors
    one, two = (json.loads(files[n].read_text(encoding="utf-8")) for n in (1, 2))
    for network in ("hadr", "norm", "lidf"):
        assert len(one[network]) == len(two[network]) == 3
        for mine, theirs in zip(one[network], two[network], strict=True):
            assert set(mine) == set(theirs)
            for name in set(mine) - {"seconds"}:
                assert theirs[name] == pytest.approx(mine[name], rel=1e-4, abs=1e-5), name


def test_shares_cover_each_step_and_leave_no_process_without_frames() -> None:
    # 11 frames in steps of 4 for two processes: 2 + 2, 2 + 2, 1 + 2.
    first, second = shares(11, 4, 0, 2), shares(11, 4, 1, 2)
    assert [(s.start, s.stop) for s in first] == [(0, 2), (4, 6), (8, 9)]
    assert [(s.start, s.stop) for s in second] == [(2, 4), (6, 8), (9, 11)]
    assert first[2] == Share(8, 9, 8, 3)
    assert len(shares(9, 4, 0, 2)) == 2  # a single frame is not enough for two
    assert [(s.start, s.stop) for s in shares(9, 4, 0, 1)] == [(0, 4), (4, 8), (8, 9)]


def test_shared_mean_of_one_process() -> None:
    total = torch.tensor(6.0, requires_grad=True)
    mean = shared_mean(total, torch.tensor(4))
    assert mean.item() == 1.5
    mean.backward()
    assert total.grad is not None
    assert total.grad.item() == 0.25
    empty = shared_mean((total * 0).sum(), 0)
    empty.backward()
    assert (empty.item(), total.grad.item()) == (0.0, 0.25)


def test_one_process_keeps_its_gradients() -> None:
    net = nn.Linear(2, 1)
    net(torch.ones(1, 2)).sum().backward()
    before = net.weight.grad
    average_gradients(net, 1)
    assert net.weight.grad is before
