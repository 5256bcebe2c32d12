"""The command ``hadr generate``: a preset, the options that stand over it, and the run."""

from __future__ import annotations

import argparse
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from hadr.data.samples import samples_dir
from hadr.records.provenance import usable_cores
from hadr.synthesis.generation.farm import dask_installed
from hadr.synthesis.generation.generate import generate
from hadr.synthesis.generation.settings import PRESETS, GenerationSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``hadr generate``."""
    presets = "\n".join(f"  {name:<8} {p.purpose}" for name, p in PRESETS.items())
    parser.description = (
        "Make frames of hand-held glass with exact labels, in TransHand-14K's layout. A run that "
        f"was stopped\ngoes on when the same command is given again.\n\npresets\n{presets}"
    )
    add = parser.add_argument
    add("root", nargs="?", type=Path, help="the same as --out")
    add("--out", type=Path, metavar="DIR", help="folder of the data set; continued where it exists")
    add("--preset", choices=tuple(PRESETS), help="values for all that is not given (none)")
    add("-n", "--frames", type=int, help="number of frames (the preset's, else 64)")
    add("--engine", choices=("photo", "raycast"), help="trace paths, or cast rays (raycast)")
    add("--samples", type=int, metavar="N", help="paths a pixel of the photo engine (8)")
    add(
        "--sensor",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="with the raw depth of a simulated depth camera (without)",
    )
    add("--variant", choices=("llvm_ad_rgb", "scalar_rgb"), help="of Mitsuba (what works here)")
    add("--recordings", metavar="DIR", help="recorded holds as CSV (holds are made from the seed)")
    add("--backgrounds", metavar="DIR", help="photographs for the surroundings (textures)")
    add("--workers", type=int, metavar="K", help="processes (one per core; 1 without Dask)")
    add("--scheduler", metavar="ADDRESS", help="a Dask cluster instead, e.g. tcp://host:8786")
    add("--seed", type=int, help="seed of everything (0)")
    add("--width", type=int, help="image width in pixels (448)")
    add("--height", type=int, help="image height in pixels (252)")
    add("--objects", nargs="+", metavar="ID", help="objects, e.g. 0000 0004 (all)")
    add(
        "--split-by",
        choices=("holding", "frame", "object"),
        help="what a split keeps together: a holding pose, nothing but the frame (which leaks "
        "near-twins), or the object with 0004 and 0007 for testing (holding)",
    )
    add("--frames-per-hold", type=float, help="frames per holding pose (2)")
    add("--hold-shift", type=int, help=argparse.SUPPRESS)
    add(
        "--quality",
        choices=("fine", "fast"),
        help="of the ray caster; fine: four rays a pixel and soft shadows; fast: one (fine)",
    )
    add(
        "--depth",
        choices=("npy", "png"),
        dest="depth_format",
        help="depth as float metres (npy) or 16-bit in 0.1 mm steps (png) (npy)",
    )
    add(
        "--jpeg",
        type=int,
        metavar="QUALITY",
        dest="jpeg_quality",
        help="store colour as JPEG, 1..100 (PNG)",
    )
    add(
        "--rest-step",
        type=float,
        metavar="METRES",
        help="round the depth of what is neither hand nor glass, for smaller files (as exact)",
    )
    add(
        "--raw",
        choices=("depth", "disparity"),
        dest="raw_format",
        help="raw depth in 1 mm steps, or as the camera's disparity, which is smaller (depth)",
    )
    add(
        "--normals",
        choices=("all", "held", "object", "none"),
        help="where surface normals are kept: everywhere, on glass and hand, on the glass (all)",
    )


def _settings(args: argparse.Namespace) -> GenerationSettings:
    """The preset's settings with the given options put over them."""
    preset = PRESETS[args.preset] if args.preset else None
    settings = preset.settings if preset else GenerationSettings()
    names = [f.name for f in fields(GenerationSettings)]
    given: dict[str, Any] = {n: getattr(args, n) for n in names if getattr(args, n) is not None}
    if "objects" in given:
        given["objects"] = tuple(given["objects"])
    if preset and preset.bundled_recordings and "recordings" not in given:
        given["recordings"] = str(samples_dir() / "recordings")
    return replace(settings, **given)


def run(args: argparse.Namespace) -> int:
    """Carry out ``hadr generate``; returns the exit code."""
    root = args.out if args.out is not None else args.root
    if root is None or (args.out is not None and args.root is not None):
        raise ValueError("name one folder for the frames with --out DIR")
    settings = _settings(args)
    frames = args.frames
    if frames is None:
        frames = PRESETS[args.preset].frames if args.preset else 64
    workers = args.workers
    if workers is None:
        alone = args.scheduler or args.preset == "tiny" or not dask_installed()
        workers = 1 if alone else usable_cores()
    report = generate(
        root, frames, settings, workers=workers, scheduler=args.scheduler, progress=True
    )
    print(report)
    return 0
