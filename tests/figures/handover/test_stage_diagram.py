"""The drawn state machine is the workflow's own."""

import pytest

from hadr.figures.handover import stage_diagram as drawn
from hadr.handover.stages import CHANGES, Stage


def test_every_change_is_drawn_between_the_boxes_of_its_stages():
    sheet = drawn.stage_diagram()
    told = " ".join(text.get_text() for text in sheet.page.texts).split()
    assert set(" ".join(stage.value for stage in Stage).split()) <= set(told)

    def touches(place, box):
        left, bottom, width, height = box
        inside = left <= place[0] <= left + width and bottom <= place[1] <= bottom + height
        return inside

    for (before, after), (places, _, _) in drawn.WAYS.items():
        three = (drawn.THREE,) if after is Stage.STOPPED else ()
        assert any(touches(places[0], box) for box in (drawn.BOXES[before], *three))
        assert touches(places[-1], drawn.BOXES[after])


def test_another_change_in_the_table_is_noticed(monkeypatch):
    monkeypatch.setitem(CHANGES, Stage.FINISHED, {Stage.WAIT_AND_OBSERVE: "again"})
    with pytest.raises(ValueError, match="differ in Finished -> Wait & Observe"):
        drawn.stage_diagram()
