from pathlib import Path

import nbformat
import pytest

from hadr.press.course.chapter import read_chapter, read_chapters

ROOT = Path(__file__).resolve().parents[3]

QUESTION = """## Exercises

```{exercise-start} Twice
:label: ex-07-1
```
What is twice three? See {cite}`someone` and [the ledger](../ledger.md).
```{exercise-end}
```"""
SOLUTION = """```{solution-start} ex-07-1
:class: dropdown
```
Add it to itself.
"""
CHECK = """hints = [
    (9, "That is the square; the answer is larger than answer=3."),
]
check(answer, 6,
      wrong=hints)"""
INTRODUCTION = """# A small chapter

It has one exercise.

**You will be able to**

- double a number, and say
  what comes out;
- stop.

**Measured run time:** *stands here in the built book*
"""
IDEA = """## What is doubling?

Doubling adds a number to itself. It is older than $x^2$, e.g. in Egypt. A third sentence.

The rule reads

$$y = x + x .$$

**It is linear.** So there."""


@pytest.fixture
def small_notebook(tmp_path):
    """A chapter with one exercise; `cells` can be changed before it is written."""

    def write(change=lambda cells: None):
        code, text = nbformat.v4.new_code_cell, nbformat.v4.new_markdown_cell
        cells = [
            text(INTRODUCTION),
            code('preset: str = "tiny"\nseed: int = 0', metadata={"tags": ["parameters"]}),
            code("from hadr.press.exercises import check"),
            text(IDEA),
            code(
                "draw()",
                metadata={
                    "mystnb": {
                        "image": {"alt": "A line through the origin"},
                        "figure": {"caption": "Twice as much is twice as high."},
                    }
                },
            ),
            text(QUESTION),
            code("three = 3\nanswer = ..."),
            code(CHECK),
            text(SOLUTION),
            code("def twice(x):\n    return x + x"),
            code("print('doubling')\ncheck(twice(three), 6)"),
            text("```{solution-end}\n```\n\n## Summary\n\nDoubling is linear. Nothing else is."),
            code("last = 1"),
        ]
        change(cells)
        path = tmp_path / "07_small.ipynb"
        nbformat.write(nbformat.v4.new_notebook(cells=cells), path)
        return path

    return write


@pytest.fixture
def small(small_notebook):
    return read_chapter(small_notebook())


@pytest.fixture(scope="session")
def root():
    return ROOT


@pytest.fixture(scope="session")
def book():
    """All chapters."""
    return read_chapters(ROOT)
