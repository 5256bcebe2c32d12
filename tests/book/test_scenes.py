"""The 3D scenes of the built pages: each is drawn, and turns when it is dragged."""

import cv2
import numpy as np
import pytest

pytestmark = pytest.mark.browser


def picture(canvas):
    """What a canvas shows, (H, W, 3), after two more frames were drawn."""
    canvas.evaluate("() => new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")
    drawn = np.frombuffer(canvas.screenshot(), np.uint8)
    return cv2.imdecode(drawn, cv2.IMREAD_COLOR).astype(int)


def finger(tab, start, path):
    """Drag with a finger, from one place over others."""
    protocol = tab.page.context.new_cdp_session(tab.page)
    for kind, places in (("Start", [start]), ("Move", path)):
        for x, y in places:
            points = [{"x": x, "y": y}]
            protocol.send(
                "Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points}
            )
    protocol.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def faults(tab, path, touch):
    """What is wrong with the scenes of a page, a line each."""
    tab.visit(path)
    scenes = [c for frame in tab.page.frames for c in frame.locator("canvas:visible").all()]
    lines = []
    for number, canvas in enumerate(scenes):
        canvas.evaluate("c => c.scrollIntoView({ block: 'center', behavior: 'instant' })")
        box = canvas.bounding_box()
        if min(box["width"], box["height"]) < 150:
            lines.append(f"scene {number} is only {box['width']} x {box['height']} px large")
            continue
        first = picture(canvas)
        common = np.median(first.reshape(-1, 3), axis=0)
        if (np.abs(first - common).max(axis=2) > 40).mean() < 0.02:
            lines.append(f"scene {number} is blank")
        # From the middle a third of the width to the right.
        box = canvas.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        way = [(x + box["width"] * step / 30, y) for step in range(11)]
        finger(tab, (x, y), way) if touch else tab.drag((x, y), way)
        if (np.abs(picture(canvas) - first).max(axis=2) > 40).mean() < 0.02:
            lines.append(f"scene {number} does not turn")
    return lines


@pytest.fixture(params=["tab", "phone"])
def seen(request):
    tab = request.getfixturevalue(request.param)
    tab.needs_webgl()
    return tab, request.param == "phone"


def test_every_scene_of_the_book_is_drawn_and_turns(seen, html):
    scenes = [p for p in sorted(html.glob("notebooks/*.html")) if "canvas" in p.read_text("utf-8")]
    assert [path.name for path in scenes if path.name.startswith("02_")], "chapter 2 has one"
    wrong = {path.name: faults(seen[0], path, seen[1]) for path in scenes}
    assert {name: lines for name, lines in wrong.items() if lines} == {}
