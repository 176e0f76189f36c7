"""Blocks: how long the Python blocks of the pages compile when nothing has been compiled yet.

Each kernel is compiled once, in whichever block comes to it first, and kept. What a block would have compiled by itself
are the kernels that it uses, and those that they call.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.first_hour.newcomer import REPOSITORY, Newcomer, Taken, take
from benchmarks.harness import Kind, Row, Trial
from planners.kernel_cache import VARIABLE
from tests.guide.pages import Block, pages, read_blocks

MOST_S = 30.0
"""Computing time that a block may compile at its first use [s]."""
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

    def compiled_by(self, used: Iterable[str]) -> dict[str, float]:
        """Computing time by kernel [s], the dearest first, that is needed before some can be used."""
        found, left = set[str](), list(used)
        while left:
            kernel = left.pop()
            if kernel not in found:
                found.add(kernel)
                left += self.calls.get(kernel, ())
        told: dict[str, float] = defaultdict(float)
        for kernel in found:
            told[self.names[kernel]] += self.compile_s.get(kernel, 0.0)
        return dict(sorted(told.items(), key=lambda item: -item[1]))


def measure_blocks(trial: Trial, newcomer: Newcomer) -> Iterable[Row]:
    """Run each block in the source tree; caches are empty at the beginning."""
    kernels, most_s = Kernels(), 0.0
    for block in blocks_to_run(QUICK_PAGES if trial.quick else pages()):
        took, used = run_block(block, newcomer.folder / "caches", kernels)
        where, compiled = f"{block.page}:{block.line}", kernels.compiled_by(used)
        trial.check(took.status == 0, f"{where}: {took.told}")
        whole_s = sum(compiled.values())
        most_s = max(most_s, whole_s)
        yield Row(name=where, value=whole_s, unit="s", kind=Kind.TIME, target=f"<= {MOST_S:g}")
        if whole_s > MOST_S:
            dearest = (f"{name} {seconds:.1f} s" for name, seconds in list(compiled.items())[:DEAREST])
            trial.notes.append(f"{where} compiles {len(compiled)} kernels: {', '.join(dearest)}, ...")
    yield Row(name="most that a block compiles", value=most_s, unit="s", kind=Kind.TIME, target=f"<= {MOST_S:g}")


def blocks_to_run(names: Iterable[str]) -> Iterator[Block]:
    """The Python blocks of pages that the tests run, too."""
    for name in names:
        yield from (block for block in read_blocks(name) if block.language == "python" and "skip" not in block.marks)


def run_block(block: Block, caches: Path, kernels: Kernels) -> tuple[Taken, set[str]]:
    """Run a block.

    Args:
        block: Of a page.
        caches: Folder of what is kept from block to block.
        kernels: Learns from it.

    Returns:
        How it ended, and the kernels that its processes used.
    """
    with tempfile.TemporaryDirectory() as folder:
        desk, watch = Path(folder, "desk"), Path(folder, "watch")
        shutil.copytree(REPOSITORY / "docs" / "examples", desk / "docs" / "examples")
        for other in read_blocks(block.page):
            if name := other.marks.get("file"):
                (desk / name).write_text(other.text, encoding="utf-8")
        watch.mkdir()
        (watch / "sitecustomize.py").write_text(WATCH, encoding="utf-8")
        variables = {
            VARIABLE: str(caches / "kernels"),
            "FLEET_CACHE": str(caches / "fitted"),
            "FIRST_HOUR_WATCH": str(watch),
            "PYTHONPATH": os.pathsep.join((str(watch), str(REPOSITORY))),
        }
        took = take([sys.executable, "-c", block.text], desk, {**os.environ, **variables})
        return took, kernels.read(watch)
