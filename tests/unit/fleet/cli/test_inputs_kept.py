"""Outputs that would take the place of what a command reads are refused, and the input is as it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.cli.main import main

MAP = "type octile\nheight 3\nwidth 3\nmap\n...\n...\n...\n"


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["site", "convert", "it", "it"], "OUT"),
        (["site", "export", "--format", "lif", "it", "it"], "FILE"),
        (["site", "import", "it", "--format", "lif", "--out", "it"], "--out"),
        (["site", "check", "it", "--graphml", "it"], "--graphml"),
        (["layout", "drive", "it", "--record", "it"], "--record"),
        (["yard", "demo", "--yard", "it", "--json", "it"], "--json"),
        (["diff", "a", "b", "--out", "a/run.trace"], "--out"),
    ],
)
def test_inputs_are_kept(
    words: list[str],
    option: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("it").write_text(MAP, encoding="utf-8")
    for run in ("a", "b"):
        Path(run).mkdir()
        Path(run, "run.trace").write_text(MAP, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert f"{option} is '{words[-1]}'; valid: another file than what is read" in capsys.readouterr().err
    assert Path("it").read_text(encoding="utf-8") == MAP
    assert Path("a", "run.trace").read_text(encoding="utf-8") == MAP
