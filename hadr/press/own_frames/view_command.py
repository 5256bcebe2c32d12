"""`hadr view`: a restored cloud in the browser, on a page that needs no network."""

from __future__ import annotations

import os
import sys
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro

from hadr.camera import Intrinsics, back_project, valid_depth
from hadr.frame_io import read_depth, read_mask, read_point_colors
from hadr.records.caches import file_sha256
from hadr.records.option_words import FILE, FOLDER
from hadr.records.output_folder import VIEW, check_apart, check_file, wrote
from hadr.records.reading import read_json, structured
from hadr.records.result_file import is_sealed_page, sealed_page
from hadr.records.writing import write_whole

if TYPE_CHECKING:
    from hadr.figures.solids.turntable import Cloud

AROUND_M = 0.35
"""What is farther from the object's middle is left out: a wall behind would hide what turns."""
_SEEN_M = 0.16  # around it, as the view begins
_MARK = np.array([230, 159, 0])
_TITLE = "hadr view: "
EPILOG = """\
what is shown
  The points up to 0.35 m around the restored object, seen from the camera: as
  they are, with the restored ones in orange, and without these. The mouse or
  the arrow keys turn them, plus and minus come nearer and go away.

examples
  hadr view restored
  hadr view restored/0007    # a frame of a sequence
  hadr view restored --no-browser --out cloud.html

exit status
  0 done   1 the disk is full   2 no result of hadr restore, or a wrong call"""


@dataclass(frozen=True)
class Options:
    """Turn a restored cloud in the browser.

    Writes one page with all that it shows inside, and opens it: it needs no network, and may be
    sent to somebody who has no hadr.
    """

    result: tyro.conf.Positional[Annotated[Path, FOLDER]]
    """Folder that `hadr restore` wrote."""
    out: Annotated[Path | None, FILE] = None
    """File for the page; unset: view.html in the folder."""
    no_browser: bool = False
    """Only write the page."""


@dataclass(frozen=True)
class _Report:
    """What is read of a result's report."""

    method_title: str
    intrinsics: dict[str, Any]
    outputs: dict[str, dict[str, str]]


def run(options: Options) -> int:
    """Write the page, where nothing else stands, and open it."""
    from hadr.figures.solids.turntable import turntable  # loads matplotlib: --help need not wait

    path = options.out or options.result / VIEW
    check_file(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"the page is HTML: name a file NAME.html, got {str(path)!r}")
    if path.name == VIEW and path.resolve() != (options.result / VIEW).resolve():
        check_apart(path.with_name("page"))  # not another result's own page
    if path.exists() and not is_sealed_page(path):
        raise ValueError(
            f"{path} is no page of this command, or was changed since: it is not replaced, name "
            "another"
        )
    title = _TITLE + (options.result.resolve().name or "result")
    write_whole(path, sealed_page(turntable(clouds(options.result), title).page))
    shows = sys.platform in ("darwin", "win32") or {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ)
    opened = bool(shows) and not options.no_browser and webbrowser.open(path.resolve().as_uri())
    print(f"{path} is opened in the browser" if opened else f"{path}: open it in a browser")
    return 0


def clouds(folder: Path) -> list[Cloud]:
    """What the page of a result shows: its points, the restored ones marked, and without them."""
    from hadr.figures.solids.turntable import Cloud

    if not wrote(folder / "report.json", command="hadr restore"):
        raise ValueError(
            f"{folder} holds no result of 'hadr restore' (no report.json of it, or one that was "
            "changed since); of a sequence, name the folder of one frame"
        )
    where = folder / "report.json"
    report = structured(read_json(where), _Report, where, further=True)
    for name in ("depth.npy", "mask.png", "confidence.npy", "cloud.ply"):
        path = folder / name
        written = report.outputs.get(name, {}).get("sha256")
        if not path.is_file() or written != file_sha256(path):
            raise ValueError(f"{path} is missing, or was changed since: restore the frame again")
    try:
        camera, title = Intrinsics.from_dict(report.intrinsics), report.method_title
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    depth, mask = read_depth(folder / "depth.npy"), read_mask(folder / "mask.png")
    sure = read_depth(folder / "confidence.npy")  # an image of numbers like depth
    there = valid_depth(depth)
    colors = read_point_colors(folder / "cloud.ply")
    images = {depth.shape, mask.shape, sure.shape}
    if images != {camera.shape} or np.count_nonzero(there) != len(colors):
        raise ValueError(f"{folder}: depth, mask, confidence and cloud are not of one frame")
    if not len(colors):
        raise ValueError(f"{folder} holds no depth at all: there is no cloud to show")
    points = back_project(depth, camera)[there]
    made = (mask & (sure < 1))[there]  # what was measured has confidence 1
    center = np.median(points[made] if made.any() else points, axis=0)
    near = made | (np.linalg.norm(points - center, axis=1) <= AROUND_M)
    points, colors, made = points[near], colors[near], made[near]
    marked = np.where(made[:, None], np.rint(0.25 * colors + 0.75 * _MARK), colors).astype(np.uint8)
    count = int(made.sum())
    view = center, _SEEN_M, float(center[2] / camera.fx)
    shown = [Cloud("restored", f"{title}: {count} points restored", points, colors, *view)]
    if 0 < count < len(points):
        rest = ~made
        shown += [
            Cloud("restored points in orange", shown[0].note, points, marked, *view),
            Cloud("without them", "what the camera measured", points[rest], colors[rest], *view),
        ]
    return shown
