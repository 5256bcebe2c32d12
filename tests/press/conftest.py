"""Small chapters: one that works and one that fails."""

import nbformat
import pytest

PARAMETERS = "preset: str = 'x'\nseed: int = 9\nout_dir: str = ''"
RESULTS = """from hadr.records.provenance import write_results
kept = write_results(out_dir, "00_good", {"seed": seed, "preset": preset})"""


@pytest.fixture
def notebook_of():
    """Makes a notebook with a title and parameters of some code cells."""

    def make(*sources):
        first = nbformat.v4.new_code_cell(PARAMETERS, metadata={"tags": ["parameters"]})
        cells = [nbformat.v4.new_markdown_cell("# Title"), first]
        cells += [nbformat.v4.new_code_cell(source) for source in sources]
        return nbformat.v4.new_notebook(cells=cells)

    return make


@pytest.fixture
def folder(notebook_of, tmp_path):
    """A folder with 00_good.ipynb, which writes results, and 01_bad.ipynb."""
    nbformat.write(notebook_of("1 + 1", RESULTS), tmp_path / "00_good.ipynb")
    bad = notebook_of("value = 'before'\nprint(value)", "ratio = 1 / 0", "never = 1")
    nbformat.write(bad, tmp_path / "01_bad.ipynb")
    return tmp_path
