"""What a reader's browser shows, page by page, without a network."""

import urllib.parse
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
GENERATED = {"genindex.html", "search.html"}

pytestmark = pytest.mark.browser


def complaints(pages, what):
    """Per page, what the browser saw of one kind; empty where all is well."""
    found = {page.path.name: page.seen[what] for page in pages}
    return {name: seen for name, seen in found.items() if seen}


def test_the_browser_notices_every_kind_of_damage(browser, tmp_path):
    """A checker that sees nothing would pass on any book."""
    page = tmp_path / "damaged.html"
    page.write_text(
        "<html><head><title>t</title></head><body><main>"
        '<img src="gone.png"><p>left $$x^2$$ behind, and {{RUNTIME}}</p>'
        '<span class="math">\\(y\\)</span><div style="width:5000px">wide</div>'
        '</main><script>console.error("told"); undefined_function();</script>'
        '<script src="gone.js"></script></body></html>',
        encoding="utf-8",
    )
    found = browser.visit(page)
    assert [source.rsplit("/", 1)[1] for source in found.seen["missing"]] == ["gone.png"]
    assert len(found.seen["unlabelled"]) == 1
    assert len(found.seen["raw"]) == 2
    assert found.seen["unrendered"] == ["\\(y\\)"]
    assert found.seen["wider"] > 1000
    assert any("told" in line for line in found.console)
    assert any("undefined_function" in line for line in found.console)
    assert len(found.failed) >= 2


def test_every_page_of_the_contents_was_built(pages, html):
    contents = yaml.safe_load((ROOT / "book" / "_toc.yml").read_text(encoding="utf-8"))
    names = [contents["root"]]
    for part in contents["parts"]:
        for entry in part["chapters"]:
            names += [e["file"] for e in (entry, *entry.get("sections", []))]
    built = {page.path.relative_to(html).with_suffix("").as_posix() for page in pages}
    assert set(names) - built == set()
    assert all(page.seen["text"] > 200 for page in pages if page.path.name not in GENERATED)


def test_console_is_silent_and_nothing_fails_to_load(pages):
    loud = {page.path.name: page.console + page.failed for page in pages}
    assert {name: lines for name, lines in loud.items() if lines} == {}


def test_nothing_is_asked_from_another_host(pages):
    foreign = {
        page.path.name: [u for u in page.requests if not u.startswith(("file:", "data:", "blob:"))]
        for page in pages
    }
    assert {name: urls for name, urls in foreign.items() if urls} == {}


def test_images_are_there_and_described(pages):
    assert complaints(pages, "missing") == {}
    assert complaints(pages, "unlabelled") == {}


def test_formulas_are_rendered(pages):
    assert complaints(pages, "raw") == {}
    assert complaints(pages, "unrendered") == {}
    assert complaints(pages, "errors") == {}
    assert complaints(pages, "fonts") == {}
    assert sum(page.seen["formulas"] for page in pages) > 20


def test_no_page_is_wider_than_the_window(pages):
    assert {p.path.name: p.seen["wider"] for p in pages if p.seen["wider"] > 0} == {}


def test_internal_links_lead_somewhere(pages):
    ids = {page.path: set(page.seen["ids"]) for page in pages}
    dead = []
    for page in pages:
        for link in page.seen["links"]:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme != "file":
                continue
            target = Path(urllib.parse.unquote(parts.path))
            fragment = urllib.parse.unquote(parts.fragment)
            if not target.exists():
                dead.append(f"{page.path.name} -> {target.name}")
            elif fragment and target in ids and fragment not in ids[target]:
                dead.append(f"{page.path.name} -> {target.name}#{fragment}")
    assert sorted(set(dead)) == []
