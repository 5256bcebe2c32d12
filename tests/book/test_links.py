"""Links inside of the built book, with their anchors; no browser is needed to follow them."""

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import yaml
from mdit_py_plugins.anchors.index import slugify

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("book", "notebooks/text", "data_samples")


class Page(HTMLParser):
    """The addresses that a page leads to or shows, and the places on it that can be led to."""

    def __init__(self, text):
        super().__init__()
        self.links, self.places = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        told = dict(attrs)
        self.places |= {told[name] for name in ("id", "name") if told.get(name) is not None}
        wanted = {"a": "href", "link": "href", "img": "src", "script": "src", "video": "src",
                  "source": "src", "iframe": "src"}  # fmt: skip
        if told.get(wanted.get(tag, "")) and told.get("rel") not in ("search", "canonical"):
            self.links.append(told[wanted[tag]])


def dead_links(html: Path) -> list[str]:
    """Links of a folder's pages to files or anchors that are not there, each once."""
    paths = [path for path in html.rglob("*.html") if "_static" not in path.parts]
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in paths}
    dead = set()
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            lost = place and target in pages and place not in pages[target].places
            if not target.exists() or lost:
                dead.add(f"{path.relative_to(html.resolve())} -> {link}")
    return sorted(dead)


def test_every_link_inside_of_the_book_leads_somewhere(html):
    assert dead_links(html) == []


def test_every_page_of_the_contents_was_built(html):
    contents = yaml.safe_load((ROOT / "book" / "_toc.yml").read_text(encoding="utf-8"))
    entries = [entry for part in contents["parts"] for entry in part["chapters"]]
    entries += [section for entry in entries for section in entry.get("sections", [])]
    names = [contents["root"], *(entry["file"] for entry in entries)]
    assert [name for name in names if not (html / f"{name}.html").exists()] == []


def test_links_name_the_number_of_their_chapter():
    pages = [ROOT / "README.md", *(p for name in FOLDERS for p in (ROOT / name).rglob("*.md"))]
    said = r"\[[Cc]hapter (\d+)\b[^\]]*\]\([^)\s]*?(?:notebooks/)?(\d\d)_\w+\.(?:ipynb|md)"
    wrong = [
        f"{path.name}: {found[0]}"
        for path in pages
        for found in re.finditer(said, path.read_text(encoding="utf-8"))
        if int(found[1]) != int(found[2])
    ]
    assert wrong == []


def test_links_to_a_heading_name_one_that_is_there():
    pages = [ROOT / "README.md", *(p for name in FOLDERS for p in (ROOT / name).rglob("*.md"))]
    texts = {path: path.read_text(encoding="utf-8") for path in pages}
    headings = {
        path: {slugify(title.replace("`", "")) for title in re.findall(r"^#+ (.*)$", text, re.M)}
        for path, text in texts.items()
    }
    wrong = []
    for path, text in texts.items():
        where = ROOT / "book" / "notebooks" if "text" in path.parts else path.parent
        for link, place in re.findall(r"\]\(([^)\s:#]+\.(?:md|ipynb))#([^)\s]+)\)", text):
            target = (where / link).resolve()
            if target.suffix == ".ipynb":
                target = ROOT / "notebooks" / "text" / f"{target.stem}.md"
            if place not in headings.get(target, ()):
                wrong.append(f"{path.name}: {link}#{place}")
    assert wrong == []
