"""The notebooks of docs/notebooks run from the first cell to the last, as Jupyter runs them."""

from __future__ import annotations

import os
from pathlib import Path

import nbformat
import pytest
from doc_pages import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
LIMIT_S = 240
"""A cell that takes longer hangs."""


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_valid_and_is_stored_without_results(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert notebook.cells[0].source.startswith("# ")
    assert not [cell for cell in notebook.cells if cell.get("outputs")]


@pytest.mark.full
@pytest.mark.timeout(600)
@pytest.mark.filterwarnings("default")
@pytest.mark.usefixtures("ros_domain")  # one of them starts a sweep
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from nbclient import NotebookClient

    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("JUPYTER_PATH", str(Path(os.sys.prefix) / "share" / "jupyter"))
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=LIMIT_S, resources={"metadata": {"path": str(tmp_path)}}).execute()
    last = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in last)
    assert any("image/png" in output.get("data", {}) for cell in last for output in cell.outputs)


def test_every_notebook_is_on_the_page() -> None:
    page = (ROOT / "docs" / "desk.md").read_text()
    assert NOTEBOOKS
    assert [path.name for path in NOTEBOOKS if f"(notebooks/{path.name})" not in page] == []
