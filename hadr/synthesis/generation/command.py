"""The command ``hadr generate``: a preset, the options that stand over it, and the run."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import tyro

from hadr.records.option_words import FOLDER
from hadr.synthesis.generation.settings import PRESETS, GenerationSettings

#: What options are called where that is not the setting's name.
_SHORTER = {"depth_format": "depth", "jpeg_quality": "jpeg", "raw_format": "raw"}
#: What their values are called.
_VALUES = {"objects": "ID", "recordings": "FOLDER", "backgrounds": "FOLDER"}

if TYPE_CHECKING:
    Given = GenerationSettings
else:
    Given = make_dataclass(
        "Given",
        [
            (
                name,
                Annotated[
                    hint | None,
                    tyro.conf.arg(name=_SHORTER.get(name), metavar=_VALUES.get(name)),
                ],
                None,
            )
            for name, hint in get_type_hints(GenerationSettings).items()
            if name != "sensor"  # a switch
        ],
        namespace={"__doc__": GenerationSettings.__doc__},
        frozen=True,
    )


@dataclass(frozen=True)
class Options:
    """Make frames of hand-held glass with exact labels, in TransHand-14K's layout.

    A run that was stopped goes on when the same command is given again.
    """

    root: tyro.conf.Positional[Annotated[Path | None, FOLDER]] = None
    """The same as --out."""
    out: Annotated[Path | None, FOLDER] = None
    """Folder of the data set; continued where it exists."""
    preset: Literal["tiny", "samples", "gallery", "mini", "paper"] | None = None
    """Values for all that is not given; in brackets what holds without one."""
    frames: Annotated[int | None, tyro.conf.arg(aliases=("-n",))] = None
    """Number of frames; unset: the preset's, else 64."""
    sensor: bool = False
    """With the raw depth of a simulated depth camera."""
    no_sensor: bool = False
    """Without it, whatever the preset says."""
    workers: int | None = None
    """Processes; unset: one per core, one for preset tiny."""
    settings: Annotated[Given, tyro.conf.arg(name="")] = field(default_factory=Given)


_PURPOSES = "\n".join(
    textwrap.fill(p.purpose, 78, initial_indent=f"  {name:<9}", subsequent_indent=" " * 11)
    for name, p in PRESETS.items()
)
EPILOG = f"""
presets
{_PURPOSES}

examples
  hadr generate --preset tiny --out build/tiny
  hadr generate --preset mini --engine photo --workers 8 --out frames

exit status
  0 done   1 the disk is full   2 unusable settings, folder or worker
  130 interrupted"""


def _settings(options: Options) -> GenerationSettings:
    """The preset's settings with the given options put over them."""
    preset = PRESETS[options.preset] if options.preset else None
    from hadr.data.samples import samples_dir

    given: dict[str, Any] = {k: v for k, v in vars(options.settings).items() if v is not None}
    if options.sensor and options.no_sensor:
        raise ValueError("give one of --sensor and --no-sensor")
    if options.sensor or options.no_sensor:
        given["sensor"] = options.sensor
    if preset and preset.bundled_recordings and "recordings" not in given:
        given["recordings"] = str(samples_dir() / "recordings")
    return replace(preset.settings if preset else GenerationSettings(), **given)


def run(options: Options) -> int:
    """Carry out ``hadr generate``; returns the exit code."""
    from hadr.records.processes import MOST_WORKERS
    from hadr.records.provenance import usable_cores
    from hadr.synthesis.generation.generate import generate

    root = options.out or options.root
    if root is None or (options.out and options.root):
        raise ValueError("name one folder for the frames with --out DIR")
    settings, frames, workers = _settings(options), options.frames, options.workers
    if frames is None:
        frames = PRESETS[options.preset].frames if options.preset else 64
    if workers is None:
        workers = 1 if options.preset == "tiny" else min(usable_cores(), MOST_WORKERS)
    print(generate(root, frames, settings, workers=workers, progress=True))
    return 0
