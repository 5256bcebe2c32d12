"""The pages on a desktop and on a phone, in a light and in a dark theme."""

import functools
import urllib.parse
from pathlib import Path

import cv2
import numpy as np
import pytest

pytestmark = pytest.mark.browser

DAMAGED = """<html data-theme="light"><head><title>t</title>
<meta name="viewport" content="width=device-width">
<style>
  body { background: #fff; color: #222; margin: 0; font: 16px sans-serif; }
  html[data-theme="dark"] body { background: #111; color: #ddd; }
  html[data-theme="dark"] #stays { background: inherit; color: #222; }
  @media (prefers-color-scheme: dark) { #system { color: #888; } }
</style></head><body><main><article>
<details><summary>folded</summary><div id="wide" style="width:900px">wide</div></details>
<div id="box" style="overflow:hidden"><div id="lost" style="width:700px">lost</div></div>
<div style="overflow-x:auto"><video width="640" class="film"></video></div>
<div style="overflow-x:auto"><div id="fine" style="width:800px">scrolls</div></div>
<p id="stays">black on black</p><p id="system">grey</p><p style="opacity:.4" id="faint">faint</p>
<p style="color:#767676; background:#fff; font-size:16px" id="enough">4.54 to 1</p>
<p style="color:#949494; background:#fff; font-size:16px" id="short">3.03 to 1</p>
<p style="color:#949494; background:#fff; font-size:24px" id="large">3.03 to 1</p>
<p style="color:#fff; background:#fff; visibility:hidden" id="unseen">unseen</p>
<div class="cell_output"><img alt="a figure" src="FIGURE" style="width:340px; height:auto"></div>
<iframe title="squeezed" style="width:350px;height:120px" srcdoc="<title>inner</title><body
  style='margin:0;height:100%;background:#fff'><div id='stage'><img alt='b' src='FIGURE'
  style='height:60px;width:100%;object-fit:contain'></div><p style='color:#ccc' id='inner'>pale</p>
  <div style='height:90px'></div></body>"></iframe>
</article></main></body></html>"""


