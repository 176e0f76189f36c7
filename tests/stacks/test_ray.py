"""Studies on a Ray cluster: the same file as without one, whatever dies; what was joined is left as it was."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig, StreamConfig, StreamKind
from fleet.errors import BrokenRunError
from fleet.study import ray_tasks
from fleet.study.backend import N_RESTARTS, Backend
from fleet.study.design import Design, StudyError
from fleet.study.installation import SOURCE, installation
from fleet.study.pool import run_all
from fleet.study.ray_cluster import ray_cluster
from fleet.study.ray_tasks import run_on_ray
from fleet.study.study import run_study
from fleet.study.table import CSV_FILE, Row, read_rows
from maps.errors import UnknownSiteError
from tests.stacks.conftest import require_package

require_package("ray", "ray")

FREE_BYTES = 6e9
"""Memory that must be free: below, Ray's processes are slow to start and its workers are killed."""
NODE = {"object_store_memory": 100_000_000}
SHORT = RunConfig(site="cell", robots=1, fidelity=Fidelity.GRID, duration_s=20.0, arms=ArmConfig(workers_n=0))
LONG = replace(SHORT, site="small", robots=6, fidelity=Fidelity.KINEMATIC, duration_s=100_000.0)
WORDS = ["--site", "cell", "--fidelity", "grid", "--robots", "1:2", "--seeds", "2", "--duration", "80", "--rate", "900"]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") < FREE_BYTES,
        reason="less than 6 GB of memory are free for a Ray cluster",
    ),
    # Ray leaves streams of its processes open.
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Return a cluster that is not this process's: a head with one CPU."""
    utils = pytest.importorskip("ray.cluster_utils")
    one = utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False, **NODE})
    yield one
    one.shutdown()


def workers_of(node: Any) -> list[int]:
    """Processes in which a node does runs."""
    (raylet,) = node.all_processes["raylet"]
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            name = (folder / "cmdline").read_bytes()
            parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if name.startswith(b"ray::_measure") and int(parent) == raylet.process.pid:
            found.append(int(folder.name))
    return found


def kill_workers(node: Any) -> int:
    """Kill them; returns how many."""
    found = workers_of(node)
    for process in found:
        os.kill(process, signal.SIGKILL)
    return len(found)


def study(design: Design, out: Path, backend: Backend) -> bytes:
    outcome = run_study(
        design,
        out,
        jobs=None if backend is not run_all else 2,
        resume=False,
        interrupted=[],
        progress=lambda done, total: None,
        backend=backend,
    )
    assert outcome.n_open == 0
    return (out / CSV_FILE).read_bytes()


def group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def losses(caplog: pytest.LogCaptureFixture) -> int:
    return sum("was lost with its worker" in record.getMessage() for record in caplog.records)


