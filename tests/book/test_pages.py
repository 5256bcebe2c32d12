"""The pages in a reader's browser, without a network: on a desktop and a phone, light and dark."""

import functools
import re
import urllib.parse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from matplotlib.figure import Figure

pytestmark = pytest.mark.browser

LAYOUT = (Path(__file__).parent / "layout.js").read_text(encoding="utf-8")
FEW = ("index.html", "notebooks/00_introduction.html", "library/camera.html")
#: The page's theme, and what the reader's system prefers: all four on most pages, two a device.
AT_ODDS = [("light", "dark"), ("dark", "light")]
AT_ONE = [("light", "light"), ("dark", "dark")]
#: The theme's sidebar breaks the first, Sphinx's lists of arguments the second, the roles of its
#: references the rest.
NOT_OURS = ("summary-name", "definition-list", "aria-deprecated-role", "aria-required-children")
# What a page says about itself once MathJax has finished.
INSPECT = r"""
(async () => {
  if (window.MathJax && MathJax.startup) await MathJax.startup.promise;
  for (const image of document.images) image.loading = "eager";
  await Promise.all([...document.images].map(i => i.decode().catch(() => null)));
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const raw = [];
  while (walker.nextNode()) {
    const node = walker.currentNode;
    if (node.parentElement.closest("pre, code, script, style, mjx-container, textarea")) continue;
    if (/\$\$|\\\(|\\\)|\\\[|\\(frac|mathbf|text|delta|sum|in)\b/.test(node.data) ||
        /(^|\s)\$[^$\n]+\$($|[\s.,;:])/.test(node.data) || /\{\{[A-Z_]+\}\}/.test(node.data))
      raw.push(node.data.trim().slice(0, 80));
  }
  const math = [...document.querySelectorAll("span.math, div.math")];
  const fonts = [...document.fonts].filter(f => f.status === "error").map(f => f.family);
  return {
    text: document.body.innerText.length,
    missing: [...document.images].filter(i => !i.complete || !i.naturalWidth).map(i => i.src),
    unlabelled: [...document.querySelectorAll("article img, main img")]
      .filter(i => !(i.getAttribute("alt") || "").trim()).map(i => i.src),
    raw, fonts,
    unrendered: math.filter(m => !m.querySelector("mjx-container"))
      .map(m => m.textContent.trim().slice(0, 80)),
    formulas: math.length,
    errors: [...document.querySelectorAll("mjx-merror, [data-mjx-error]")]
      .map(e => e.textContent.trim().slice(0, 80)),
  };
})()
"""
# The opaque colour behind each picture.
PICTURES = r"""
() => {
  const behind = (e) => {
    if (!e) return [255, 255, 255];
    const colour = getComputedStyle(e).backgroundColor.match(/[\d.]+/g).map(Number);
    return (colour[3] ?? 1) > 0.5 ? colour.slice(0, 3) : behind(e.parentElement);
  };
  return [...document.querySelectorAll("article img, #stage img")]
    .filter(i => i.naturalWidth && i.checkVisibility())
    .map(i => ({ src: i.src, behind: behind(i) }));
}
"""

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
<div class="pst-scrollable-table-container" style="overflow-x:auto"><table style="width:700px">
<caption>as wide as its table</caption><tr><td>cell</td></tr></table></div>
<p id="stays">black on black</p><p id="system">grey</p><p style="opacity:.4" id="faint">faint</p>
<p style="color:#767676; background:#fff; font-size:16px" id="enough">4.54 to 1</p>
<p style="color:#949494; background:#fff; font-size:16px" id="short">3.03 to 1</p>
<p style="color:#949494; background:#fff; font-size:24px" id="large">3.03 to 1</p>
<p style="color:#fff; background:#fff; visibility:hidden" id="unseen">unseen</p>
<div class="cell_output">
<img alt="a figure" src="FIGURE" style="max-width:340px; height:auto"></div>
<iframe title="squeezed" style="width:350px;height:120px" srcdoc="<title>inner</title><body
  style='margin:0;height:100%;background:#fff'><div id='stage'><img alt='b' src='FIGURE'
  style='height:60px;width:100%;object-fit:contain'></div><p style='color:#ccc' id='inner'>pale</p>
  <div style='height:90px'></div></body>"></iframe>
