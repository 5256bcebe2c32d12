"""What the help of commands calls a value where its type says too little, and common limits."""

import tyro

CHAPTER = tyro.conf.arg(metavar="CHAPTER")
FILE = tyro.conf.arg(metavar="FILE")
FOLDER = tyro.conf.arg(metavar="FOLDER")
ID = tyro.conf.arg(metavar="ID")
"""An object's number, such as 0004."""
NAME = tyro.conf.arg(metavar="NAME")
MOST_JOBS, LARGEST_SEED = 1024, 2**63 - 1
"""The most processes at a time, and the largest seed, of any command."""


def check_range(option: str, number: float, least: float, most: float) -> None:
    """``ValueError`` for a number outside of what an option takes."""
    if not least <= number <= most:
        raise ValueError(f"--{option} must be from {least} to {most}, got {number}")
