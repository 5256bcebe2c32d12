"""The turning hands in a browser: something is drawn, it turns, and the glass is transparent."""

import base64

import cv2
import numpy as np
import pytest

from hadr.figures.solids.turntable import held_glass, turntable
from hadr.synthesis.holding.hold import make_hold

pytestmark = pytest.mark.browser


def evaluate(browser, expression):
    answer = browser.call(
        "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
    )
    assert "exceptionDetails" not in answer, answer
    return answer["result"].get("value")


def picture(browser):
    """A screenshot after two more frames were drawn."""
    evaluate(browser, "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")
    data = browser.call("Page.captureScreenshot", format="png")["data"]
    image = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    return image[..., ::-1].astype(int)


def drag(browser, start, steps):
    x, y = start
    mouse = {"button": "left", "clickCount": 1}
    browser.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **mouse)
    for dx, dy in steps:
        x, y = x + dx, y + dy
        browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, buttons=1, **mouse)
    browser.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, **mouse)


def skin_pixels(image):
    """Pixels that are clearly redder than the grey-blue paper."""
    return (image[..., 0] - image[..., 2]) > 30


@pytest.fixture(scope="module")
def table():
    holds = [make_hold("0000", 0, 0), make_hold("0001", 0, 0)]
    return turntable([held_glass(hold) for hold in holds])


def needs_webgl(browser):
    if not evaluate(browser, "document.createElement('canvas').getContext('webgl') !== null"):
        pytest.skip("this Chromium draws no WebGL, not even in software")


def test_it_draws_turns_and_changes_the_hold(browser, table, tmp_path):
    table.save(tmp_path / "table.html")
    page = browser.visit(tmp_path / "table.html")
    needs_webgl(browser)
    assert page.console == []
    assert [u for u in page.requests if not u.startswith(("file:", "data:"))] == []
    first = picture(browser)
    assert 0.03 < skin_pixels(first).mean() < 0.6
    drag(browser, (600, 500), [(15, 0)] * 10)
    turned = picture(browser)
    assert (np.abs(turned - first).max(axis=2) > 40).mean() > 0.03
    drag(browser, (600, 500), [(-15, 0)] * 10)
    back = picture(browser)
    assert (np.abs(back - first).max(axis=2) > 40).mean() < 0.005
    evaluate(browser, "document.querySelectorAll('#tabs button')[1].click()")
    other = picture(browser)
    assert (np.abs(other - first).max(axis=2) > 40).mean() > 0.03


def test_one_sees_through_the_glass(browser, table, tmp_path):
    """Without the glass the picture changes at outlines and glints, and hardly anywhere else."""
    table.save(tmp_path / "table.html")
    browser.visit(tmp_path / "table.html")
    needs_webgl(browser)
    whole = picture(browser)
    evaluate(browser, "made[at].glass.count = 0; redraw()")
    bare = picture(browser)
    change = np.abs(whole - bare).max(axis=2)
    glass = change > 0
    assert glass.mean() > 0.02
    assert 2 < np.median(change[glass]) < 45
    both = glass & skin_pixels(bare)
    assert skin_pixels(whole)[both].mean() > 0.7, "the hand is seen through the glass"


def test_the_keyboard_turns_it_and_bones_show(browser, table, tmp_path):
    table.save(tmp_path / "table.html")
    browser.visit(tmp_path / "table.html")
    needs_webgl(browser)
    first = picture(browser)
    evaluate(browser, "document.querySelector('canvas').focus()")
    for _ in range(5):
        browser.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft", code="ArrowLeft")
    assert evaluate(browser, "yaw - DATA.scenes[0].yaw") == pytest.approx(0.5)
    assert (np.abs(picture(browser) - first).max(axis=2) > 40).mean() > 0.01
    before = skin_pixels(picture(browser)).mean()
    evaluate(browser, "byId('bones').click()")
    assert skin_pixels(picture(browser)).mean() < before


def test_it_draws_inside_a_frame_of_a_page(browser, table, tmp_path):
    page = f"<html><body><h1>Chapter</h1>{table._repr_html_()}</body></html>"
    (tmp_path / "chapter.html").write_text(page, encoding="utf-8")
    seen = browser.visit(tmp_path / "chapter.html")
    needs_webgl(browser)
    assert seen.console == []
    assert skin_pixels(picture(browser)).mean() > 0.02
    inner = "document.querySelector('iframe').contentWindow"
    assert evaluate(browser, f"{inner}.document.querySelectorAll('#tabs button').length") == 2


def test_a_browser_without_webgl_says_so_and_stays_quiet(browser, table, tmp_path):
    table.save(tmp_path / "table.html")
    text = (tmp_path / "table.html").read_text(encoding="utf-8")
    text = text.replace('canvas.getContext("webgl", ', 'canvas.getContext("absent", ')
    (tmp_path / "table.html").write_text(text, encoding="utf-8")
    page = browser.visit(tmp_path / "table.html")
    assert page.console == []
    assert "no WebGL" in evaluate(browser, "document.body.innerText")


def test_the_built_chapter_holds_one(browser, html):
    chapter = html / "notebooks" / "02_transhand_data.html"
    if not chapter.exists():
        pytest.skip("the book was built without chapter 2: run `make book`")
    browser.visit(chapter)
    needs_webgl(browser)
    frames = "[...document.querySelectorAll('iframe')].filter(f => f.title === 'Hands on glass')"
    if not evaluate(browser, f"{frames}.length"):
        pytest.skip("chapter 2 was built before it had its turning hands: run `make book`")
    evaluate(browser, f"{frames}[0].scrollIntoView()")
    assert skin_pixels(picture(browser)).mean() > 0.02
