"""Executes the notebooks in kernels of their own and writes what they show as HTML: python -m notebooks [NAME ...]."""

from __future__ import annotations

import argparse
import importlib.util
import re
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fleet.whole_file import require_place, write_whole

HERE = Path(__file__).parent
OUT = Path("build") / "notebooks"
CELL_TIMEOUT_S = 300
"""The first run on a machine compiles kernels and fits the arms' spheres; afterwards a cell takes some seconds."""
NEEDED = ("ipykernel", "nbclient", "nbconvert", "nbformat")
CURE = ".venv/bin/python -m pip install --editable '.[notebook]'"
KERNEL = "python3"
"""The kernel of the Python that runs this, which ipykernel brings."""
DONE, FAILED, REFUSED = 0, 1, 2
_PAGE = """{% extends 'lab/index.html.j2' %}
{% block html_head_js %}{% endblock %}
{% block html_head_js_mathjax %}{% endblock %}
{% block html_head_js_mermaidjs %}{% endblock %}
"""
"""The page of JupyterLab without scripts from elsewhere: no notebook has formulas, widgets or diagrams in Mermaid."""
_WRITABLE = "a directory that can be written and has room on its disk"
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_PICTURE_ABOVE = re.compile(r"(!\[[^\]]*\]\()\.\./")
"""A picture of a folder beside that of the notebooks; a page takes in only those below the folder that it is given."""


class NotebookError(Exception):
    """A notebook cannot be run, or does not run as a reader would want it to; says which, where and why."""


def require_kernel() -> None:
    """Refuse to begin without the packages that run notebooks, and their kernel.

    Raises:
        NotebookError: One is missing; says how to install it.
    """
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise NotebookError(f"notebooks need {', '.join(missing)}; valid: {CURE}")
    from jupyter_client.kernelspec import KernelSpecManager, NoSuchKernel

    try:
        KernelSpecManager().get_kernel_spec(KERNEL)
    except NoSuchKernel as error:
        raise NotebookError(f"there is no kernel {KERNEL!r}; valid: {CURE}") from error


def execute(path: Path) -> Any:
    """Run a notebook from top to bottom in a fresh kernel.

    Args:
        path: The .ipynb file.

    Returns:
        The notebook with its outputs.

    Raises:
        NotebookError: It cannot be read; or a cell fails, takes too long or writes to stderr, which is named.
    """
    import nbformat
    from jupyter_client.kernelspec import NoSuchKernel
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError
    from traitlets.config import Config

    try:
        notebook = nbformat.read(path, as_version=4)
    except Exception as error:  # nbformat has a dozen of them
        raise NotebookError(f"{path}: cannot be read ({error}); valid: a notebook") from error
    resources = {"metadata": {"path": str(HERE.parent)}}
    # Sockets of the file system: nobody else on the machine can listen, and no port is opened.
    local = Config({"KernelManager": {"transport": "ipc"}})
    client = NotebookClient(notebook, config=local, timeout=CELL_TIMEOUT_S, kernel_name=KERNEL, resources=resources)
    try:
        with _own_signals():
            client.execute()
    except CellExecutionError as error:
        number, lines = _failure(notebook)
        raise NotebookError("\n".join((f"{path}, cell {number}: {error.ename}: {error.evalue}", *lines))) from error
    except NoSuchKernel as error:
        raise NotebookError(f"{path}: there is no kernel {KERNEL!r}; valid: {CURE}") from error
    except (CellTimeoutError, DeadKernelError) as error:
        raise NotebookError(f"{path}: {' '.join(str(error).split())}") from error
    for k, cell in enumerate(notebook.cells):
        for output in cell.get("outputs", ()):
            # Anything on stderr is a warning that a reader would stumble over.
            if output.get("name") == "stderr":
                raise NotebookError(f"{path}, cell {k}: stderr has {output.text.strip()!r}; valid: none")
    return notebook


@contextmanager
def _own_signals() -> Iterator[None]:
    """Ctrl-C works afterwards as before: a kernel that does not start leaves it to an event loop that has ended."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    woken = signal.set_wakeup_fd(-1)
    try:
        yield
    finally:
        signal.set_wakeup_fd(woken)
        for number, handler in before.items():
            signal.signal(number, handler)


def render(path: Path, out: Path) -> Path:
    """Run a notebook and write it with its outputs as a page that needs no network; returns the path of the page."""
    from jinja2 import DictLoader
    from nbconvert import HTMLExporter

    notebook = execute(path)
    notebook.metadata["title"] = _title(notebook, path.stem)
    page_of = DictLoader({"page.html.j2": _PAGE})
    exporter = HTMLExporter(extra_loaders=[page_of], template_file="page.html.j2", embed_images=True)
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = _PICTURE_ABOVE.sub(r"\1", cell.source)
    page, _ = exporter.from_notebook_node(notebook, resources={"metadata": {"path": str(path.resolve().parents[1])}})
    target = out / f"{path.stem}.html"
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_whole(target, page)
    except OSError as error:
        raise NotebookError(f"{target}: {error.strerror or error}; valid: {_WRITABLE}") from error
    return target


def _title(notebook: Any, name: str) -> str:
    """The first heading of a notebook, else its name."""
    lines = (line for cell in notebook.cells if cell.cell_type == "markdown" for line in cell.source.splitlines())
    return next((line.removeprefix("# ") for line in lines if line.startswith("# ")), name)


def _failure(notebook: Any) -> tuple[int, list[str]]:
    """The cell that failed, and its traceback without colours."""
    for number, cell in enumerate(notebook.cells):
        for output in cell.get("outputs", ()):
            if output.output_type == "error":
                return number, _COLOUR.sub("", "\n".join(output.traceback)).splitlines()
    return -1, []


def main(arguments: Sequence[str] | None = None) -> int:
    """Render the notebooks that are named, or all; returns the exit status."""
    names = sorted(path.stem for path in HERE.glob("*.ipynb"))
    parser = argparse.ArgumentParser(prog="python -m notebooks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"notebooks, default all: {', '.join(names)}")
    parser.add_argument("--out", type=Path, default=OUT, help="directory for the pages (default: %(default)s)")
    told = parser.parse_args(arguments)
    unknown = [name for name in told.names if name not in names]
    try:
        if unknown:
            raise NotebookError(f"there is no notebook {unknown[0]!r}; valid: {', '.join(names)}")
        require_kernel()
        told.out.mkdir(parents=True, exist_ok=True)
        require_place(told.out / "page.html")
    except OSError as error:
        print(f"--out {told.out}: {error.strerror or error}; valid: {_WRITABLE}", file=sys.stderr)
        return REFUSED
    except NotebookError as error:
        print(error, file=sys.stderr)
        return REFUSED
    status = DONE
    for name in told.names or names:
        begin = time.perf_counter()
        try:
            page = render(HERE / f"{name}.ipynb", told.out)
        except NotebookError as error:
            print(error, file=sys.stderr)
            status = FAILED
            continue
        print(f"{page}: {time.perf_counter() - begin:.0f} s", flush=True)
    return status


if __name__ == "__main__":
    sys.exit(main())
