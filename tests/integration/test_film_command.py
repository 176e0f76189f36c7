"""The film command draws a part of a run from its files, and refuses what it cannot draw."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.session import SessionConfig, run_session

CONFIG = RunConfig(
    site="cell", robots=2, tasks=2, seed=0, fidelity=Fidelity.GRID, duration_s=20.0, arms=ArmConfig(workers_n=0)
)
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "two"
    run_session(CONFIG, SessionConfig(out=out, record=False, progress=False))
    return out


def status(words: list[str]) -> int | str | None:
    with pytest.raises(SystemExit) as stop:
        main(["film", *words])
    return stop.value.code


def test_a_film_ends_where_the_run_does(folder: Path, tmp_path: Path) -> None:
    """Eight seconds from the twelfth on are left of twenty; a car has a place at each end of a quarter of a second."""
    svg = tmp_path / "film.svg"
    assert status([str(folder), str(svg), "--at", "12"]) == 0
    turns = [one for one in ET.parse(svg).iter(f"{SVG}animateTransform") if one.get("type") == "rotate"]
    assert [one.get("dur") for one in turns] == ["8s"] * CONFIG.robots
    assert {len((one.get("values") or "").split(";")) for one in turns} == {33}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["RUN", "film.svg", "--at", "20"], ["--at", "20.0", "0 to 19.75"]),
        (["RUN", "film.svg", "--at", "nan"], ["--at", "nan"]),
        (["RUN", "film.svg", "--length", "0"], ["--length", "0.25 to 120"]),
        (["RUN", "nowhere/film.svg"], ["SVG", "nowhere"]),
        (["RUN", "film.gif"], ["SVG", "film.gif", "ends in .svg"]),
        (["nothing", "film.svg"], ["no run in nothing"]),
    ],
)
def test_what_cannot_be_drawn_is_one_line(
    words: list[str],
    expected: list[str],
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert status([str(folder) if word == "RUN" else word for word in words]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert all(word in err for word in expected), err
    assert not list(tmp_path.iterdir())
