"""The handover's state machine as a diagram, drawn from the workflow's own table of changes."""

from textwrap import fill

from hadr.figures.sheet import FONT, Box, Sheet
from hadr.handover.stages import CHANGES, Stage
from hadr.simulation.film.film import STAGE_COLORS

Place = tuple[float, float]
WAIT, APPROACH, GRASP = Stage.WAIT_AND_OBSERVE, Stage.APPROACH_AND_REACT, Stage.GRASP_AND_RETRIEVE
BOXES: dict[Stage, Box] = {
    WAIT: (0.2, 3.3, 2.2, 0.8),
    APPROACH: (3.7, 3.3, 2.2, 0.8),
    GRASP: (7.2, 3.3, 2.2, 0.8),
    Stage.FINISHED: (10.0, 3.3, 1.3, 0.8),
    Stage.GAVE_UP: (0.2, 0.15, 1.2, 0.8),
    Stage.GOING_HOME: (2.7, 0.15, 2.2, 0.8),
    Stage.STOPPED: (7.2, 0.15, 2.2, 0.8),
}
"""Where the stages stand, inches."""
THREE: Box = (0.06, 2.72, 9.48, 1.96)
"""The frame around the paper's three stages, each of which may be stopped."""
WAYS: dict[tuple[Stage, Stage], tuple[tuple[Place, ...], Place, int]] = {
    (WAIT, APPROACH): (((2.4, 3.86), (3.7, 3.86)), (3.05, 4.14), 12),
    (APPROACH, WAIT): (((3.7, 3.54), (2.4, 3.54)), (3.05, 3.22), 12),
    (APPROACH, GRASP): (((5.9, 3.7), (7.2, 3.7)), (6.55, 4.0), 12),
    (GRASP, Stage.FINISHED): (((9.4, 3.7), (10.0, 3.7)), (10.5, 4.4), 14),
    (GRASP, Stage.STOPPED): (((8.9, 2.72), (8.9, 0.95)), (9.9, 1.8), 12),
    (Stage.STOPPED, GRASP): (((8.1, 0.95), (8.1, 3.3)), (7.35, 1.62), 14),
    (Stage.STOPPED, WAIT): (
        ((7.2, 0.75), (6.2, 0.75), (6.2, 2.3), (0.9, 2.3), (0.9, 3.3)), (3.27, 2.1), 30),
    (WAIT, Stage.GOING_HOME): (((2.1, 3.3), (2.1, 1.5), (3.1, 1.5), (3.1, 0.95)), (0, 0), 0),
    (APPROACH, Stage.GOING_HOME): (((4.4, 3.3), (4.4, 0.95)), (5.15, 1.6), 14),
    (Stage.STOPPED, Stage.GOING_HOME): (((7.2, 0.4), (4.9, 0.4)), (6.05, 0.16), 34),
    (Stage.GOING_HOME, Stage.GAVE_UP): (((2.7, 0.55), (1.4, 0.55)), (2.05, 0.84), 14),
}  # fmt: skip
"""The arrows: along which places, where their words stand, and how wide these are, letters."""
IN_FRAME = {(WAIT, Stage.STOPPED), (APPROACH, Stage.STOPPED), (Stage.STOPPED, Stage.STOPPED)}
"""Changes without an arrow of their own: from the frame, and from one stop to the next."""


def stage_diagram() -> Sheet:
    """Draw all changes of `hadr.handover.stages.CHANGES`.

    Raises:
        ValueError: The table has other changes than the drawing has places for.
    """
    changes = {(a, b): words for a, after in CHANGES.items() for b, words in after.items()}
    if changes.keys() != WAYS.keys() | IN_FRAME:
        other = changes.keys() ^ (WAYS.keys() | IN_FRAME)
        words = sorted(f"{a.value} -> {b.value}" for a, b in other)
        raise ValueError(f"the table and the drawing differ in {', '.join(words)}")
    sheet = Sheet(11.4, 4.75)
    sheet.card(THREE)
    sheet.write(6.55, 4.45, "the paper's three stages", ha="center", style="italic")
    for change, (places, at, width) in WAYS.items():
        sheet.arrow(*places)
        if width:
            sheet.write(*at, fill(changes[change], width), ha="center", linespacing=1.1)
    for stage, box in BOXES.items():
        left, bottom, wide, high = box
        sheet.card(box, fill="white", edge=STAGE_COLORS[stage], lw=3)
        sheet.write(left + wide / 2, bottom + high / 2, stage.value, ha="center", weight="bold",
                    fontsize=FONT + 1)  # fmt: skip
    return sheet
