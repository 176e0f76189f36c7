"""The commands that show a recording: what they refuse, and what they say without a display."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.cli.run_output import longest_wait_in
from fleet.recording import LogLine, NullRecorder, shot
from fleet.session import runner


def said(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[object, str, str]:
    """Exit status, output and complaints of a command."""
    with pytest.raises(SystemExit) as end:
        main(words)
    out, err = capsys.readouterr()
    return end.value.code, out, err


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A directory with something in place of a recording."""
    (tmp_path / "recording.rrd").write_bytes(b"RRF2")
    return tmp_path


@pytest.mark.parametrize("command", [["view"], ["shot"]])
def test_what_has_no_recording_is_refused_by_name(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["x.png"] if command == ["shot"] else []
    for folder, known in ((tmp_path, "no recording at"), (tmp_path / "none", "FOLDER is")):
        status, out, err = said([*command, str(folder), *words], capsys)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert known in err
        assert "valid: " in err


@pytest.mark.parametrize(
    ("words", "known"),
    [
        (["--size", "3"], "WIDTHxHEIGHT"),
        (["--size", "0x9"], "WIDTHxHEIGHT"),
        (["--at", "-1"], "a number >= 0"),
        (["--at", "inf"], "a number >= 0"),
        (["--at", "soon"], "a number >= 0, or longest-wait"),
        (["--at", "longest-wait"], "no run in"),
    ],
)
def test_bad_options_of_a_picture_are_one_line(
    words: list[str], known: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = said(["shot", str(run), "x.png", *words], capsys)
    assert (status, err.count("\n")) == (2, 1)
    assert known in err


def test_a_picture_of_another_form_is_one_line(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = said(["shot", str(run), "x.jpg"], capsys)
    assert (status, err.count("\n")) == (2, 1)
    assert "PNG is 'x.jpg'; valid: a file whose name ends in .png" in err


def test_a_picture_is_asked_for_as_typed(
    run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def screenshot(*words: object, **settings: object) -> tuple[str, ...]:
        asked.append((words, settings))
        return ("slow",) if len(asked) > 1 else ()

    monkeypatch.setattr(shot, "screenshot", screenshot)
    words = ["shot", str(run), "x.png", "--at", "3", "--size", "80x60", "--view", "Site"]
    status, out, _ = said(words, capsys)
    assert (status, out) == (0, "picture: x.png\n")
    assert asked == [((run / "recording.rrd", Path("x.png")), {"time_s": 3.0, "size": (80, 60), "view": "Site"})]
    status, _, err = said(words, capsys)
    assert (status, err) == (1, "slow\n")


def test_the_longest_wait_is_one_word_away(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A friction of the first hour: nothing to click for the longest wait."""
    lines: list[LogLine] = []

    class Listener(NullRecorder):
        def log(self, line: LogLine) -> None:
            lines.append(line)

    run = tmp_path / "run"
    monkeypatch.setattr(runner, "open_recorder", lambda *_, **__: Listener())
    said(["demo", "--robots", "6", "--tasks", "6", "--fidelity", "grid", "--out", str(run)], capsys)
    (run / "recording.rrd").write_bytes(b"RRF2")
    asked = []
    monkeypatch.setattr(shot, "screenshot", lambda *_, **settings: asked.append(settings["time_s"]) or ())
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert said(["shot", str(run), str(tmp_path / "x.png"), "--at", "longest-wait"], capsys)[0] == 0
    (time_s,) = asked
    wait = longest_wait_in(run)
    assert wait is not None
    assert wait.from_s <= time_s <= wait.to_s
    assert f"picture.png --at {time_s:g})" in said(["view", str(run), "--at", "longest-wait"], capsys)[1]
    (line,) = (line for line in lines if line.text.startswith("longest wait of the run"))
    assert line.level == "WARN"
    assert 0.0 <= time_s - line.sim_s <= 0.05  # a tick of the grid
    assert f"{wait.robot} has waited" in line.text


def test_without_a_display_it_says_how_to_look(
    run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    status, out, _ = said(["view", str(run)], capsys)
    assert status == 0
    assert out.startswith("no display to open the viewer on; recording: ")


def test_the_installed_command_calls_itself_fleet(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["/somewhere/bin/fleet", "nonsense"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert capsys.readouterr().err.startswith("fleet: unknown command 'nonsense'")


def test_the_version_is_told(capsys: pytest.CaptureFixture[str], repository: Path) -> None:
    """Whoever cites the project or asks about an installation needs it."""
    version = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    status, out, err = said(["--version"], capsys)
    assert (status, err) == (0, "")
    assert out.startswith(f"fleet {version} in {repository}, Python 3.")