<img src="gone.png"><p>left $$x^2$$ behind, and {{RUNTIME}}</p><span class="math">\\(y\\)</span>
<p style="height:10px">under</p><p style="margin-top:-28px">over it</p>
</article></main><script>console.error("told"); undefined_function();</script>
<script src="gone.js"></script></body></html>"""


@dataclass
class Seen:
    """What the browser saw on one page; `weak` and `pictures` in each of the shades."""

    path: Path
    console: list[str]
    foreign: list[str]
    facts: dict[str, Any]
    layout: dict[str, list[str]]
    axe: dict[tuple[str, str], list[str]]
    pictures: dict[tuple[str, str], list[dict[str, Any]]]


def broken_rules(tab, everything):
    """What axe finds on a page and in its frames, a line for each element."""
    options = {"resultTypes": ["violations"], "iframes": False, "preload": False}
    options["runOnly"] = ["wcag2a", "wcag2aa"] if everything else ["color-contrast"]
    if everything:
        options["rules"] = {rule: {"enabled": False} for rule in NOT_OURS}
    # Pages that are files may not talk to their frames: each is asked for itself.
    results = [Axe().run(frame, options=options).response for frame in tab.page.frames]
    found = [rule for result in results for rule in result["violations"]]
    return [f"{rule['id']} {node['html'][:120]}" for rule in found for node in rule["nodes"]]


def examine(tab, path, shades):
    """Visit a page, open all that is folded, and see it in each of the shades."""
    tab.visit(path)
    facts = tab.evaluate(INSPECT)
    tab.page.add_style_tag(content="* { transition: none !important; animation: none !important }")
    layout = tab.evaluate(LAYOUT)
    axe, pictures = {}, {}
    for theme, system in shades:
        tab.page.emulate_media(color_scheme=system)
        tab.evaluate(
            f"void Object.assign(document.documentElement.dataset, {{theme: {theme!r},"
            f" mode: {theme!r}}}); document.documentElement.style.colorScheme = ''"
        )
        axe[theme, system] = broken_rules(tab, (theme, system) == shades[0])
        frames = tab.page.frames
        pictures[theme, system] = [told for frame in frames for told in frame.evaluate(PICTURES)]
    told = tab.console + tab.failed
    return Seen(path, told, tab.foreign(), facts, layout, axe, pictures)


#: Whether on a phone, and in which shades.
VIEWS = {"few": (True, AT_ONE), "desktop": (False, AT_ODDS), "phone": (True, AT_ONE)}


@pytest.fixture(
    scope="module",
    params=["few", *(pytest.param(name, marks=pytest.mark.long) for name in ("desktop", "phone"))],
)
def pages(request, opened, html):
    """A few pages, or every page of the book, on one device and in two shades."""
    parts = ("", "notebooks/", "library/")
    paths = [path for part in parts for path in sorted(html.glob(part + "*.html"))]
    if request.param == "few":
        paths = [html / name for name in FEW]
    on_phone, shades = VIEWS[request.param]
    one = shades[on_phone:][:1]  # the library's pages are long and alike: a shade a device
    seen = []
    for path in paths:  # each in a tab of its own: one that shows all of them runs out of memory
        with opened(on_phone) as tab:
            seen.append(examine(tab, path, one if path.parent.name == "library" else shades))
    return seen


@functools.lru_cache
def drawing(path):
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def lost_on(picture, behind):
    """Whether a picture that was made for white paper looks different on this backdrop."""
    if picture.ndim < 3 or picture.shape[2] < 4:
        return False
    alpha = picture[..., 3:].astype(float) / 255
    return float((np.abs(np.subtract(255, behind[::-1])) * (1 - alpha)).max(axis=2).mean()) > 8


def on_paper(path):
    """Whether matplotlib's drawing begins with a filled patch, the figure's own."""
    text = path.read_text(encoding="utf-8")
    return bool(re.search(r'<g id="patch_1">\s*<path d="[^"]*" style="fill: #', text))


def pale_pictures(page):
    """Pictures with transparent parts that stand on something dark in one of the shades."""
    lost = []
    for shade, pictures in page.pictures.items():
        for picture in pictures:
            source = urllib.parse.urlsplit(picture["src"])
            if source.scheme != "file" or min(picture["behind"]) > 215:
                continue
            path = Path(urllib.parse.unquote(source.path))
            clear = not on_paper(path) if path.suffix == ".svg" else lost_on(
                drawing(path), picture["behind"]
            )  # fmt: skip
            if clear:
                lost.append(f"{path.name} on {picture['behind']} in {shade}")
    return lost


def picture_file(path, transparent=False):
    picture = np.full((300, 900, 4), 255, np.uint8)
    picture[100:200, 100:800, :3] = 0
    if transparent:
        picture[..., 3] = np.where(picture[..., 0] == 0, 255, 0)
    cv2.imwrite(str(path), picture)


@pytest.fixture(scope="module")
def damaged(opened, tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    picture_file(folder / "figure.png", transparent=True)
    page = DAMAGED.replace("FIGURE", (folder / "figure.png").as_uri())
    (folder / "damaged.html").write_text(page, encoding="utf-8")
    with opened(True) as tab:
        return examine(tab, folder / "damaged.html", AT_ONE + AT_ODDS)


def test_damage_to_the_content_is_noticed(damaged):
    """A checker that sees nothing would pass on any book."""
    facts = damaged.facts
    assert [source.rsplit("/", 1)[1] for source in facts["missing"]] == ["gone.png"]
    assert len(facts["unlabelled"]) == 1
    assert len(facts["raw"]) == 2
    assert facts["unrendered"] == ["\\(y\\)"]
    told = " ".join(damaged.console)
    assert all(word in told for word in ("told", "undefined_function", "gone.js", "gone.png"))


def test_damage_to_the_layout_is_noticed(damaged):
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
    assert len(damaged.layout["overlapping"]) == 1
    assert "under" in damaged.layout["overlapping"][0]
    assert "as wide as its table" in damaged.layout["cut"][0]


def test_damage_to_the_contrast_is_noticed(damaged):
    assert len(damaged.axe) == 4
    for shade, lines in damaged.axe.items():
        weak = " ".join(line for line in lines if line.startswith("color-contrast"))
        assert ("black on black" in weak) == (shade[0] == "dark")
        assert ("grey" in weak) == (shade == ("light", "dark"))
        assert "faint" in weak
        assert "pale" in weak, "inside of a frame"
        assert weak.count("3.03 to 1") == 1
        assert "4.54" not in weak
        assert "unseen" not in weak
    assert {line.split(" ")[0] for line in pale_pictures(damaged)} == {"figure.png"}
    assert all("('dark'" in line for line in pale_pictures(damaged))


@pytest.mark.parametrize("clear", [False, True])
def test_a_drawing_is_opaque_where_it_has_paper(tmp_path, clear):
    with mpl.rc_context({"savefig.transparent": clear}):
        Figure().savefig(tmp_path / "drawing.svg")
    assert on_paper(tmp_path / "drawing.svg") != clear


def test_an_opaque_picture_may_stand_on_anything(tmp_path):
    picture_file(tmp_path / "figure.png")
    picture = cv2.imread(str(tmp_path / "figure.png"), cv2.IMREAD_UNCHANGED)
    assert not lost_on(picture, [0, 0, 0])
    assert not lost_on(picture[..., :3], [0, 0, 0])


def complaints(pages, told):
    """Per page, at most five of what is told of it; empty where all is well."""
    return {page.path.name: told(page)[:5] for page in pages if told(page)}


def test_nothing_is_asked_from_another_host_or_goes_wrong(pages):
    assert complaints(pages, lambda page: page.foreign) == {}
    assert complaints(pages, lambda page: page.console) == {}


@pytest.mark.parametrize("what", ["missing", "unlabelled", "raw", "unrendered", "errors", "fonts"])
def test_images_and_formulas_are_there(pages, what):
    assert complaints(pages, lambda page: page.facts[what]) == {}


@pytest.mark.parametrize("what", ["outside", "hidden", "squeezed", "small", "overlapping", "cut"])
def test_the_layout_holds(pages, what):
    assert complaints(pages, lambda page: page.layout[what]) == {}


def test_texts_stand_out_and_parts_have_names(pages):
    assert all(page.axe for page in pages)
    for shade in pages[0].axe:
        assert complaints(pages, lambda page, shade=shade: page.axe.get(shade)) == {}, shade


def test_pictures_stand_on_light_paper(pages):
    assert complaints(pages, pale_pictures) == {}


def test_pages_have_text_and_formulas(pages):
    generated = ("genindex.html", "search.html")
    assert all(p.facts["text"] > 200 for p in pages if p.path.name not in generated)
    assert sum(page.facts["formulas"] for page in pages) > 5


def test_heads_tell_of_the_page_and_its_title_stands_once(tab, html):
    tab.visit(html / "index.html")
    read = "s => document.querySelector(s)"
    assert tab.page.title().count("Depth for glass in a hand") == 1
    for name in ('name="description"', 'property="og:description"'):
        assert len(tab.page.evaluate(f"({read})('meta[{name}]').content")) > 60
    for picture in tab.page.locator('meta[property="og:image"]').all():
        assert picture.get_attribute("content").startswith("http")
    assert (html / "_images" / "restored_frame.png").exists()
    icon = tab.page.evaluate(f"""({read})('link[rel="icon"]').getAttribute("href")""")
    assert (html / icon).exists()


#: Of figures that scroll: whether they fade, and where the fading ends above the caption.
FADING = """async () => {
  await Promise.all([...document.images].map((i) => (i.loading = "eager", i.decode().catch(() => 0))));
  await new Promise((done) => setTimeout(done, 400));
  return [...document.querySelectorAll("article figure")].filter((f) => f.scrollWidth > f.clientWidth + 1)
    .map((figure) => {
      const [top, caption] = [figure, figure.querySelector("figcaption")].map((e) => e.getBoundingClientRect().top);
      const above = parseFloat(figure.style.getPropertyValue("--above"));
      return [getComputedStyle(figure).maskImage.includes("gradient"), Math.abs(caption - top - above) < 1];
    });
}"""  # noqa: E501


def test_figures_that_scroll_fade_where_they_go_on_and_their_captions_do_not(phone, html):
    phone.visit(html / "notebooks" / "00_introduction.html")
    found = phone.page.evaluate(FADING)
    assert len(found) > 0
    assert all(fades and ends for fades, ends in found)


def test_every_term_is_found_by_its_selector(tab, html):
    """The search page asks for it so."""
    tab.visit(html / "glossary.html")
    found = "[...document.querySelectorAll('dt[id]')].map(e => document.querySelector('#' + e.id))"
    assert all(tab.evaluate(f"{found}.map(Boolean)"))


def test_the_reader_can_choose_the_dark_theme(tab, html):
    tab.visit(html / "index.html")
    button = "document.querySelector('.theme-switch-button').click()"
    chosen = {}
    for _ in range(6):  # twice through all three, to end with the system's
        tab.evaluate(button)
        mode, theme = tab.evaluate("(d => [d.mode, d.theme])(document.documentElement.dataset)")
        chosen[mode] = theme
        if mode == "auto" and len(chosen) == 3:
            break
    assert chosen.items() >= {"dark": "dark", "light": "light"}.items()
    for system in ("dark", "light"):
        tab.page.emulate_media(color_scheme=system)
        tab.page.wait_for_function(f"document.documentElement.dataset.theme == '{system}'")
