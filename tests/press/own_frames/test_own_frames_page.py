"""The example of the page "Your own frames", as it stands there."""

import json
import re
import shlex
from pathlib import Path

from hadr.cli import main

PAGE = Path(__file__).resolve().parents[3] / "book" / "own_frames.md"


def test_the_first_example_gives_what_the_page_promises(tmp_path, monkeypatch):
    page = PAGE.read_text(encoding="utf-8")
    made, called = (
        re.search(rf"```{kind}\n(.+?)```", page, flags=re.DOTALL)[1] for kind in ("python", "bash")
    )
    monkeypatch.chdir(tmp_path)
    exec(compile(made, "own_frames.md", "exec"), {})
    restore, view = called.replace("\\\n", "").strip().splitlines()
    assert main(shlex.split(restore)[1:]) == 0
    report = json.loads((tmp_path / "restored" / "report.json").read_text())
    promised = re.search(r"It restores all of the ([\d,]+) pixels of the glass, with a prob", page)
    assert report["counts"]["restored"] == int(promised[1].replace(",", ""))
    assert report["counts"]["mask"] == report["counts"]["restored"]
    assert report["ground"]["inside"] is True, report["notes"]
    assert main([*shlex.split(view)[1:], "--no-browser"]) == 0
    other = restore.replace("hand/0001", "hand/0000")
    assert main([*shlex.split(other)[1:], "--out", "other"]) == 0
    notes = " ".join(json.loads((tmp_path / "other" / "report.json").read_text())["notes"])
    (reason,) = re.findall(r'says why: "(.+?)"', page.replace("\n", " "))
    assert reason in notes
