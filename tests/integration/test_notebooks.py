"""Notebooks run from top to bottom in a fresh kernel, and are kept without output."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="needs the extra 'notebook': pip install '.[notebook]'")
nbclient = pytest.importorskip("nbclient", reason="needs the extra 'notebook': pip install '.[notebook]'")
pytest.importorskip("ipykernel", reason="needs the extra 'notebook': pip install '.[notebook]'")

NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))
CELL_TIMEOUT_S = 200
"""The first run on a machine compiles kernels and fits the arms' spheres; afterwards a cell takes a second or two."""

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def test_there_are_notebooks() -> None:
    assert NOTEBOOKS


@each_notebook
def test_a_notebook_runs(path: Path, repository: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(
        notebook,
        timeout=CELL_TIMEOUT_S,
        kernel_name="python3",
        resources={"metadata": {"path": str(repository)}},
    )
    client.execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in cells)
    # Anything on stderr is a warning that a reader would stumble over.
    noise = [out.text for cell in cells for out in cell.outputs if out.get("name") == "stderr"]
    assert noise == []


@each_notebook
def test_a_notebook_is_kept_without_output(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.source for cell in cells if cell.outputs or cell.execution_count is not None] == []
