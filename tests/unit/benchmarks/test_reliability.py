"""Files and actions that are wrong somewhere: taken or refused by name; and what watches that can itself fail."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.reliability import odd_actions
from benchmarks.reliability.file_kinds import FILE_KINDS, FileKind, contents
from benchmarks.reliability.fuzz import REFUSED, TAKEN, Hang, at_most, command_fault, fuzz, message_fault, verdict
from fleet.envs import ENVIRONMENTS
from fleet.errors import FleetError

N_FILES = 80
"""Of each kind; the benchmark reads some hundreds."""
N_STEPS = 20


@pytest.mark.parametrize("kind", FILE_KINDS)
def test_a_wrong_file_is_refused_by_name_with_what_is_valid(kind: str, tmp_path: Path) -> None:
    assert verdict(kind, {}, tmp_path) == (TAKEN, "")
    tally = fuzz(kind, N_FILES, tmp_path)
    assert list(tally.faults) == []
    # Both happen, so that neither a reader that takes everything nor one that takes nothing passes.
    assert tally.counts[TAKEN] > 0
    assert tally.counts[REFUSED] > N_FILES // 4
    assert tally.counts.total() == N_FILES


@pytest.mark.parametrize("name", [*odd_actions.MAKERS, *odd_actions.SINGLE])
def test_odd_actions_are_made_legal_or_refused(name: str) -> None:
    tally = odd_actions.fuzz_actions(name, N_STEPS)
    assert sorted(tally.faults) == []
    assert tally.counts["taken"] > 0
    assert tally.counts["refused"] > 0


def test_every_environment_is_handed_odd_actions() -> None:
    assert set(odd_actions.MAKERS) == set(ENVIRONMENTS)


def planted(monkeypatch: pytest.MonkeyPatch, read: Any) -> None:
    """Let a reader of TOML files be this one."""
    kind = FileKind(forms={"x.toml": "toml"}, make=lambda: {"x.toml": b"a = 1\nb = 'x'\n"}, read=read)
    monkeypatch.setitem(FILE_KINDS, "planted", kind)
    contents.cache_clear()


def test_a_reader_that_breaks_is_caught(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import tomllib

    def read(folder: Path) -> None:
        try:
            content = tomllib.loads((folder / "x.toml").read_text(encoding="utf-8"))
        except ValueError as error:
            raise FleetError(f"{folder / 'x.toml'}: is no TOML; valid: TOML") from error
        content["a"]

    planted(monkeypatch, read)
    faults = list(fuzz("planted", 200, tmp_path).faults)
    assert any(fault.startswith("KeyError in ") for fault in faults), faults


def test_a_refusal_that_says_too_little_is_caught(tmp_path: Path) -> None:
    name = tmp_path.name
    assert message_fault("site", f"{name}/a: x is 3; valid: 1", tmp_path) == ""
    assert "valid" in message_fault("site", f"{name}/a: x is 3", tmp_path)
    assert "name the file" in message_fault("site", "x is 3; valid: 1", tmp_path)
    assert "characters" in message_fault("site", f"{name}: {'x' * 5000}; valid: 1", tmp_path)
    assert "UTF-8" in message_fault("site", f"{name}: \ud800; valid: 1", tmp_path)


def test_a_reader_that_hangs_is_stopped() -> None:
    with pytest.raises(Hang), at_most(0.05):
        _spin()


def _spin() -> None:
    while True:
        pass


def test_a_command_refuses_in_one_line(tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    site.write_bytes(b"plan = '''\nP\xd0\n'''\n")
    assert command_fault(["site", "check", str(site)]) == ""
