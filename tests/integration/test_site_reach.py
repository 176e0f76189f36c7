"""What a check of a site accepts is run, and what it refuses is refused by all commands with the same words."""

from pathlib import Path

import pytest

import maps.stations
from fleet.cli.main import main
from fleet.config import Grip
from fleet.stations.reach import reach_refusals
from maps.site import load_site

SHELF_BEHIND_EACH_ARM = """
############
#..........#
#.K......K.#
#..........#
#=_AD..PA_=#
#==_....==_#
#..........#
############
""".strip()
"""Lanes two cells behind the arms leave the way from a slot to the tray just the margin that is kept."""
WALL_BEHIND_THE_ARM = """
############
#..........#
#.K......K.#
#.._.......#
#=#AD..PA_=#
#=##....==_#
#..........#
############
""".strip()
LOW_SLOTS = """
[stations.drop_1]
slots = [[-0.48, -0.24, 0.17], [-0.07, -0.53, 0.17], [-0.09, 0.53, 0.17], [-0.47, 0.25, 0.17]]
"""
MAP = """
type octile
height 9
width 16
map
@@@@@@@@@@@@@@@@
@..............@
@..............@
@..............@
@...@@@..@@@...@
@..............@
@..............@
@..............@
@@@@@@@@@@@@@@@@
""".lstrip()


def written(path: Path, plan: str, options: str = "") -> str:
    path.write_text(f"name = 'own'\nplan = '''\n{plan}\n'''\n{options}")
    return str(path)


def done(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must succeed, and return what it prints."""
    with pytest.raises(SystemExit) as stop:
        main(words)
    said = capsys.readouterr()
    assert stop.value.code == 0, said
    return said.out


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must be refused, and return its one line."""
    with pytest.raises(SystemExit) as stop:
        main(words)
    said = capsys.readouterr()
    assert stop.value.code == 2, said
    assert said.err.count("\n") == 1
    return said.err.strip().partition(": ")[2]


def demo(site: str, tmp_path: Path, *words: str) -> list[str]:
    common = ["--robots", "1", "--tasks", "1", "--fidelity", "grid", "--grip", "friction", "--no-record"]
    return ["demo", "--site", site, "--out", str(tmp_path / "run"), *common, *words]


def test_a_site_with_a_shelf_behind_each_arm_is_accepted_and_runs(tmp_path, capsys) -> None:
    site = written(tmp_path / "own.toml", SHELF_BEHIND_EACH_ARM)
    said = done(["site", "check", site, "--no-draw"], capsys)
    for grip in Grip:
        assert f"arms, grip {grip}" in said
    assert said.count("serve all 2 stations") == 2
    assert "1 of 1" in done(demo(site, tmp_path), capsys)


def test_a_slot_out_of_reach_is_refused_with_what_is_in_the_way_and_served_without_it(tmp_path, capsys) -> None:
    """A friction of the first hour: an arm that could not reach, and no word of the cell to keep clear."""
    site = written(tmp_path / "own.toml", WALL_BEHIND_THE_ARM, LOW_SLOTS)
    words = refused(["site", "check", site, "--no-draw", "--grip", "friction"], capsys)
    assert words.startswith("station drop_1, arm iiwa, grip friction, slot 2: the arm cannot reach it")
    assert words.endswith("valid: '_' for the wall at row 5, column 3")
    assert refused(demo(site, tmp_path), capsys) == words
    mended = written(tmp_path / "mended.toml", WALL_BEHIND_THE_ARM.replace("#=##", "#=#_"), LOW_SLOTS)
    assert reach_refusals(load_site(mended), (Grip.FRICTION,), lambda station: None) == {Grip.FRICTION: ()}


def test_check_convert_and_run_refuse_in_the_same_words(tmp_path, capsys, monkeypatch) -> None:
    """A friction of the first hour: `site check` accepted what the demo refused."""
    drawn, site = tmp_path / "own.map", tmp_path / "own.toml"
    drawn.write_text(MAP)
    convert = ["site", "convert", str(drawn), str(site), "--pick", "1", "--drop", "1", "--parking", "2"]
    done([*convert, "--chargers", "1"], capsys)
    assert len(load_site(str(site)).chargers) == 1
    done(convert, capsys)
    # As if a default were wrong: the slots lie as high as the arm's elbow.
    monkeypatch.setattr(maps.stations, "SLOT_TOP_M", 0.8)
    words = refused(["site", "check", str(site), "--no-draw", "--grip", "friction"], capsys)
    assert words.startswith("station pick_1, arm iiwa, grip friction, ")
    assert "valid: " in words
    site.unlink()
    assert refused([*convert, "--grip", "friction"], capsys) == words
    assert not site.exists()
    monkeypatch.undo()
    done(convert, capsys)
    monkeypatch.setattr(maps.stations, "SLOT_TOP_M", 0.8)
    assert refused(demo(str(site), tmp_path), capsys) == words
