"""The notebooks run from top to bottom, and the outputs that are committed are those of one whole run.

The tests run a coarse, short version, `JAXSPH_QUICK`. `jupyter execute --inplace notebooks/*.ipynb` runs the
notebooks as they are and writes their outputs, which are committed.
"""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def lanes(path):
    """A notebook as a parameter; all but the first are in the slow lane."""
    return pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem > "02"))


def printed(notebook):
    """All text that the cells printed."""
    return "".join(
        str(output.get("text", "")) + str(output.get("data", {}).get("text/plain", ""))
        for cell in notebook.cells
        for output in cell.get("outputs", ())
    )


@pytest.mark.parametrize("path", [lanes(path) for path in NOTEBOOKS])
def test_notebook_runs(path, monkeypatch):
    monkeypatch.setenv("JAXSPH_QUICK", "1")
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    print(text := printed(notebook))
    assert any(c.isdigit() for c in text) and "nan" not in text.lower()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_committed_outputs_are_of_one_whole_run_with_pictures(path):
    notebook = nbformat.read(path, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error"]
    assert not [output for output in outputs if output.get("name") == "stderr"], (
        "warnings are not for readers"
    )
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert "/" + "home/" not in str(outputs) and "/tmp" not in str(outputs) and "/work" not in str(outputs)
    assert "nan" not in printed(notebook).lower()
