import base64
import importlib.util
import re

import nbformat
import pytest

from hadr.press.course.slides import (
    build_slides,
    deck_text,
    missing_packages,
    pictures_of,
    sections_of,
)

PIXEL = base64.b64encode(b"not really a picture").decode()


def executed(tmp_path, source="draw()"):
    output = nbformat.v4.new_output("display_data", {"image/png": PIXEL})
    cell = nbformat.v4.new_code_cell(source, outputs=[output])
    path = tmp_path / "executed.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=[cell]), path)
    return path


def test_pictures_are_taken_out(small, tmp_path):
    found = pictures_of(executed(tmp_path), small, tmp_path)
    assert found == {"draw()": "07_small-0.png"}
    assert (tmp_path / "07_small-0.png").read_bytes() == b"not really a picture"


def test_a_notebook_of_another_state_is_named(small, tmp_path):
    with pytest.raises(ValueError, match=r"is not of this state of 07_small.*'draw\(\)'"):
        pictures_of(executed(tmp_path, source="draw(2)"), small, tmp_path)


needs_reveal = pytest.mark.skipif(
    importlib.util.find_spec("sphinx_revealjs") is None,
    reason="slides need sphinx-revealjs: pip install -e '.[book]'",
)


@pytest.fixture(scope="module")
def decks(book, root, tmp_path_factory):
    assert missing_packages() == []
    chosen = book[3:5]
    undrawn = {chapter.name: root / "notebooks" / f"{chapter.name}.ipynb" for chapter in chosen}
    built = []
    for name in ("first", "second"):
        folder = tmp_path_factory.mktemp(name)
        plain = lambda text: re.sub(r"\{\w+\}`", "`", text)  # noqa: E731
        build_slides(chosen, undrawn, plain, folder / "work", folder / "out")
        built.append(folder / "out")
    return built


@needs_reveal
def test_one_deck_per_chapter_in_reveals_form(decks):
    names = {path.name for path in decks[0].glob("*.html")}
    assert names == {"index.html", "03_ray_voxels.html", "04_ray_and_voxel_features.html"}
    page = (decks[0] / "03_ray_voxels.html").read_text(encoding="utf-8")
    assert page.count("<section") >= 15
    assert re.search(r'class="reveal"[^>]*>\s*<div class="?\'?slides', page)
    assert "Reveal" in page
    assert '<aside class="notes">' in page


@needs_reveal
def test_scripts_and_styles_lie_beside_the_deck(decks):
    for page in decks[0].glob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="([^"]+)"', text)
        assert loaded
        for address in loaded:
            assert not re.match(r"(https?:)?//", address)
            assert (decks[0] / address.split("?")[0].split("#")[0]).exists(), address
        assert "import " not in "".join(re.findall(r"<script[^>]*>(.*?)</script>", text, re.S))


@needs_reveal
def test_the_same_bytes_again(decks):
    first, second = (
        {p.relative_to(d).as_posix(): p.read_bytes() for p in d.rglob("*") if p.is_file()}
        for d in decks
    )
    assert first == second


def test_sections(small):
    first, second, last = sections_of(small)
    assert [s.heading for s in (first, second, last)] == [
        "What is doubling?",
        "Exercises",
        "Summary",
    ]
    assert first.paragraphs[1:] == [
        "The rule reads\n\n$$y = x + x .$$",
        "**It is linear.** So there.",
    ]
    assert [piece.source for piece in first.figures] == ["draw()"]


def test_a_deck_has_title_goals_ideas_formula_figure_exercises_and_summary(small):
    deck = deck_text(small, {"draw()": "07_small-0.png"}, str)
    heads = re.findall(r"^#+ .+$", deck, flags=re.MULTILINE)
    assert heads == [
        "# A small chapter",
        "## You will be able to",
        "## What is doubling?",
        "### What is doubling?",
        "### What is doubling?",
        "## Exercises",
        "### Twice",
        "## Summary",
    ]
    idea = deck.split("\n## What is doubling?")[1].split("````")[0]
    assert "The rule reads\n\n$$y = x + x .$$" in deck
    assert idea.startswith("\n\nDoubling adds a number to itself. It is older than $x^2$,")
    assert idea.endswith("\n\n- **It is linear.**\n\n")
    assert "So there." in deck  # the speaker has it
    assert "```{image} 07_small-0.png\n:alt: A line through the origin\n```\n\n*Twice as" in deck
    assert "1. Twice (1 mark)" in deck
    assert "draw()" not in deck


def test_the_solution_is_in_the_speakers_notes_alone(small):
    deck = deck_text(small, {}, str)
    notes = re.findall(r"````\{revealjs-notes\}\n(.*?)````", deck, flags=re.DOTALL)
    assert any("Add it to itself" in note for note in notes)
    assert "Add it to itself" not in re.sub(r"````.*?````", "", deck, flags=re.DOTALL)
    assert "{image}" not in deck  # nothing was drawn


def test_decks_of_the_book(book):
    for chapter in book:
        drawn = {
            p.source: "a.png" for p in chapter.pieces if "image" in p.metadata.get("mystnb", {})
        }
        deck = deck_text(chapter, drawn, str)
        shown = re.sub(r"````.*?````", "", deck, flags=re.DOTALL)
        slides = re.split(r"^#{1,3} ", shown, flags=re.MULTILINE)[1:]
        assert 12 <= len(slides) <= 60
        assert deck.count("```{image}") >= 2
        longest = max(slides, key=len)
        assert len(longest) < 1500, longest
