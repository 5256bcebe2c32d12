"""The sliders over pictures drawn beforehand, in a browser without a kernel."""

import base64
import time

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.figures.solids.scrubber import Slider, scrubber

pytestmark = pytest.mark.browser

SHADES = [["#ff0000", "#00ff00", "#0000ff"], ["#ffff00", "#00ffff", "#ff00ff"]]


def evaluate(browser, expression):
    answer = browser.call(
        "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
    )
    assert "exceptionDetails" not in answer, answer
    return answer["result"].get("value")


def colour_at(browser, x, y):
    evaluate(browser, "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")
    data = browser.call("Page.captureScreenshot", format="png")["data"]
    image = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    return image[y, x, ::-1].astype(int)


def close_to(colour, row, column):
    wanted = [int(SHADES[row][column][i : i + 2], 16) for i in (1, 3, 5)]
    return np.abs(colour - wanted).max() < 25


@pytest.fixture(scope="module")
def page():
    def draw(row, column):
        figure = plt.figure(figsize=(4, 2), dpi=100, layout="none")
        figure.add_artist(plt.Rectangle((0, 0), 1, 1, color=SHADES[row][column]))
        return figure

    sliders = [Slider("row", ("a", "b")), Slider("column", ("x", "y", "z"), start=1)]
    return scrubber(draw, sliders, title="Colours", alt="one colour", frames_per_second=10)


def move(browser, slider, place):
    evaluate(
        browser,
        f"(() => {{ const s = document.querySelectorAll('input')[{slider}]; s.value = {place}; "
        "s.dispatchEvent(new Event('input')); })()",
    )


def test_sliders_change_the_picture(browser, page, tmp_path):
    page.save(tmp_path / "page.html")
    seen = browser.visit(tmp_path / "page.html")
    assert seen.console == []
    assert [u for u in seen.requests if not u.startswith(("file:", "data:"))] == []
    assert seen.seen["wider"] <= 0
    middle = evaluate(
        browser,
        "(() => { const r = document.querySelector('img').getBoundingClientRect();"
        " return [r.x + r.width / 2, r.y + r.height / 2].map(Math.round); })()",
    )
    assert close_to(colour_at(browser, *middle), 0, 1)
    move(browser, 0, 1)
    assert close_to(colour_at(browser, *middle), 1, 1)
    move(browser, 1, 2)
    assert close_to(colour_at(browser, *middle), 1, 2)
    told = evaluate(browser, "[...document.querySelectorAll('output')].map(o => o.textContent)")
    assert told == ["b", "z"]
    assert evaluate(browser, "document.querySelector('input').getAttribute('aria-label')") == "row"


def test_it_plays_and_stops(browser, page, tmp_path):
    page.save(tmp_path / "page.html")
    browser.visit(tmp_path / "page.html")
    evaluate(browser, "document.getElementById('play').click()")
    places = set()
    for _ in range(40):
        places.add(evaluate(browser, "at[0]"))
        time.sleep(0.02)
    assert places == {0, 1}
    move(browser, 1, 0)
    assert evaluate(browser, "timer === null")
    assert evaluate(browser, "document.getElementById('play').textContent") == "play"
