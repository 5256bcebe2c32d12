"""Launch links open a notebook that exists at that path in the repository."""

import os
import re
import subprocess
import tomllib
import urllib.parse
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def repository():
    return yaml.safe_load((ROOT / "book" / "_config.yml").read_text(encoding="utf-8"))["repository"]


def links_of(page):
    return re.findall(r'href="(https://[^"]+)"', page.read_text(encoding="utf-8"))


def notebook_path(link, repository):
    """The path in the repository that a launch link opens, or None for other links."""
    parts = urllib.parse.urlsplit(link.replace("&amp;", "&"))
    name = repository["url"].removeprefix("https://github.com/")
    branch = repository["branch"]
    if parts.netloc.startswith("colab."):
        beginning = f"/github/{name}/blob/{branch}/"
    elif parts.netloc.startswith("mybinder."):
        beginning = f"/v2/gh/{name}/{branch}"
    else:
        return None
    assert parts.path.startswith(beginning), f"{link} names another repository or branch"
    if parts.netloc.startswith("colab."):
        return parts.path.removeprefix(beginning)
    wish = urllib.parse.parse_qs(parts.query)["urlpath"][0]
    return wish.removeprefix("lab/tree/")


def test_each_chapter_has_both_launch_links_and_they_fit(html, repository):
    chapters = sorted((html / "notebooks").glob("*.html"))
    assert chapters
    for page in chapters:
        paths = [notebook_path(link, repository) for link in links_of(page)]
        launched = [path for path in paths if path is not None]
        assert set(launched) == {f"notebooks/{page.stem}.ipynb"}, page.name
        assert len(launched) >= 2, f"{page.name} lacks Colab or Binder"
        assert (ROOT / launched[0]).is_file()


def test_the_address_stands_in_one_place(repository):
    """Whoever forks the project changes one line; `make notebooks` writes it into the notebooks."""
    name = repository["url"].removeprefix("https://")
    skipped = {".git", "build", "__pycache__", "node_modules"}
    holders = []
    for pattern in ("*.md", "*.toml", "*.yml", "*.cff", "*.py", "*.txt", "*.html"):
        for path in ROOT.rglob(pattern):
            parts = path.relative_to(ROOT).parts
            if any(part in skipped or part.startswith(".venv") for part in parts):
                continue
            if name in path.read_text(encoding="utf-8", errors="replace"):
                holders.append("/".join(parts))
    assert holders == ["book/_config.yml"]


def test_pages_name_no_host_of_scripts(html):
    """Thebe and other live code would load its scripts from elsewhere."""
    for page in sorted(html.rglob("*.html")):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"<(script|link)[^>]+(src|href)=\"(https?:)?//[^\"]+\.(js|css)", text)
        assert "thebe" not in text.lower() or page.name == "running.html", page.name


def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_binder_takes_a_pytorch_without_gpu_libraries():
    """Of conda-forge, as pip's own wheel brings them; and nothing else but Python and pip."""
    text = (ROOT / "binder" / "environment.yml").read_text(encoding="utf-8")
    content = yaml.safe_load(text)
    assert content["channels"] == ["conda-forge", "nodefaults"]
    (torch,) = [line for line in project()["dependencies"] if line.startswith("torch>")]
    python = project()["requires-python"].removeprefix(">=")
    wanted = {f"python={python}", "pip", torch.replace("torch", "pytorch-cpu")}
    assert set(content["dependencies"]) == wanted
    assert {path.name for path in (ROOT / "binder").iterdir()} == {"environment.yml", "postBuild"}


def test_binder_installs_the_pinned_versions_and_leaves_pytorch_alone(tmp_path):
    """postBuild in the repository's root, with a Python that notes what it is asked for."""
    python = tmp_path / "bin" / "python"
    python.parent.mkdir()
    python.write_text(
        '#!/bin/sh\nif [ "$1" = -c ]; then echo 2.99.1.post3; exit; fi\n'
        'printf "%s\\n" "$@" >"$NOTED/words"\n'
        'while [ "$1" != -c ]; do shift; done\ncp "$2" "$NOTED/pins"\n'
    )
    python.chmod(0o755)
    script = ROOT / "binder" / "postBuild"
    assert os.access(script, os.X_OK)
    path = f"{python.parent}{os.pathsep}{os.environ['PATH']}"
    settings = {**os.environ, "PATH": path, "NOTED": str(tmp_path)}
    subprocess.run([str(script)], cwd=ROOT, env=settings, check=True)

    words = (tmp_path / "words").read_text().split()
    assert words[:3] == ["-m", "pip", "install"]
    extras = set(re.fullmatch(r"\.\[(.+)\]", words[words.index("-e") + 1])[1].split(","))
    assert {"book", "handover", "generate"} <= extras <= set(project()["optional-dependencies"])
    pins = (tmp_path / "pins").read_text().splitlines()
    ours = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    changed = [(old, new) for old, new in zip(ours, pins, strict=True) if old != new]
    assert [new for _, new in changed] == ["torch==2.99.1.post3"]
    assert [old.partition("==")[0] for old, _ in changed] == ["torch"]
