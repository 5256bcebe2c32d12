"""Films of a handover: one picture a moment, below it the stage, the time and the reason.

The files play in browsers: MP4 (H.264, yuv420p) through imageio's ffmpeg, or GIF.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from functools import lru_cache
from itertools import chain
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from hadr.handover.stages import Stage, Transition
from hadr.records.writing import whole_file
from hadr.simulation.film.world_view import FilmSet, Picture, View
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState

STAGE_COLORS: dict[Stage, str] = {
    Stage.WAIT_AND_OBSERVE: "#9a9a9a",
    Stage.APPROACH_AND_REACT: "#0072B2",
    Stage.GRASP_AND_RETRIEVE: "#009E73",
    Stage.FINISHED: "#56B4E9",
    Stage.STOPPED: "#D55E00",
    Stage.GOING_HOME: "#E69F00",
    Stage.GAVE_UP: "#CC79A7",
}
"""Colours of the stages; Okabe and Ito's."""
CAPTION_HEIGHT = 72
"""Rows below each picture of a film, pixels."""
_PAPER, _INK, _QUIET = "#ffffff", "#1a1a1a", "#555555"
_MARGIN, _RIBBON = 12, 10


def stage_at(time: float, transitions: Sequence[Transition]) -> tuple[Stage, str]:
    """The stage at a time in seconds, and why it was entered."""
    now, reason = (transitions[0].before if transitions else Stage.WAIT_AND_OBSERVE), ""
    for change in transitions:
        if change.time > time + 1e-9:
            break
        now, reason = change.after, change.reason
    return now, reason


def nearest_state(states: Sequence[WorldState], time: float) -> WorldState:
    """The state whose time is nearest to a time in seconds."""
    times = np.array([state.time for state in states])
    return states[int(np.abs(times - time).argmin())]


