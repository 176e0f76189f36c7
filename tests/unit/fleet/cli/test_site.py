"""The site commands: what they print can be read, what they write can be used."""

from pathlib import Path
from typing import get_args

import networkx as nx
import pytest

from fleet.cli.main import main
from fleet.cli.site import FORMATS
from maps.layouts.formats import LAYOUT_FORMATS
from maps.site import load_site, site_names

MAP = """type octile
height 11
width 24
map
@@@@@@@@@@@@@@@@@@@@@@@@
@......................@
@......................@
@..TTTTTTTT..TTTTTTTT..@
@..TTTTTTTT..TTTTTTTT..@
@......................@
@......................@
@..TTTTTTTT..TTTTTTTT..@
@..TTTTTTTT..TTTTTTTT..@
@......................@
@@@@@@@@@@@@@@@@@@@@@@@@
"""


def said(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        main(["site", *words])
    output = capsys.readouterr()
    assert (stop.value.code, output.err) == (0, "")
    return output.out


def test_list_has_a_line_for_every_site(capsys: pytest.CaptureFixture[str]) -> None:
    """Of the kind of a friction of the first hour, `1 other places`: one station was told as `1 drop stations`."""
    lines = said(["list"], capsys).splitlines()
    assert [line.split()[0] for line in lines] == list(site_names())
    small = next(line for line in lines if line.startswith("small"))
    assert "16 x 13 m, 2 pick and 2 drop stations, parking for 18 cars" in small
    assert "1 pick and 1 drop station, parking" in next(line for line in lines if line.startswith("cell"))
    longest = max(map(len, site_names()))
    assert {line.rstrip()[longest] for line in lines} == {" "}
    assert all(line[longest + 1].isdigit() for line in lines)


@pytest.mark.parametrize("name", site_names())
def test_check_prints_the_figures_of_a_site(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(["check", name, "--no-draw"], capsys).splitlines()
    rows = dict(line.strip("│ ").split("│") for line in lines if line.startswith("│"))
    values = {key.strip(): value.strip() for key, value in rows.items()}
    assert values["name"] == name
    assert 1.0 <= float(values["path ratio"]) <= 1.5
    assert values["cut cells"] == values["warnings"] == "none"


def test_check_draws_the_lanes(capsys: pytest.CaptureFixture[str]) -> None:
    drawing = said(["check", "cell"], capsys).splitlines()[:16]
    assert sum(line.count("#") for line in drawing) > 20
    assert any(sign in "".join(drawing) for sign in "<>^v")


def test_check_names_the_cells_that_are_cut_off(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A blind alley behind the floor: no lane leads in and out again."""
    plan = list(load_site("cell").plan)
    plan[-1] = "###.########"
    site = tmp_path / "cut.toml"
    site.write_text("plan = '''\n" + "\n".join([*plan, "############"]) + "\n'''", encoding="utf-8")
    output = said(["check", str(site), "--no-draw"], capsys)
    assert "row 7, column 3" in output
    assert "1 floor cells are cut off" in output


def test_a_generated_warehouse_is_a_site(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.toml"
    words = ["generate", str(path), "--rows", "20", "--cols", "30", "--pick", "2", "--drop", "3", "--parking", "9"]
    assert said(words, capsys) == f"{path}: 30 x 20 m, 5 stations\n"
    site = load_site(path)
    assert (site.name, site.grid.rows, site.grid.cols, len(site.parking)) == ("mine", 20, 30, 9)
    assert [station.kind for station in site.stations] == ["pick"] * 2 + ["drop"] * 3


def test_a_converted_map_is_a_site(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, path = tmp_path / "floor.map", tmp_path / "floor.toml"
    source.write_text(MAP, encoding="ascii")
    words = ["convert", str(source), str(path), "--pick", "1", "--drop", "1", "--parking", "3"]
    assert said(words, capsys) == f"{path}: 24 x 11 m, 2 stations\n"
    assert len(load_site(path).parking) == 3
    assert "floor" in said(["check", str(path)], capsys)


def test_the_lane_graph_is_written_for_graph_tools(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "cell.graphml"
    output = said(["check", "cell", "--no-draw", "--graphml", str(file)], capsys)
    graph = nx.read_graphml(file)
    assert f"{file}: {graph.number_of_nodes()} states, {graph.number_of_edges()} moves" in output


def test_every_format_can_be_asked_for() -> None:
    assert set(get_args(FORMATS)) == set(LAYOUT_FORMATS)
