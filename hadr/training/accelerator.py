"""Where trainings run: the argument `--accelerator`, and what it comes to on this machine."""

from __future__ import annotations

import argparse
from typing import Literal

import torch

Accelerator = Literal["auto", "cpu", "cuda"]


def add_accelerator(parser: argparse._ActionsContainer) -> None:
    """Add `--accelerator` to a parser or to a group of arguments."""
    parser.add_argument(
        "--accelerator",
        choices=("auto", "cpu", "cuda"),
        default="auto",
        help="auto: cuda if any; numbers of a GPU are near to those of a CPU, not equal to them",
    )


def chosen_accelerator(wish: str) -> str:
    """Give "cuda" or "cpu" for "auto", "cpu" or "cuda".

    Raises:
        ValueError: "cuda" is wished where there is none.
    """
    cuda = torch.cuda.is_available()
    if wish == "cuda" and not cuda:
        raise ValueError("--accelerator cuda: PyTorch finds no CUDA device on this machine")
    return "cuda" if cuda and wish != "cpu" else "cpu"