def test_a_node_that_dies_on_the_way_costs_no_row(
    cluster: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    design = Design(
        allocators=("greedy", "hungarian"),
        robots=(1, 2),
        seeds=tuple(range(10)),
        site="cell",
        fidelity=Fidelity.KINEMATIC,
        duration_s=300.0,
        stream=StreamConfig(kind=StreamKind.POISSON, rate_per_h=360.0),
    )
    node = cluster.add_node(num_cpus=2, **NODE)
    killed: list[int] = []

    def node_dies(configs: Sequence[RunConfig], jobs: int | None, interrupted: Sequence[int]) -> Iterator[Row | None]:
        n_rows = 0
        for row in run_on_ray(configs, jobs, interrupted):
            n_rows += row is not None
            if n_rows > 3 and row is None and not killed and workers_of(node):
                killed.append(n_rows)
                cluster.remove_node(node, allow_graceful=False)
            yield row

    with ray_cluster(cluster.address, None):
        on_ray = study(design, tmp_path / "ray", node_dies)
    assert killed
    assert killed[0] < 40
    assert losses(caplog) <= 2
    assert len(read_rows(tmp_path / "ray" / CSV_FILE)) == 40
    assert on_ray == study(design, tmp_path / "local", run_all)


def test_a_worker_that_dies_costs_one_run(cluster: Any, caplog: pytest.LogCaptureFixture) -> None:
    config, n_killed, seeds = replace(LONG, duration_s=1000.0), 0, []
    with ray_cluster(cluster.address, None):
        for row in run_on_ray([replace(config, seed=seed) for seed in range(3)], None, []):
            if row is not None:
                seeds.append(row.seed)
            elif len(seeds) == 1 and not n_killed:
                n_killed = kill_workers(cluster.head_node)
    assert n_killed >= 1
    assert sorted(seeds) == [0, 1, 2]
    assert losses(caplog) <= n_killed


def test_a_run_that_is_lost_again_and_again_ends_the_study(cluster: Any) -> None:
    expected = r"run of hungarian with 6 cars, seed 0, was lost 3 times without a new row.*valid: fewer --jobs"
    killed: list[int] = []
    with ray_cluster(cluster.address, None), pytest.raises(BrokenRunError, match=expected):
        killed.extend(kill_workers(cluster.head_node) for _ in run_on_ray([LONG], None, []))
    assert sum(killed) >= N_RESTARTS + 1


def test_another_source_on_a_node_is_refused(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = {**installation(), SOURCE: "0" * 12}
    monkeypatch.setattr(ray_tasks, "installation", lambda: mine)
    with ray_cluster(cluster.address, None), pytest.raises(StudyError, match=r"Ray node .*digest.* 0{12} here, "):
        list(run_on_ray([SHORT], None, []))


def test_another_version_of_ray_is_refused(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ray.__version__", "1.0.0")
    with pytest.raises(StudyError, match=r"(?s)Version mismatch.*Ray: 2\..*Ray: 1\.0\.0"):
        ray_cluster(cluster.address, None).__enter__()


def test_a_run_that_is_refused_there_is_refused_here(cluster: Any) -> None:
    with ray_cluster(cluster.address, None), pytest.raises(UnknownSiteError, match=r"nowhere\.toml"):
        list(run_on_ray([replace(SHORT, site="nowhere.toml")], None, []))


def test_a_joined_cluster_outlives_the_study_and_its_interrupt(
    cluster: Any, run_study_command: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    words = [*WORDS, "--seeds", "500", "--out", str(tmp_path), "--backend", "ray", "--ray-address", cluster.address]
    process = run_study_command(*words)
    table, end = tmp_path / CSV_FILE, time.monotonic() + 200.0
    while not (table.is_file() and len(table.read_text(encoding="utf-8").splitlines()) > 2):
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    said, complaint = process.communicate(timeout=100)
    assert (process.returncode, complaint) == (130, "")
    assert "runs are missing; --resume does what is left" in said
    assert 2 <= len(read_rows(table)) < 2000
    with ray_cluster(cluster.address, None):
        (row,) = [row for row in run_on_ray([SHORT], None, []) if row is not None]
    assert row.seed == 0


def test_a_cluster_of_this_machine_gives_the_same_file_and_is_gone_afterwards(
    run_study_command: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    """The site is a file, named from where the command is called."""
    site, home = Path("maps", "data", "cell.toml"), tmp_path / "home"
    with tempfile.TemporaryDirectory() as scratch:  # Ray's sockets want a short path
        for backend in ("local", "ray"):
            words = [*WORDS, "--site", str(site), "--out", str(tmp_path / backend), "--backend", backend]
            process = run_study_command(*words, "--jobs", "2", TMPDIR=scratch, HOME=str(home))
            said, complaint = process.communicate(timeout=300)
            assert (process.returncode, complaint) == (0, ""), said
            assert "page: " in said
            end = time.monotonic() + 30.0
            while group_lives(process.pid):
                assert time.monotonic() < end
                time.sleep(0.05)
        assert list(Path(scratch).iterdir()) == []
        assert not (home / ".ray").exists()
    assert (tmp_path / "ray" / CSV_FILE).read_bytes() == (tmp_path / "local" / CSV_FILE).read_bytes()


@pytest.fixture
def run_study_command(repository: Path) -> Callable[..., subprocess.Popen[str]]:
    """Return what starts the command in a process group of its own."""

    def run(*words: str, **environment: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "fleet", "study", *words],
            cwd=repository,
            env={**os.environ, **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    return run
