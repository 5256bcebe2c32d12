"""The sliders over pictures drawn beforehand, in a browser without a kernel."""

import time

import matplotlib.pyplot as plt
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe

from hadr.figures.solids.scrubber import Slider, scrubber

pytestmark = pytest.mark.browser

SHADES = [["#ff0000", "#00ff00", "#0000ff"], ["#ffff00", "#00ffff", "#ff00ff"]]


def close_to(colour, row, column):
    wanted = [int(SHADES[row][column][i : i + 2], 16) for i in (1, 3, 5)]
    return np.abs(colour - wanted).max() < 25


def colours(inches=4):
    def draw(row, column):
        figure = plt.figure(figsize=(inches, 2), dpi=100, layout="none")
        figure.add_artist(plt.Rectangle((0, 0), 1, 1, color=SHADES[row][column]))
        return figure

    sliders = [Slider("row", ("a", "b")), Slider("column", ("x", "y", "z"), start=1)]
    return scrubber(draw, sliders, title="Colours", alt="one colour", frames_per_second=10)


@pytest.fixture(scope="module")
def page():
    return colours()


def move(tab, slider, place):
    tab.page.locator("input").nth(slider).fill(str(place))


def test_sliders_change_the_picture(tab, page, tmp_path):
    page.save(tmp_path / "page.html")
    tab.visit(tmp_path / "page.html")
    assert tab.console == []
    assert tab.foreign() == []
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    box = tab.page.locator("img").bounding_box()
    x, y = round(box["x"] + box["width"] / 2), round(box["y"] + box["height"] / 2)
    assert close_to(tab.picture()[y, x], 0, 1)
    move(tab, 0, 1)
    assert close_to(tab.picture()[y, x], 1, 1)
    move(tab, 1, 2)
    assert close_to(tab.picture()[y, x], 1, 2)
    assert tab.page.locator("output").all_text_contents() == ["b", "z"]
    assert tab.page.locator("input").first.get_attribute("aria-label") == "row"


def test_it_plays_and_stops(tab, page, tmp_path):
    page.save(tmp_path / "page.html")
    tab.visit(tmp_path / "page.html")
    tab.page.click("#play")
    places = set()
    for _ in range(40):
        places.add(tab.evaluate("at[0]"))
        time.sleep(0.02)
    assert places == {0, 1}
    move(tab, 1, 0)
    assert tab.evaluate("timer === null")
    assert tab.page.text_content("#play") == "play"


def test_the_keyboard_reaches_and_moves_the_sliders(tab, page, tmp_path):
    page.save(tmp_path / "page.html")
    tab.visit(tmp_path / "page.html")
    for _ in range(6):
        tab.page.keyboard.press("Tab")
        if tab.evaluate("document.activeElement === document.querySelectorAll('input')[1]"):
            break
    tab.page.keyboard.press("ArrowRight")
    assert tab.page.locator("output").all_text_contents() == ["a", "z"]
    assert tab.page.locator("img").get_attribute("alt")


@pytest.mark.parametrize(("inches", "scrolls"), [(4, False), (12, True)])
def test_the_keyboard_scrolls_what_is_wider_than_a_phone(opened, tmp_path, inches, scrolls):
    colours(inches).save(tmp_path / "page.html")
    with opened(True) as tab:
        tab.visit(tmp_path / "page.html")
        tab.page.wait_for_function(
            f"stage.scrollWidth > stage.clientWidth === {str(scrolls).lower()}"
        )
        tab.page.keyboard.press("Tab")
        assert tab.evaluate("document.activeElement === stage") == scrolls
        tab.page.keyboard.press("ArrowRight")
        if scrolls:
            tab.page.wait_for_function("stage.scrollLeft > 0")
        assert Axe().run(tab.page, options={"runOnly": ["wcag2a"]}).response["violations"] == []
