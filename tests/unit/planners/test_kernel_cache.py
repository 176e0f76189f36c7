"""Where kernels are kept: beside the source, in the home directory, where the user says, or else in a safe place."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from planners import kernel_cache

WITHOUT_CAPABILITIES = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"]
"""What takes from root the right to write to everything."""

IMPORT = "import fleet.simulation, numba, os; print(os.environ.get('NUMBA_CACHE_DIR'), numba.config.CACHE_DIR)"


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the directory of temporary files, as this process sees it."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


@pytest.fixture
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make neither source nor home writable, whoever runs the test."""
    home, source = tmp_path / "home", tmp_path / "source"
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv(kernel_cache.VARIABLE, "")  # so that what the test makes of it is undone
    monkeypatch.delenv(kernel_cache.VARIABLE)
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    monkeypatch.setattr(kernel_cache, "__file__", str(source / "planners" / "kernel_cache.py"))
    for folder in (home, source / "planners" / "mapf", source / "fleet"):
        folder.mkdir(parents=True)
    allowed = os.access

    def access(path: str, mode: int) -> bool:
        return allowed(path, mode) and not any(Path(path).is_relative_to(folder) for folder in (home, source))

    monkeypatch.setattr(os, "access", access)


@pytest.mark.usefixtures("nowhere")
def test_where_nothing_can_be_written_kernels_go_to_a_directory_of_this_user_alone(
    temporary: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kernel_cache.provide_kernel_cache()
    folder = Path(os.environ[kernel_cache.VARIABLE])
    assert folder == temporary / f"fleet-kernels-{os.getuid()}"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    said = capsys.readouterr().err
    assert said.startswith("fleet: neither the source tree nor the home directory can be written")
    assert said.count("\n") == 1
    assert str(folder) in said
    kernel_cache.provide_kernel_cache()  # as a child process does, which inherits the variable
    assert (os.environ[kernel_cache.VARIABLE], capsys.readouterr().err) == (str(folder), "")
    del os.environ[kernel_cache.VARIABLE]
    kernel_cache.provide_kernel_cache()  # as the next run does
    assert os.environ[kernel_cache.VARIABLE] == str(folder)


@pytest.mark.usefixtures("nowhere")
@pytest.mark.parametrize("spoilt", ["link", "open", "file"])
def test_a_directory_that_others_can_write_is_not_taken(spoilt: str, temporary: Path, tmp_path: Path) -> None:
    taken = temporary / f"fleet-kernels-{os.getuid()}"
    if spoilt == "link":
        (tmp_path / "theirs").mkdir(mode=0o700)
        taken.symlink_to(tmp_path / "theirs")
    elif spoilt == "open":
        taken.mkdir()
        taken.chmod(0o777)
    else:
        taken.write_text("theirs", encoding="utf-8")
    kernel_cache.provide_kernel_cache()
    folder = Path(os.environ[kernel_cache.VARIABLE])
    assert folder != taken
    assert folder.parent == temporary
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.usefixtures("nowhere", "temporary")
@pytest.mark.parametrize("where", ["XDG_CACHE_HOME", kernel_cache.VARIABLE])
def test_a_directory_that_the_user_names_is_left_to_numba(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    named = str(tmp_path / "named" / "below")
    monkeypatch.setenv(where, named)
    kernel_cache.provide_kernel_cache()
    assert capsys.readouterr().err == ""
    assert os.environ.get(kernel_cache.VARIABLE) == (named if where == kernel_cache.VARIABLE else None)


@pytest.mark.usefixtures("nowhere")
def test_a_named_directory_that_cannot_be_written_is_not_the_end(
    temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(kernel_cache.VARIABLE, str(Path(os.environ["HOME"]) / "kernels"))
    kernel_cache.provide_kernel_cache()
    assert Path(os.environ[kernel_cache.VARIABLE]).parent == temporary


@pytest.fixture
def read_only_tree(tmp_path: Path, repository: Path) -> Iterator[Path]:
    """Return a copy of the source tree without a cache, which not even its owner can write to."""
    tree = tmp_path / "tree"
    for package in ("fleet", "maps", "planners"):
        shutil.copytree(repository / package, tree / package, ignore=shutil.ignore_patterns("__pycache__"))
    folders = [tree, *(path for path in tree.rglob("*") if path.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    yield tree
    for folder in folders:
        folder.chmod(0o755)


@pytest.mark.parametrize("order", ["fleet first", "numba first"])
def test_a_user_who_can_write_neither_source_nor_home_can_load_every_kernel(
    order: str, read_only_tree: Path, tmp_path: Path
) -> None:
    """A friction of the first hour: every import died where nothing could be written."""
    if os.getuid() == 0 and shutil.which("setpriv") is None:
        pytest.skip("root can write to everything, and there is no setpriv to change that")
    home, temporary = tmp_path / "home", tmp_path / "temporary"
    home.mkdir(mode=0o555)
    temporary.mkdir()
    code = IMPORT if order == "fleet first" else f"import numba; {IMPORT}"
    loaded = subprocess.run(
        [*(WITHOUT_CAPABILITIES if os.getuid() == 0 else []), sys.executable, "-c", code],
        cwd=read_only_tree,
        env={
            "PATH": os.environ["PATH"],
            "HOME": str(home),
            "TMPDIR": str(temporary),
            "PYTHONPATH": str(read_only_tree),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    folder = temporary / f"fleet-kernels-{os.getuid()}"
    assert (loaded.returncode, loaded.stdout) == (0, f"{folder} {folder}\n"), loaded.stderr
    assert loaded.stderr.count("\n") == 1
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.parametrize(("name", "file"), [("planners", "planners.py"), ("maps", "maps/__init__.py")])
def test_a_package_of_somebody_else_with_our_name_is_told_in_one_line(
    name: str, file: str, tmp_path: Path, repository: Path
) -> None:
    """A friction of the first hour: `maps` and `planners` are general names, and whose came first was a guess."""
    theirs = tmp_path / file
    theirs.parent.mkdir(exist_ok=True)
    theirs.touch()
    done = subprocess.run(
        [sys.executable, "-m", "fleet", "site", "list"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(repository)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith(
        f"fleet: the package {name!r} is somebody else's: {theirs}; valid: that of {repository}"
    )
