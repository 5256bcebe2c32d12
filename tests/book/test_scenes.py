"""The 3D scenes of the built pages: each is drawn, and turns when it is dragged."""

import base64
import html

import cv2
import numpy as np
import pytest

pytestmark = pytest.mark.browser

CANVASES = """(() => {
  const documents = (doc) => [doc, ...[...doc.querySelectorAll("iframe")]
    .filter((frame) => frame.contentDocument).flatMap((frame) => documents(frame.contentDocument))];
  return documents(document).flatMap((doc) => [...doc.querySelectorAll("canvas")])
    .filter((canvas) => canvas.checkVisibility());
})()"""
BOX = """(() => {
  const canvas = CANVASES[NUMBER];
  canvas.scrollIntoView({ block: "center", behavior: "instant" });
  const box = canvas.getBoundingClientRect().toJSON();
  for (let view = canvas.ownerDocument.defaultView; view.frameElement; view = view.parent) {
    const frame = view.frameElement.getBoundingClientRect();
    box.x += frame.x; box.y += frame.y;
  }
  return [box.x, box.y, box.width, box.height].map(Math.round);
})()""".replace("CANVASES", CANVASES)
WEBGL = "document.createElement('canvas').getContext('webgl') !== null"
TWO_FRAMES = "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(() => r(1))))"


def picture(browser, box):
    """What the window shows in a box, (H, W, 3), after two more frames were drawn."""
    browser.evaluate(TWO_FRAMES)
    data = browser.call("Page.captureScreenshot", format="png")["data"]
    image = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    scale = image.shape[1] / browser.evaluate("innerWidth")
    x, y, width, height = (round(scale * v) for v in box)
    return image[max(y, 0) : y + height, max(x, 0) : x + width].astype(int)


def drag(browser, box, touch):
    """From the middle of a box a third of its width to the right, with a mouse or a finger."""
    x, y = box[0] + box[2] // 2, box[1] + box[3] // 2
    path = [(x + box[2] * step // 30, y) for step in range(11)]
    if touch:
        browser.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
        for at, up in path:
            browser.call(
                "Input.dispatchTouchEvent", type="touchMove", touchPoints=[{"x": at, "y": up}]
            )
        browser.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        return
    mouse = {"button": "left", "clickCount": 1}
    browser.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **mouse)
    for at, up in path:
        browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=at, y=up, buttons=1, **mouse)
    browser.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, **mouse)


def faults(browser, path, touch):
    """What is wrong with the scenes of a page, a line each."""
    browser.visit(path)
    lines = []
    for number in range(browser.evaluate(f"{CANVASES}.length")):
        box = browser.evaluate(BOX.replace("NUMBER", str(number)))
        if min(box[2:]) < 150:
            lines.append(f"scene {number} is only {box[2]} x {box[3]} px large")
            continue
        first = picture(browser, box)
        common = np.median(first.reshape(-1, 3), axis=0)
        if (np.abs(first - common).max(axis=2) > 40).mean() < 0.02:
            lines.append(f"scene {number} is blank")
        drag(browser, box, touch)
        turned = picture(browser, box)
        if (np.abs(turned - first).max(axis=2) > 40).mean() < 0.02:
            lines.append(f"scene {number} does not turn")
    return lines


@pytest.fixture(params=["mouse", "finger"])
def touch(request, browser):
    if not browser.evaluate(WEBGL):
        pytest.skip("this Chromium draws no WebGL, not even in software")
    if request.param == "finger":
        browser.screen(phone=True)
    yield request.param == "finger"
    browser.screen(phone=False)


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
def test_the_check_notices_blank_and_stiff_scenes(browser, tmp_path, touch, drawn, turns, expected):
    page = SCENE.replace("DRAWN", drawn).replace("TURNS", turns)
    (tmp_path / "scene.html").write_text(page, encoding="utf-8")
    assert faults(browser, tmp_path / "scene.html", touch) == expected
    framed = "<html><head><meta name='viewport' content='width=device-width'></head><body>"
    framed += f"<div style='height:1500px'></div><iframe srcdoc=\"{html.escape(page)}\" height=340>"
    (tmp_path / "framed.html").write_text(framed, encoding="utf-8")
    assert faults(browser, tmp_path / "framed.html", touch) == expected


def test_every_scene_of_the_book_is_drawn_and_turns(browser, pages, touch):
    scenes = [page.path for page in pages if page.layout["scenes"]]
    assert [path.name for path in scenes if path.name.startswith("02_")], "chapter 2 has one"
    wrong = {path.name: faults(browser, path, touch) for path in scenes}
    assert {name: lines for name, lines in wrong.items() if lines} == {}
