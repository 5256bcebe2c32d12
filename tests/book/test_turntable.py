"""The turning hands in a browser: something is drawn, it turns, and the glass is transparent."""

import numpy as np
import pytest

from hadr.figures.solids.turntable import Cloud, held_glass, turntable
from hadr.synthesis.holding.hold import make_hold

pytestmark = pytest.mark.browser


def skin_pixels(image):
    """Pixels that are clearly redder than the grey-blue paper."""
    return (image[..., 0] - image[..., 2]) > 30


@pytest.fixture(scope="module")
def table():
    holds = [make_hold("0000", 0, 0), make_hold("0001", 0, 0)]
    return turntable([held_glass(hold) for hold in holds])


def test_it_draws_turns_and_changes_the_hold(tab, table, tmp_path):
    table.save(tmp_path / "table.html")
    tab.visit(tmp_path / "table.html")
    tab.needs_webgl()
    assert tab.console == []
    assert tab.foreign() == []
    first = tab.picture()
    assert 0.03 < skin_pixels(first).mean() < 0.6
    tab.drag((600, 500), [(615 + 15 * step, 500) for step in range(10)])
    turned = tab.picture()
    assert (np.abs(turned - first).max(axis=2) > 40).mean() > 0.03
    tab.drag((600, 500), [(585 - 15 * step, 500) for step in range(10)])
    back = tab.picture()
    assert (np.abs(back - first).max(axis=2) > 40).mean() < 0.005
    tab.evaluate("document.querySelectorAll('#tabs button')[1].click()")
    other = tab.picture()
    assert (np.abs(other - first).max(axis=2) > 40).mean() > 0.03


def test_one_sees_through_the_glass(tab, table, tmp_path):
    """Without the glass the picture changes at outlines and glints, and hardly anywhere else."""
    table.save(tmp_path / "table.html")
    tab.visit(tmp_path / "table.html")
    tab.needs_webgl()
    whole = tab.picture()
    tab.evaluate("made[at].glass.count = 0; redraw()")
    bare = tab.picture()
    change = np.abs(whole - bare).max(axis=2)
    glass = change > 0
    assert glass.mean() > 0.02
    assert 2 < np.median(change[glass]) < 45
    both = glass & skin_pixels(bare)
    assert skin_pixels(whole)[both].mean() > 0.7, "the hand is seen through the glass"


def test_the_keyboard_turns_it_and_bones_show(tab, table, tmp_path):
    table.save(tmp_path / "table.html")
    tab.visit(tmp_path / "table.html")
    tab.needs_webgl()
    first = tab.picture()
    tab.evaluate("document.querySelector('canvas').focus()")
    for _ in range(5):
        tab.page.keyboard.press("ArrowLeft")
    assert tab.evaluate("yaw - DATA.scenes[0].yaw") == pytest.approx(0.5)
    assert (np.abs(tab.picture() - first).max(axis=2) > 40).mean() > 0.01
    before = skin_pixels(tab.picture()).mean()
    tab.evaluate("byId('bones').click()")
    assert skin_pixels(tab.picture()).mean() < before


def test_it_draws_inside_a_frame_of_a_page(tab, table, tmp_path):
    page = f"<html><body><h1>Chapter</h1>{table._repr_html_()}</body></html>"
    (tmp_path / "chapter.html").write_text(page, encoding="utf-8")
    tab.visit(tmp_path / "chapter.html")
    tab.needs_webgl()
    assert tab.console == []
    assert skin_pixels(tab.picture()).mean() > 0.02
    inner = "document.querySelector('iframe').contentWindow"
    assert tab.evaluate(f"{inner}.document.querySelectorAll('#tabs button').length") == 2


def test_a_browser_without_webgl_says_so_and_stays_quiet(tab, table, tmp_path):
    table.save(tmp_path / "table.html")
    text = (tmp_path / "table.html").read_text(encoding="utf-8")
    text = text.replace('canvas.getContext("webgl", ', 'canvas.getContext("absent", ')
    (tmp_path / "table.html").write_text(text, encoding="utf-8")
    tab.visit(tmp_path / "table.html")
    assert tab.console == []
    assert "no WebGL" in tab.evaluate("document.body.innerText")


def test_a_cloud_turns_and_keeps_its_view_beside_another(tab, tmp_path):
    """A red square before a blue one: from the camera it hides it, from the side both are seen."""
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-0.05, 0.05, 60)]), -1).reshape(-1, 2)
    place = np.concatenate([np.insert(grid, 2, z, axis=1) for z in (0.5, 0.6)])
    ink = np.repeat(np.uint8([[220, 20, 20], [20, 20, 220]]), len(grid), axis=0)
    shown = [Cloud(name, "", place, ink, np.array([0, 0, 0.55]), 0.1, 0.003) for name in "ab"]
    turntable(shown, "clouds").save(tmp_path / "clouds.html")
    tab.visit(tmp_path / "clouds.html")
    tab.needs_webgl()
    assert tab.console == []
    assert tab.foreign() == []

    def shares():
        picture = tab.picture()
        redder = picture[..., 0] - picture[..., 2]
        return (redder > 120).mean(), (redder < -120).mean()

    red, blue = shares()
    assert red > 0.02
    assert blue < 0.002
    tab.evaluate("turn(.9, 0)")
    assert min(shares()) > 0.01
    turned = tab.evaluate("yaw")
    tab.evaluate("document.querySelectorAll('#tabs button')[1].click()")
    assert tab.evaluate("[at, yaw]") == [1, turned]
    assert min(shares()) > 0.01
    assert tab.evaluate("byId('bones').offsetParent === null"), "a cloud has no bones"