@pytest.fixture(params=["pages", pytest.param("phone_pages", marks=pytest.mark.long)])
def visited(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(params=["shaded_pages", "phone_pages"])
def shaded(request):
    return request.getfixturevalue(request.param)


def found(pages, kind):
    """Per page, what the layout shows of one kind, at most five each."""
    return {page.path.name: page.layout[kind][:5] for page in pages if page.layout[kind]}


@functools.lru_cache
def drawing(path):
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def lost_on(picture, behind):
    """Whether a picture that was made for white paper looks different on this backdrop."""
    if picture.ndim < 3 or picture.shape[2] < 4:
        return False
    alpha = picture[..., 3:].astype(float) / 255
    return float((np.abs(np.subtract(255, behind[::-1])) * (1 - alpha)).max(axis=2).mean()) > 8


def pale_pictures(page):
    """Pictures with transparent parts that stand on something dark in one of the shades."""
    lost = []
    for shade, told in page.contrast.items():
        for picture in told["pictures"]:
            source = urllib.parse.urlsplit(picture["src"])
            if source.scheme != "file" or min(picture["behind"]) > 215:
                continue
            path = Path(urllib.parse.unquote(source.path))
            if path.suffix == ".svg" or lost_on(drawing(path), picture["behind"]):
                lost.append(f"{path.name} on {picture['behind']} in {shade}")
    return lost


def weak_texts(page):
    """Texts with too little contrast, with the shade in which they have it."""
    lines = {}
    for shade, told in page.contrast.items():
        for line in told["weak"]:
            lines.setdefault(line, shade)
    return [f"{line} in {shade}" for line, shade in lines.items()]


def picture_file(path, transparent=False):
    picture = np.full((300, 900, 4), 255, np.uint8)
    picture[100:200, 100:800, :3] = 0
    if transparent:
        picture[..., 3] = np.where(picture[..., 0] == 0, 255, 0)
    cv2.imwrite(str(path), picture)


@pytest.fixture
def damaged(browser, tmp_path):
    picture_file(tmp_path / "figure.png", transparent=True)
    page = DAMAGED.replace("FIGURE", (tmp_path / "figure.png").as_uri())
    (tmp_path / "damaged.html").write_text(page, encoding="utf-8")
    browser.screen(phone=True)
    shades = [(theme, system) for theme in ("light", "dark") for system in ("light", "dark")]
    yield browser.examine(tmp_path / "damaged.html", shades)
    browser.screen(phone=False)


def test_the_layout_check_notices_damage(damaged):
    outside = " ".join(damaged.layout["outside"])
    assert "wide" in outside
    assert "video.film" in outside
    assert "scrolls" not in outside
    assert [line for line in damaged.layout["hidden"] if "lost" in line]
    assert not [line for line in damaged.layout["hidden"] if "scrolls" in line]
    assert len(damaged.layout["squeezed"]) == 2
    assert "180 px wide in a frame of 350" in damaged.layout["squeezed"][0]
    assert len(damaged.layout["small"]) == 2
    assert "at 0.38 of its size" in damaged.layout["small"][0]


def test_the_contrast_check_notices_damage(damaged):
    def weak(shade, text):
        return any(text in line for line in damaged.contrast[shade]["weak"])

    assert len(damaged.contrast) == 4
    for shade in damaged.contrast:
        assert weak(shade, "black on black") == (shade[0] == "dark")
        assert weak(shade, "grey") == (shade == ("light", "dark"))
        assert weak(shade, "faint")
        assert weak(shade, "pale"), "inside of a frame"
        assert [line for line in damaged.contrast[shade]["weak"] if "3.03 to 1" in line] != []
        assert sum("148,148,148" in line for line in damaged.contrast[shade]["weak"]) == 1
        assert not weak(shade, "4.54")
        assert not weak(shade, "unseen")
    assert {line.split(" ")[0] for line in pale_pictures(damaged)} == {"figure.png"}
    assert all("('dark'" in line for line in pale_pictures(damaged))


def test_an_opaque_picture_may_stand_on_anything(tmp_path):
    picture_file(tmp_path / "figure.png")
    picture = cv2.imread(str(tmp_path / "figure.png"), cv2.IMREAD_UNCHANGED)
    assert not lost_on(picture, [0, 0, 0])
    assert not lost_on(picture[..., :3], [0, 0, 0])


def test_nothing_sticks_out_or_is_cut_off(visited):
    assert found(visited, "outside") == {}
    assert found(visited, "hidden") == {}


def test_frames_are_as_high_as_what_they_hold(visited):
    assert found(visited, "squeezed") == {}


def test_letters_of_figures_are_large_enough(visited):
    assert found(visited, "small") == {}


@pytest.mark.long
def test_text_stands_out_in_every_shade(shaded):
    weak = {page.path.name: weak_texts(page)[:5] for page in shaded}
    assert {name: lines for name, lines in weak.items() if lines} == {}
    for page in shaded:
        least = 2 if page.path.name == "search.html" else 30
        assert all(told["texts"] > least for told in page.contrast.values()), page.path.name


@pytest.mark.long
def test_pictures_stand_on_light_paper(shaded):
    lost = {page.path.name: pale_pictures(page)[:5] for page in shaded}
    assert {name: lines for name, lines in lost.items() if lines} == {}


@pytest.mark.long
def test_a_phone_shows_the_whole_page_without_errors(phone_pages):
    for kind in ("missing", "unlabelled", "raw", "unrendered", "errors", "fonts"):
        seen = {page.path.name: page.seen[kind] for page in phone_pages}
        assert {name: lines for name, lines in seen.items() if lines} == {}, kind
    loud = {page.path.name: page.console + page.failed for page in phone_pages}
    assert {name: lines for name, lines in loud.items() if lines} == {}


def test_the_reader_can_choose_the_dark_theme(browser, html):
    browser.visit(html / "index.html")
    chosen = []
    for _ in range(3):
        browser.evaluate("document.querySelector('.theme-switch-button').click()")
        chosen.append(browser.evaluate("document.documentElement.dataset.theme"))
    assert "dark" in chosen
    for system in ("dark", "light"):
        wish = [{"name": "prefers-color-scheme", "value": system}]
        browser.call("Emulation.setEmulatedMedia", features=wish)
        browser.evaluate("localStorage.setItem('mode', 'auto')")
        browser.visit(html / "index.html")
        assert browser.evaluate("document.documentElement.dataset.theme") == system
    browser.evaluate("localStorage.clear()")
    browser.call("Emulation.setEmulatedMedia", features=[])
