"""Notebooks run from top to bottom in a fresh kernel, are kept without output, and become pages."""

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

pytest.importorskip("nbconvert", reason="needs the extra 'notebook': pip install '.[notebook]'")
nbformat = pytest.importorskip("nbformat", reason="needs the extra 'notebook': pip install '.[notebook]'")
pytest.importorskip("ipykernel", reason="needs the extra 'notebook': pip install '.[notebook]'")

from notebooks import __main__ as notebooks  # noqa: E402

NOTEBOOKS = sorted((Path(__file__).parents[2] / "notebooks").glob("*.ipynb"))
TOUR = "01_tour"
"""The others are run by `make notebooks`, which takes some minutes."""

each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def notebook_of(folder: Path, *sources: str) -> Path:
    """A notebook with these cells."""
    cells = [nbformat.v4.new_code_cell(source) for source in sources]
    cells.append(nbformat.v4.new_markdown_cell("# What is six times seven?\n\n![a picture](../images/made.png)"))
    for name in ("images", "notebooks"):
        (folder / name).mkdir(exist_ok=True)
    Image.new("RGB", (2, 2)).save(folder / "images" / "made.png")
    nbformat.write(nbformat.v4.new_notebook(cells=cells), folder / "notebooks" / "made.ipynb")
    return folder / "notebooks" / "made.ipynb"


def test_there_are_notebooks_on_every_subject() -> None:
    """A friction of the first hour: one notebook, without scheduling, choice of planners, training or debugging."""
    subjects = ("tour", "planners", "scheduling", "arms", "training", "debugging")
    assert [path.stem for path in NOTEBOOKS] == [f"{k:02}_{name}" for k, name in enumerate(subjects, start=1)]


def test_the_tour_runs() -> None:
    notebook = notebooks.execute(next(path for path in NOTEBOOKS if path.stem == TOUR))
    assert all(cell.execution_count for cell in notebook.cells if cell.cell_type == "code")


@each_notebook
def test_a_notebook_is_kept_without_output(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.source for cell in cells if cell.outputs or cell.execution_count is not None] == []


@each_notebook
def test_a_notebook_is_on_its_page_of_the_guide(path: Path, repository: Path) -> None:
    assert f"notebooks/{path.name})" in (repository / "docs" / "guide" / "notebooks.md").read_text(encoding="utf-8")


def test_a_page_has_what_cells_show(tmp_path: Path) -> None:
    """A friction of the first hour: a notebook without a picture or a table in it."""
    picture = (
        "from fleet.charts.drawing import Dot, Drawing\n"
        "Drawing(width=20, height=10, marks=[Dot(at=(5, 5), color='#123456')])"
    )
    page = notebooks.render(notebook_of(tmp_path, "print(6 * 7)", picture), tmp_path / "out")
    assert page == tmp_path / "out" / "made.html"
    text = page.read_text(encoding="utf-8")
    assert "<pre>42\n</pre>" in text
    assert 'fill="#123456"' in text.split("<pre>42")[1]
    assert "<title>What is six times seven?</title>" in text
    assert 'src="data:image/png;base64,' in text
    assert "<script" not in text


@pytest.mark.parametrize(
    ("sources", "said"),
    [
        (
            ("1 + 1", "undefined"),
            "made.ipynb, cell 1: NameError: name .undefined. is not defined\n(.*\n)*----> 1 undefined",
        ),
        (("import sys; sys.stderr.write('mind the gap')",), "made.ipynb, cell 0: stderr has 'mind the gap'"),
    ],
)
def test_a_cell_that_fails_or_warns_is_named(tmp_path: Path, sources: tuple[str, ...], said: str) -> None:
    with pytest.raises(notebooks.NotebookError, match=rf"(?s){said}"):
        notebooks.execute(notebook_of(tmp_path, *sources))


def test_what_is_no_notebook_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.ipynb").write_text("{")
    with pytest.raises(notebooks.NotebookError, match=r"a\.ipynb: cannot be read"):
        notebooks.execute(tmp_path / "a.ipynb")


def test_a_missing_kernel_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any) -> None:
    monkeypatch.setattr(notebooks, "NEEDED", ("nbformat", "kernel_that_is_not_there"))
    assert notebooks.main(["--out", str(tmp_path / "out")]) == notebooks.REFUSED
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == (
        "notebooks need kernel_that_is_not_there; valid: .venv/bin/python -m pip install --editable '.[notebook]'\n"
    )
    assert not (tmp_path / "out").exists()


def test_a_kernel_that_is_not_there_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notebooks, "KERNEL", "fortran")
    with pytest.raises(notebooks.NotebookError, match=r"made\.ipynb: there is no kernel 'fortran'; valid: .*notebook"):
        notebooks.execute(notebook_of(tmp_path, "1 + 1"))
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler, "Ctrl-C would do nothing from here on"


def test_no_notebook_is_begun_without_its_kernel_or_a_place_for_its_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bad input of the first hour: status 1 for each notebook without a kernel, and a traceback after a run."""
    monkeypatch.setattr(notebooks, "render", lambda *_: pytest.fail("a notebook was begun"))
    (tmp_path / "file").touch()
    for out in (tmp_path / "file", Path("/proc/pages")):
        assert notebooks.main([TOUR, "--out", str(out)]) == notebooks.REFUSED
        said = capsys.readouterr()
        assert (said.out, said.err.count("\n")) == ("", 1)
        assert said.err.startswith(f"--out {out}")
        assert "valid: a directory that can be written" in said.err
    monkeypatch.setattr(notebooks, "KERNEL", "fortran")
    assert notebooks.main(["--out", str(tmp_path / "out")]) == notebooks.REFUSED
    assert capsys.readouterr().err.startswith("there is no kernel 'fortran'; valid: ")
    assert not (tmp_path / "out").exists()


def test_the_command_names_the_notebooks_that_there_are(repository: Path) -> None:
    found = subprocess.run(
        [sys.executable, "-m", "notebooks", "02_planer"], cwd=repository, capture_output=True, text=True, check=False
    )
    assert (found.returncode, found.stdout) == (notebooks.REFUSED, "")
    names = ", ".join(path.stem for path in NOTEBOOKS)
    assert found.stderr == f"there is no notebook '02_planer'; valid: {names}\n"
