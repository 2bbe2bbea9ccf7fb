"""The notebooks run from top to bottom, and what they print is finite.

Small by default; `JAXSPH_FULL=1 pytest tests/test_notebooks.py` runs them at the size that they speak of.
"""

import os
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def lanes(path):
    """A notebook, in the slow lane but for the first, which shows that they run."""
    return pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem > "02"))


@pytest.mark.parametrize("path", [lanes(path) for path in NOTEBOOKS])
def test_notebook_runs(path):
    notebook = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "commit notebooks without outputs"
    NotebookClient(
        notebook, timeout=7200 if os.environ.get("JAXSPH_FULL") else 300, kernel_name="python3"
    ).execute()
    printed = "".join(
        str(output.get("text", "")) + str(output.get("data", {}).get("text/plain", ""))
        for cell in notebook.cells
        for output in cell.get("outputs", ())
    )
    print(printed)
    assert any(c.isdigit() for c in printed) and "nan" not in printed.lower()
