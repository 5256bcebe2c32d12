import pytest

from hadr.press.course.chapter import (
    hints,
    plain_markdown,
    read_chapter,
    short_citations,
)

BIBLIOGRAPHY = r"""@article{one,
  author  = {Doll{\'a}r, Piotr},
  year    = {2017}
}

@inproceedings{two,
  author = {Zhou, Yin and Tuzel, Oncel},
  year = 2018,
}

@misc{many,
  author = {Yu, Ran and Yu, Haixin and Li, Shoujie},
  year   = {2024},
}
"""


def test_a_chapter_is_taken_apart(small):
    assert (small.name, small.number, small.title) == ("07_small", 7, "A small chapter")
    assert small.goals == ("double a number, and say what comes out", "stop")
    (exercise,) = small.exercises
    assert (exercise.label, exercise.title) == ("ex-07-1", "Twice")
    assert exercise.question.startswith("What is twice three?")
    assert "{" not in exercise.question.replace("{cite}", "")
    assert exercise.answer == "three = 3\nanswer = ..."
    assert exercise.check.endswith("wrong=hints)")
    assert exercise.words == "Add it to itself."
    assert [cell.splitlines()[0] for cell in exercise.solution] == [
        "def twice(x):",
        "print('doubling')",
    ]
    kinds = [piece.kind for piece in small.pieces if piece.label]
    assert kinds == ["question", "answer", "check", "solution", "solution", "solution"]
    assert [piece.source for piece in small.pieces if piece.kind == "code"][-1] == "last = 1"
    assert all("```" not in piece.source for piece in small.pieces)


def test_hints_are_read_without_running_the_check(small):
    assert hints(small.exercises[0]) == ("That is the square; the answer is larger than answer=3.",)


def test_hints_may_have_names_and_stand_in_the_call(small_notebook):
    def change(cells):
        cells[
            7
        ].source = 'word = "Half of it."\ncheck(answer, 6, wrong=[(3, word), (5, "One less.")])'

    assert hints(read_chapter(small_notebook(change)).exercises[0]) == ("Half of it.", "One less.")


@pytest.mark.parametrize("listed", ["[3]", "[(3, 4)]", '[(3, "a", "b")]', "[(3, str(3))]"])
def test_hints_that_cannot_be_read_are_named(small_notebook, listed):
    def change(cells):
        cells[7].source = f"check(answer, 6, wrong={listed})"

    with pytest.raises(ValueError, match="ex-07-1: wrong= must list pairs"):
        hints(read_chapter(small_notebook(change)).exercises[0])


@pytest.mark.parametrize(
    ("cell", "source", "words"),
    [
        (0, "# Title alone", "no list under"),
        (0, "**You will be able to**\n\n- stop.\n", "has no title"),
        (7, "answer == 6", "the check cell of ex-07-1 must end with check"),
        (10, "print(6)", "the solution of ex-07-1 must end with check"),
        (10, "", "the solution of ex-07-1 must end with check"),
    ],
)
def test_what_is_missing_is_named(small_notebook, cell, source, words):
    def change(cells):
        cells[cell].source = source

    with pytest.raises(ValueError, match=words):
        read_chapter(small_notebook(change))


def test_an_exercise_without_check_or_label_is_named(small_notebook):
    with pytest.raises(ValueError, match="the exercise ex-07-1 has no check"):
        read_chapter(small_notebook(lambda cells: cells.pop(7)))
    with pytest.raises(ValueError, match="'Twice' has no label"):
        read_chapter(
            small_notebook(
                lambda cells: cells[5].update(
                    source=cells[5].source.replace(":label: ex-07-1\n", "")
                )
            )
        )


def test_every_chapter_of_the_book_can_be_read(book):
    assert len(book) >= 12
    for chapter in book:
        assert 2 <= len(chapter.goals) <= 8
        assert 2 <= len(chapter.exercises) <= 5


def test_roles_become_words_and_links():
    names = short_citations(BIBLIOGRAPHY)
    told = lambda text: plain_markdown(text, names, "https://example.org/book")  # noqa: E731
    assert told("{cite}`one` and {cite:t}`two, many`") == (
        "(Dollar, 2017) and (Zhou and Tuzel, 2018; Yu et al., 2024)"
    )
    assert told("[x](../ledger.md#row-3)") == "[x](https://example.org/book/ledger.md#row-3)"
    assert told("[y](03_a.ipynb) $x$ `code`") == "[y](03_a.ipynb) $x$ `code`"
    assert told("{doc}`03_a`, {doc}`this <03_a>`, {doc}`../ledger`") == (
        "[03_a](03_a.ipynb), [this](03_a.ipynb), [ledger](https://example.org/book/ledger.md)"
    )
    table = (
        ":::{table} What it {cite}`one` is.\n:name: table-a\n\n| a |\n|---|\n| 1 |\n:::\n\nText."
    )
    assert told(table) == "*What it (Dollar, 2017) is.*\n\n| a |\n|---|\n| 1 |\n\n\nText."
    assert told("(compare {numref}`table-a`)") == "(compare the table)"
    assert told("{numref}`table-a` is. {numref}`table-b`, too") == "The table is. The table, too"


def test_links_within_the_book_lead_to_its_pages_or_are_words():
    told = lambda text: plain_markdown(text, {}, "https://example.org/book")  # noqa: E731
    assert told("[row 6](#ledger-6)") == "[row 6](https://example.org/book/ledger.md)"
    assert told("a [sign test](<#sign test>)") == (
        "a [sign test](https://example.org/book/glossary.md)"
    )
    assert told("[above](#worth-of-parts), [`hadr.a`](#hadr.a)") == "above, `hadr.a`"
    assert told("(worth-of-parts)=\n## What") == "## What"
    assert told("## Ask\n\n% Of Jupyter.\n\nText.") == "## Ask\n\nText."


def test_no_role_of_the_book_is_left(root):
    names = short_citations((root / "book" / "references.bib").read_text(encoding="utf-8"))
    for path in sorted((root / "notebooks" / "text").glob("*.md")):
        for line in path.read_text(encoding="utf-8").splitlines():
            if not line.startswith(("```", "print", " ")):
                told = plain_markdown(line, names, "https://example.org")
                assert "}`" not in told.replace("{frame}`", "")
                assert "](../" not in told
