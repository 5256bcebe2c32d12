"""The 3D scenes of the built pages: each is drawn, and turns when it is dragged."""

import html as markup

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


SCENE = """<html><head><meta name="viewport" content="width=device-width"></head><body>
<canvas width="300" height="300" style="touch-action:none"></canvas><script>
const canvas = document.querySelector("canvas"), gl = canvas.getContext("webgl",
  { preserveDrawingBuffer: true });
let at = 30, held = false;
function draw() {
  gl.disable(gl.SCISSOR_TEST); gl.clearColor(1, 1, 1, 1); gl.clear(gl.COLOR_BUFFER_BIT);
  gl.enable(gl.SCISSOR_TEST); gl.scissor(at, 100, 60, 60); gl.clearColor(0, 0, 0, 1);
  if (DRAWN) gl.clear(gl.COLOR_BUFFER_BIT);
}
canvas.onpointerdown = () => { held = true; };
canvas.onpointermove = () => { if (held && TURNS) { at = 150; draw(); } };
draw();
</script></body></html>"""


@pytest.mark.parametrize(
    ("drawn", "turns", "expected"),
    [
        ("true", "true", []),
        ("true", "false", ["scene 0 does not turn"]),
        ("false", "true", ["scene 0 is blank", "scene 0 does not turn"]),
    ],
)
def test_the_check_notices_blank_and_stiff_scenes(seen, tmp_path, drawn, turns, expected):
    page = SCENE.replace("DRAWN", drawn).replace("TURNS", turns)
    (tmp_path / "scene.html").write_text(page, encoding="utf-8")
    assert faults(seen[0], tmp_path / "scene.html", seen[1]) == expected
    framed = "<html><head><meta name='viewport' content='width=device-width'></head><body>"
    framed += (
        f"<div style='height:1500px'></div><iframe srcdoc=\"{markup.escape(page)}\" height=340>"
    )
    (tmp_path / "framed.html").write_text(framed, encoding="utf-8")
    assert faults(seen[0], tmp_path / "framed.html", seen[1]) == expected


def test_every_scene_of_the_book_is_drawn_and_turns(seen, html):
    scenes = [p for p in sorted(html.glob("notebooks/*.html")) if "canvas" in p.read_text("utf-8")]
    assert [path.name for path in scenes if path.name.startswith("02_")], "chapter 2 has one"
    wrong = {path.name: faults(seen[0], path, seen[1]) for path in scenes}
    assert {name: lines for name, lines in wrong.items() if lines} == {}
