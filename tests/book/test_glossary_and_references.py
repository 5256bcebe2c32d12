"""Terms and works: each explained once, and placed."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BOOK = ROOT / "book"
#: What the paper cites, by its own keys, and the keys of this book's bibliography.
CITED_BY_THE_PAPER = {
    "blender2018": "blender",
    "chen2023tode": "chen2023tode",
    "christen2023learning": "christen2023handovers",
    "dai2022domain": "dai2022dreds",
    "dai2023graspnerf": "dai2023graspnerf",
    "fang2020graspnet": "fang2020graspnet",
    "fang2022transcg": "fang2022transcg",
    "he2016deep": "he2016resnet",
    "he2017mask": "he2017mask",
    "huang2020awr": "huang2020awr",
    "ichnowski2021dex": "ichnowski2021dexnerf",
    "jiang2023robotic": "jiang2023review",
    "liu2021swin": "liu2021swin",
    "lugaresi2019mediapipe": "lugaresi2019mediapipe",
    "manusmeta2024": "manus",
    "miller2004graspit": "miller2004graspit",
    "mousavian20196": "mousavian2019graspnet6dof",
    "nvidiaOmniverse": "omniverse",
    "phillips2016seeing": "phillips2016glassware",
    "qi2017pointnet": "qi2017pointnet",
    "sajjan2020clear": "sajjan2020cleargrasp",
    "vaswani2017attention": "vaswani2017attention",
    "yang2021reactive": "yang2021reactive",
    "yu2023tgf": "yu2023tgfnet",
    "yuan2018pcn": "yuan2018pcn",
    "ze20243d": "ze2024dp3",
    "zhou2018voxelnet": "zhou2018voxelnet",
    "zhu2021rgb": "zhu2021lidf",
}
#: Whose entries could not be established beyond doubt; the page says so.
LEFT_OUT = {"albrecht2013seeing", "weber2022mixed"}


def entries():
    text = (BOOK / "references.bib").read_text(encoding="utf-8")
    return dict(re.findall(r"^@\w+\{([^,]+),\n(.*?)^\}", text, re.DOTALL | re.MULTILINE))


def lines_of_the_page():
    """Key to the line that explains it."""
    page = (BOOK / "references.md").read_text(encoding="utf-8")
    found = {}
    for item in re.findall(r"^- (.*?)(?=^- |^#|^\n)", page, re.DOTALL | re.MULTILINE):
        for key in re.findall(r"\{cite:t\}`([^`]+)`", item):
            assert key not in found, f"{key} is listed twice"
            found[key] = " ".join(item.split())
    return found


def test_every_work_has_authors_a_title_and_a_line():
    works = entries()
    assert works
    for key, text in works.items():
        for field in ("author", "title"):
            assert re.search(rf"^ +{field} += ", text, re.MULTILINE), f"{key} lacks {field}"
    assert set(lines_of_the_page()) == set(works)
    assert all(len(line.split()) >= 8 for line in lines_of_the_page().values())


def test_every_work_of_the_paper_is_there_and_marked():
    lines = lines_of_the_page()
    for theirs, ours in CITED_BY_THE_PAPER.items():
        assert "†" in lines[ours], f"{ours} ({theirs} in the paper) is not marked"
    marked = {key for key, line in lines.items() if "†" in line}
    assert marked == set(CITED_BY_THE_PAPER.values())


def test_the_list_is_the_papers_own():
    source = ROOT.parent / "shared" / "paper" / "hadr_paper.tex"
    if not source.is_file():
        pytest.skip("put the paper's LaTeX text at ../shared/paper/hadr_paper.tex to compare")
    cited = set()
    for keys in re.findall(r"\\cite\{([^}]+)\}", source.read_text(encoding="utf-8")):
        cited |= {key.strip() for key in keys.split(",")}
    assert cited == set(CITED_BY_THE_PAPER) | LEFT_OUT


def glossary():
    """Terms (several may share an entry) to their explanation."""
    text = (BOOK / "glossary.md").read_text(encoding="utf-8")
    body = re.search(r"^```\{glossary\}\n:sorted:\n\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    found = {}
    for entry in body.group(1).strip().split("\n\n"):
        lines = entry.split("\n")
        terms = [line for line in lines if not line.startswith("  ")]
        told = " ".join(line.strip() for line in lines if line.startswith("  "))
        assert terms
        assert told, entry
        for term in terms:
            assert term not in found, f"{term} is explained twice"
            found[term] = told
    return found


def test_terms_are_explained_in_one_to_three_sentences_and_placed():
    terms = glossary()
    assert len(terms) >= 45
    for term, told in terms.items():
        assert re.search(r"\]\((notebooks/\d\d_\w+\.ipynb|#hadr\.[\w.]+|running\.md)\)", told), term
        plain = re.sub(r"\[[^]]*\]\([^)]*\)", "", told)
        assert 6 <= len(plain.split()) <= 60, term


def test_chapters_link_terms_and_modules_that_exist():
    """Such links are plain Markdown, so a bare notebook shows their words and nothing else."""
    terms = set(glossary())
    linked = set()
    for path in sorted((ROOT / "notebooks" / "text").glob("*.md")):
        text = path.read_text(encoding="utf-8")
        targets = re.findall(r"\]\(<#([^>]+)>\)", text)
        targets += [t for t in re.findall(r"\]\(#([a-z0-9 -]+)\)", text) if t in terms]
        assert set(targets) <= terms, path.name
        linked |= set(targets)
        assert "{term}" not in text, path.name
        (line,) = re.findall(r"^\*\*In the library:\*\* (.+)$", text, re.MULTILINE)
        modules = re.findall(r"\[`(hadr[\w.]+)`\]\(#(hadr[\w.]+)\)", line)
        assert modules
        for shown, target in modules:
            assert shown == target
            stem = ROOT.joinpath(*target.split("."))
            assert stem.with_suffix(".py").is_file() or stem.is_dir(), target
    assert len(linked) >= 15
