"""Blocks: how long the Python blocks of the pages compile when nothing has been compiled yet.

Each kernel is compiled once, in whichever program comes to it first, and kept. What a block would have compiled by
itself are the kernels that it uses, and those that they call; after `make setup`, which compiles those of the demo, the
rest.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.first_hour.newcomer import REPOSITORY, Newcomer, Taken, take
from benchmarks.harness import Kind, Row, Trial
from planners.kernel_cache import VARIABLE
from tests.guide.pages import Block, pages, read_blocks

SET_UP = ("-m", "fleet.demo", "--site", "cell", "--robots", "1", "--tasks", "1", "--duration", "8", "--out", "run")
"""What `make setup` runs to compile kernels."""
MOST_S = 30.0
"""Computing time that a block may compile at its first use after that [s]."""
QUICK_PAGES = ("README.md", "docs/guide/own_planner.md", "docs/guide/two_arms.md")
"""The page that is read first, and those that were dearest."""
DEAREST = 8
"""Kernels that are named of a block which compiles for too long."""
WATCH = """# Writes down which kernels this process uses, who calls them, and how long those take that are compiled.
import json, os, threading, time
from numba.core.dispatcher import Dispatcher

local, compile_or_load = threading.local(), Dispatcher.compile

def compile(self, sig):
    stack = local.__dict__.setdefault("stack", [])
    name = f"{self.py_func.__module__}.{self.py_func.__qualname__}"
    caller, begin_s, misses = stack[-1] if stack else None, time.thread_time(), sum(self._cache_misses.values())
    mine = [f"{name}{sig}", 0.0]
    stack.append(mine)
    try:
        return compile_or_load(self, sig)
    finally:
        stack.pop()
        whole_s, compiled = time.thread_time() - begin_s, sum(self._cache_misses.values()) > misses
        if caller is not None:
            caller[1] += whole_s
        # At once: some processes end without a word.
        with open(os.path.join(os.environ["FIRST_HOUR_WATCH"], f"{os.getpid()}.kernels"), "a") as file:
            own_s = whole_s - mine[1] if compiled else None
            file.write(json.dumps([mine[0], name, caller and caller[0], own_s]) + "\\n")

Dispatcher.compile = compile
"""
"""A `sitecustomize` for the block and for all processes that it starts."""


@dataclass(kw_only=True)
class Kernels:
    """What is known of kernels from the blocks that have run."""

    names: dict[str, str] = field(default_factory=dict)
    """Of each kernel and signature: the kernel."""
    compile_s: dict[str, float] = field(default_factory=dict)
    """Computing time of its compilation without those that it calls [s]."""
    calls: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))

    def read(self, watch: Path) -> set[str]:
        """Learn from what the processes of a block wrote down; returns the kernels that they used."""
        used = set[str]()
        for path in watch.glob("*.kernels"):
            for line in path.read_text(encoding="utf-8").splitlines():
                kernel, name, caller, own_s = json.loads(line)
                used.add(kernel)
                self.names[kernel] = name
                if caller is not None:
                    self.calls[caller].add(kernel)
                if own_s is not None:
                    self.compile_s[kernel] = min(own_s, self.compile_s.get(kernel, own_s))
        return used

    def behind(self, used: Iterable[str]) -> set[str]:
        """Some kernels and all that they call: those which have to be compiled before these can be used."""
        found, left = set[str](), list(used)
        while left:
            kernel = left.pop()
            if kernel not in found:
                found.add(kernel)
                left += self.calls.get(kernel, ())
        return found

    def compile_by_name(self, kernels: Iterable[str]) -> dict[str, float]:
        """Computing time of their compilation [s] by name, the dearest first."""
        told: dict[str, float] = defaultdict(float)
        for kernel in kernels:
            told[self.names[kernel]] += self.compile_s.get(kernel, 0.0)
        return dict(sorted(told.items(), key=lambda item: -item[1]))


def measure_blocks(trial: Trial, newcomer: Newcomer) -> Iterable[Row]:
    """Run each block in the source tree; caches are empty at the beginning."""
    kernels, caches, most_s = Kernels(), newcomer.folder / "caches", 0.0
    took, used = watched(SET_UP, {}, caches, kernels)
    trial.check(took.status == 0, f"set-up: {took.told}")
    ready = kernels.behind(used)
    yield _compiling("set-up", sum(kernels.compile_by_name(ready).values()))
    for block in blocks_to_run(QUICK_PAGES if trial.quick else pages()):
        files = {other.marks["file"]: other.text for other in read_blocks(block.page) if "file" in other.marks}
        took, used = watched(("-c", block.text), files, caches, kernels)
        where, needed = f"{block.page}:{block.line}", kernels.behind(used)
        trial.check(took.status == 0, f"{where}: {took.told}")
        compiled = kernels.compile_by_name(needed - ready)
        yield _compiling(f"{where}, after set-up", sum(compiled.values()), f"<= {MOST_S:g}")
        yield _compiling("  from nothing", sum(kernels.compile_by_name(needed).values()))
        most_s = max(most_s, sum(compiled.values()))
        if sum(compiled.values()) > MOST_S:
            dearest = (f"{name} {seconds:.1f} s" for name, seconds in list(compiled.items())[:DEAREST])
            trial.notes.append(f"{where} compiles {len(compiled)} kernels: {', '.join(dearest)}, ...")
    yield _compiling("most that a block compiles after set-up", most_s, f"<= {MOST_S:g}")


def _compiling(name: str, seconds: float, target: str = "") -> Row:
    return Row(name=name, value=seconds, unit="s", kind=Kind.TIME, target=target)


def blocks_to_run(names: Iterable[str]) -> Iterator[Block]:
    """The Python blocks of pages that the tests run, too."""
    for name in names:
        yield from (block for block in read_blocks(name) if block.language == "python" and "skip" not in block.marks)


def watched(words: Sequence[str], files: Mapping[str, str], caches: Path, kernels: Kernels) -> tuple[Taken, set[str]]:
    """Run Python in a folder that has some files and the examples of the project.

    Args:
        words: Arguments.
        files: Their texts by name.
        caches: Folder of what is kept from program to program.
        kernels: Learns from it.

    Returns:
        How it ended, and the kernels that its processes used.
    """
    with tempfile.TemporaryDirectory() as folder:
        desk, watch = Path(folder, "desk"), Path(folder, "watch")
        shutil.copytree(REPOSITORY / "docs" / "examples", desk / "docs" / "examples")
        for name, text in files.items():
            (desk / name).write_text(text, encoding="utf-8")
        watch.mkdir()
        (watch / "sitecustomize.py").write_text(WATCH, encoding="utf-8")
        variables = {
            VARIABLE: str(caches / "kernels"),
            "FLEET_CACHE": str(caches / "fitted"),
            "FIRST_HOUR_WATCH": str(watch),
            "PYTHONPATH": os.pathsep.join((str(watch), str(REPOSITORY))),
        }
        took = take([sys.executable, *words], desk, {**os.environ, **variables})
        return took, kernels.read(watch)
