from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from torch import nn

from hadr.training.losses import shared_mean
from hadr.training.processes import Share, average_gradients, shares

SCRIPT = Path(__file__).with_name("two_processes.py")


def test_two_processes_learn_like_one_with_twice_the_batch(tmp_path: Path) -> None:
    # The glasses have 8 to 56 pixels: a mean of the processes' means would be another number.
    # In double precision both are the same but for the record's numbers, which have 32 bits.
    out = tmp_path / "histories.json"
    done = subprocess.run([sys.executable, str(SCRIPT), str(out)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    alone, listens, together = json.loads(out.read_text(encoding="utf-8")).values()
    assert set(listens) <= {"127.0.0.1"}, "no other machine can reach the processes"
    for network in ("hadr", "lidf"):
        assert len(alone[network]) == len(together[network]) == 3
        for one, two in zip(alone[network], together[network], strict=True):
            assert set(one) == set(two)
            for name in set(one) - {"seconds"}:
                assert two[name] == pytest.approx(one[name], rel=1e-6, abs=1e-9), name


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
