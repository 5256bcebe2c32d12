"""A link's picture has the whole address of where the book is published, or there is none."""

from types import SimpleNamespace

import pytest


@pytest.mark.parametrize(
    ("setting", "environment", "base"),
    [
        ("", {}, None),
        ("https://a.example/book", {}, "https://a.example/book"),
        ("", {"HADR_BOOK_URL": "https://b.example/"}, "https://b.example"),
        ("", {"READTHEDOCS_CANONICAL_URL": "https://c.example/en/"}, "https://c.example/en"),
        ("https://a.example/", {"HADR_BOOK_URL": "https://b.example/"}, "https://a.example"),
    ],
)
def test_a_links_picture_is_absolute_or_absent(extension, monkeypatch, setting, environment, base):
    for name in ("HADR_BOOK_URL", "READTHEDOCS_CANONICAL_URL"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(extension.std, "make_id", extension.std.make_id)  # put back afterwards
    hooks = {}
    config = SimpleNamespace(html_baseurl=setting, root_doc="index")
    app = SimpleNamespace(config=config, connect=hooks.__setitem__)
    extension.setup(app)
    hooks["config-inited"](app, config)
    context = {"title": "A title"}
    hooks["html-page-context"](app, "notebooks/03", "page.html", context, None)
    told = f'<meta property="og:image" content="{base}/_images/restored_frame.png" />'
    assert (told in context["metatags"]) == (base is not None)
    assert ("og:image" in context["metatags"]) == (base is not None)