@lru_cache(maxsize=8)
def _font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which matplotlib brings along."""
    from matplotlib import get_data_path

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(get_data_path()) / "fonts" / "ttf" / name), size)


def captioned(
    picture: Picture,
    time: float,
    transitions: Sequence[Transition],
    span: tuple[float, float],
    note: str = "",
) -> Picture:
    """Put stage, time, reason or a note in its place, and the ribbon of stages above a picture.

    Above, because a player's controls cover what is below: sRGB (H, W, 3) uint8 becomes
    (H + CAPTION_HEIGHT, W, 3). The span is the ribbon's first and last time, seconds.
    """
    rows, width = picture.shape[:2]
    whole = Image.new("RGB", (width, rows + CAPTION_HEIGHT), _PAPER)
    whole.paste(Image.fromarray(picture), (0, CAPTION_HEIGHT))
    ribbon = CAPTION_HEIGHT - _RIBBON
    draw = ImageDraw.Draw(whole)
    start, end = span
    length = max(end - start, 1e-9)

    def column(moment: float) -> float:
        return float(width * np.clip((moment - start) / length, 0.0, 1.0))

    edges = [start, *(change.time for change in transitions), end]
    stages = [stage_at(start - 1.0, transitions)[0], *(change.after for change in transitions)]
    for left, right, stage in zip(edges, edges[1:], stages, strict=False):
        wide = max(column(right), column(left) + 3)  # a last stage of no length is seen too
        if stage in (Stage.FINISHED, Stage.STOPPED):
            wide = width
        left_at = min(column(left), width - 6)
        draw.rectangle((left_at, ribbon, wide, CAPTION_HEIGHT - 1), fill=STAGE_COLORS[stage])
    here = min(max(column(time), 2.0), width - 3.0)
    end_of_mark = CAPTION_HEIGHT + 2
    draw.rectangle((here - 2, ribbon - 3, here + 2, end_of_mark), fill=_INK, outline=_PAPER)
    stage, reason = stage_at(time, transitions)
    top = 5
    clock = f"{time:.1f} s"
    draw.text((width - _MARGIN, top), clock, _INK, _font(17), anchor="ra")
    square = (_MARGIN, top + 3, _MARGIN + 13, top + 16)
    draw.rectangle(square, fill=STAGE_COLORS[stage])
    draw.text((_MARGIN + 21, top), stage.value, _INK, _font(17, True))
    strong = stage is Stage.STOPPED
    letter = 0.66 if strong else 0.56  # width over size
    for size in (13, 11):
        letters = int((width - 2 * _MARGIN) / (letter * size))
        lines = textwrap.wrap(note or reason, max(20, letters))[:2]
        if len(lines) < 2:
            break
    for number, line in enumerate(lines):
        place = (_MARGIN, top + 23 + number * 14)
        draw.text(place, line, _INK if strong else _QUIET, _font(size, strong))
    return np.asarray(whole, dtype=np.uint8)


def film_times(states: Sequence[WorldState], rate: float) -> list[float]:
    """Times in seconds of a film's pictures, so many a second, the last state's included."""
    if not states:
        raise ValueError("a film needs at least one state, got none")
    if not rate > 0:
        raise ValueError(f"rate must be positive, got {rate}")
    start, end = states[0].time, states[-1].time
    count = int(np.ceil((end - start) * rate - 1e-6)) + 1
    return [min(start + k / rate, end) for k in range(count)]


def film_frames(
    states: Sequence[WorldState],
    scene: HeldScene,
    transitions: Sequence[Transition] = (),
    *,
    view: View | None = None,
    rate: float = 12.5,
    hold: float = 1.0,
    ending: str = "",
) -> Iterator[Picture]:
    """Draw a film's pictures, one after the other, as `captioned` makes them.

    Of the states, in the order of time, the nearest one is taken for each picture, `rate` a second;
    the last one stays for `hold` seconds and says `ending` in place of the reason, such as the
    verdict. The side view where none is given.
    """
    times = film_times(states, rate)
    span = (states[0].time, states[-1].time)
    drawn = FilmSet(scene, view)
    for time in times:
        words = ending if time == times[-1] else ""
        frame = captioned(drawn.draw(nearest_state(states, time)), time, transitions, span, words)
        yield frame
    for _ in range(round(hold * rate)):
        yield frame


def write_film(path: str | Path, frames: Iterable[Picture], rate: float = 12.5) -> Path:
    """Write sRGB pictures (H, W, 3) uint8 as a film, .mp4 or .gif, whole or not at all.

    ValueError for another ending, no picture, or pictures of an odd (MP4) or another size.
    """
    path = Path(path)
    if path.suffix not in (".mp4", ".gif"):
        raise ValueError(f"a film's name must end in .mp4 or .gif, got {path.name!r}")
    checked = _same_size(frames, even=path.suffix == ".mp4")
    first = next(checked, None)
    if first is None:
        raise ValueError("a film needs at least one picture, got none")
    write = _write_gif if path.suffix == ".gif" else _write_mp4
    with whole_file(path) as part:
        write(part, chain([first], checked), rate)
    return path


def _write_gif(path: Path, frames: Iterable[Picture], rate: float) -> None:
    # 256 colours of each picture's own; the octree keeps skin smooth
    pictures = [Image.fromarray(f).quantize(256, method=Image.Quantize.FASTOCTREE) for f in frames]
    pictures[0].save(
        path, save_all=True, append_images=pictures[1:], duration=round(1000 / rate), loop=0
    )


def _write_mp4(path: Path, frames: Iterable[Picture], rate: float) -> None:
    try:
        import imageio.v2 as imageio

        writer = imageio.get_writer(
            path,
            format="FFMPEG",
            fps=rate,
            codec="libx264",
            pixelformat="yuv420p",
            macro_block_size=2,
            quality=None,
            output_params=["-crf", "26", "-movflags", "+faststart"],
            ffmpeg_log_level="error",
        )
    except ImportError as error:
        raise ImportError(
            "an MP4 needs imageio and imageio-ffmpeg: pip install 'hadr[handover]'"
        ) from error
    with closing(writer):  # as its own context it would stay open where a picture fails
        for frame in frames:
            writer.append_data(frame)


def _same_size(frames: Iterable[Picture], *, even: bool) -> Iterator[Picture]:
    size: tuple[int, ...] | None = None
    for frame in frames:
        size = size or frame.shape
        if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape != size or size[2] != 3:
            raise ValueError(
                f"pictures must be uint8 of one size (H, W, 3), got {frame.shape} {frame.dtype} "
                f"after {size}"
            )
        if even and (size[0] % 2 or size[1] % 2):
            raise ValueError(f"an MP4 needs even height and width, got {size[0]} x {size[1]}")
        yield frame
