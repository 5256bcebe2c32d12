from hadr.press.course.plain_text import plain_markdown, short_citations

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


def test_short_citations():
    assert short_citations(BIBLIOGRAPHY) == {
        "one": "Dollar, 2017",
        "two": "Zhou and Tuzel, 2018",
        "many": "Yu et al., 2024",
    }


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


def test_no_role_of_the_book_is_left(root):
    names = short_citations((root / "book" / "references.bib").read_text(encoding="utf-8"))
    for path in sorted((root / "notebooks" / "text").glob("*.md")):
        for line in path.read_text(encoding="utf-8").splitlines():
            if not line.startswith(("```", "print", " ")):
                told = plain_markdown(line, names, "https://example.org")
                assert "}`" not in told.replace("{frame}`", "")
                assert "](../" not in told
