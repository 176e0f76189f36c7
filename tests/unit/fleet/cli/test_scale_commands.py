"""The gap, fit and capacity commands refuse what they cannot do in one line, before anything runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.cli.main import main


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("gap", "SITE is missing"),
        ("gap nowhere", "nowhere"),
        ("gap small --robots 0", "--robots is 0; valid: an integer >= 1"),
        ("gap small --robots 900", "--robots is 900; valid: 1 to"),
        ("gap small --seeds 0", "--seeds is 0; valid: an integer from 1 to 10000"),
        ("gap small --duration -1", "--duration is -1.0; valid: a number > 0"),
        ("gap small --jobs 0", "--jobs is 0; valid: an integer >= 1"),
        ("gap small --rate 5 --orders o.csv", "--rate is 5.0; valid: without --orders"),
        ("gap small --fidelities grid,marble", "--fidelities is 'marble'; valid: physics, mixed, kinematic"),
        ("gap small --fidelities grid", "--fidelities is 'grid'; valid: two or more of physics"),
        ("gap small --fidelities grid,grid", "--fidelities is 'grid,grid'; valid: each once"),
        ("gap small --out FILE", "--out FILE: Not a directory; valid: a directory that can be written"),
        ("gap small --out FILE/deeper", "--out FILE/deeper: Not a directory; valid"),
        ("fit --out .", "--out .: Is a directory; valid: a file that can be written"),
        ("fit --out FILE/fit.json", "--out FILE/fit.json: Not a directory; valid"),
        ("robots fit husky --out FILE", "--out FILE: Not a directory; valid"),
        ("capacity --out FILE", "--out FILE: Not a directory; valid"),
        ("study --robots 2 --out FILE", "--out FILE: Not a directory; valid"),
        ("gap small --out=", "--out is ''; valid: a path"),
        ("fit --robots 0", "--robots is 0; valid: an integer >= 1"),
        ("fit --robots 900", "--robots is 900; valid: 1 to"),
        ("fit --duration 0.5", "--duration is 0.5; valid: a number from 1 to 3600"),
        ("fit --seed -1", "--seed is -1; valid: an integer >= 0"),
        ("fit --site nowhere", "nowhere"),
        ("capacity --robots x", "--robots is 'x'; valid: a list of numbers"),
        ("capacity --robots 10,1000000", "valid: numbers from 1 to 100000"),
        ("capacity --robots 10,9999999", "at most 1000000"),
        ("capacity --robots 10,200000", "valid: numbers from 1 to 100000"),
        ("capacity --fidelities marble", "--fidelities is 'marble'; valid: physics, mixed, kinematic"),
        ("capacity --fidelities grid,grid", "--fidelities is 'grid,grid'; valid: each once"),
        ("capacity --minutes 0", "--minutes is 0.0; valid: a number > 0"),
        ("capacity --minutes nan", "--minutes is nan; valid: a number > 0"),
    ],
)
def test_bad_words_are_one_line(
    words: str, said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("FILE").write_text("")
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    told = capsys.readouterr()
    assert stop.value.code == 2
    assert said in told.err
    assert told.err.count("\n") == 1
    assert list(tmp_path.rglob("*")) == [tmp_path / "FILE"]
