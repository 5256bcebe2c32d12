import re

from hadr.press.course.deck import deck_text, sections_of, sentences

MARKS = {"ex-07-1": 2}


def test_sentences():
    assert sentences("It is $x. Y$ here. `a. B` there: Two. **Bold. Words** end (see. This).") == [
        "It is $x. Y$ here.",
        "`a. B` there:",
        "Two.",
        "**Bold. Words** end (see. This).",
    ]
    assert sentences("One, e.g. this.") == ["One, e.g. this."]


def test_sections(small):
    first, second, last = sections_of(small)
    assert [s.heading for s in (first, second, last)] == [
        "What is doubling?",
        "Exercises",
        "Summary",
    ]
    assert first.formulas == [("The rule reads", "$$y = x + x .$$")]
    assert [piece.source for piece in first.figures] == ["draw()"]
    assert not any("$$" in paragraph for paragraph in first.paragraphs)


def test_a_deck_has_title_goals_ideas_formula_figure_exercises_and_summary(small):
    deck = deck_text(small, {"draw()": "07_small-0.png"}, MARKS, str)
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
    assert "- Doubling adds a number to itself." in idea
    assert "- **It is linear.** So there." in idea
    assert "A third sentence" not in idea  # but the speaker has it
    assert "A third sentence" in deck
    assert "```{image} 07_small-0.png\n:alt: A line through the origin\n```" in deck
    assert "1. Twice (2 marks)" in deck
    assert "draw()" not in deck


def test_the_solution_is_in_the_speakers_notes_alone(small):
    deck = deck_text(small, {}, MARKS, str)
    notes = re.findall(r"````\{revealjs-notes\}\n(.*?)````", deck, flags=re.DOTALL)
    assert any("Add it to itself" in note for note in notes)
    assert "Add it to itself" not in re.sub(r"````.*?````", "", deck, flags=re.DOTALL)
    assert "{image}" not in deck  # nothing was drawn


def test_decks_of_the_book(book):
    for chapter in book:
        drawn = {
            p.source: "a.png" for p in chapter.pieces if "image" in p.metadata.get("mystnb", {})
        }
        marks = {exercise.label: 2 for exercise in chapter.exercises}
        deck = deck_text(chapter, drawn, marks, str)
        shown = re.sub(r"````.*?````", "", deck, flags=re.DOTALL)
        slides = re.split(r"^#{1,3} ", shown, flags=re.MULTILINE)[1:]
        assert 12 <= len(slides) <= 60
        assert deck.count("```{image}") >= 2
        longest = max(slides, key=len)
        assert len(longest) < 1500, longest
