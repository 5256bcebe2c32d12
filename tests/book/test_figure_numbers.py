"""A chapter has its file's number; elsewhere figures and tables are counted page by page."""

from types import SimpleNamespace

from docutils import nodes
from docutils.utils import new_document


def test_pages_without_a_number_begin_with_figure_1(extension):
    numbers = {
        "index": {"figure": {"a": (1,)}},
        "chapter": {"figure": {"c": (3, 1), "d": (3, 2)}, "table": {}},
        "page": {"figure": {"late": (12,), "early": (2,)}, "table": {"t": (4,)}},
    }
    extension.restart(numbers)
    assert numbers == {
        "index": {"figure": {"a": (1,)}},
        "chapter": {"figure": {"c": (3, 1), "d": (3, 2)}, "table": {}},
        "page": {"figure": {"late": (2,), "early": (1,)}, "table": {"t": (1,)}},
    }


def test_a_chapter_has_the_number_in_its_file_name(extension):
    counted = {"notebooks/00_a": [1], "notebooks/09_b": [1, 2], "page": [3]}
    env = SimpleNamespace(
        toc_secnumbers={page: {"": tuple(n), "#x": None} for page, n in counted.items()},
        titles={page: nodes.title(secnumber=n) for page, n in counted.items()},
        tocs={
            page: nodes.paragraph("", "", nodes.reference(secnumber=n), nodes.reference())
            for page, n in counted.items()
        },
    )
    extension.number_chapters(env)
    for page, number in {"notebooks/00_a": [0], "notebooks/09_b": [9, 2], "page": [3]}.items():
        assert env.toc_secnumbers[page] == {"": tuple(number), "#x": None}
        assert env.titles[page]["secnumber"] == env.tocs[page][0]["secnumber"] == number
        assert env.tocs[page][1].get("secnumber") is None


def test_an_html_table_with_a_caption_is_counted(extension):
    document = new_document("page")
    with_caption = (
        '<table class="table wide">\n<caption>It&#39;s seen.</caption>\n<tr></tr>\n</table>\n'
    )
    others = "<table><tr></tr></table>", "<p>no table</p>"
    document += [nodes.raw("", text, format="html") for text in (with_caption, *others)]
    extension.count_html_tables(document)
    table, *left = document.children
    assert isinstance(table, nodes.table)
    assert (table["classes"], bool(table["ids"])) == (["table", "wide"], True)
    assert [child.astext() for child in table] == ["It's seen.", "\n<tr></tr>\n"]
    assert tuple(raw.astext() for raw in left) == others
