"""Tables are sorted by the commands, the same way for the same seed, with a recording and a result."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from fleet.cli.main import main
from fleet.recording.rerun_cli import run_rerun
from fleet.world.bullet.confirm import Confirmation, PathConfirmer

pytestmark = pytest.mark.bullet

FloatArray = npt.NDArray[np.float64]


def ran(words: list[str]) -> int:
    with pytest.raises(SystemExit) as stop:
        main(["tabletop", *words])
    return int(stop.value.code or 0)


def result_of(folder: Path) -> dict[str, object]:
    found: dict[str, object] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return found


def test_one_arm_sorts_and_the_seed_decides_how(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: `sim s` and `state hash` in a table for people."""
    hashes = []
    for name in ("a", "b"):
        words = ["sort", "--objects", "3", "--seed", "1", "--out", str(tmp_path / name)]
        assert ran([*words, "--no-record"] if name == "b" else words) == 0
        result = result_of(tmp_path / name)
        assert (result["sorted"], result["missed"], result["reasons"]) == (3, 0, {})
        hashes.append(result["state_hash"])
    assert hashes[0] == hashes[1]
    said = capsys.readouterr().out
    assert "recording.rrd" in said
    assert all(told in said for told in ("simulated time [s]", "digest of the last state", "wall time [s]"))
    assert (tmp_path / "a" / "recording.rrd").stat().st_size > 100_000
    assert not (tmp_path / "b" / "recording.rrd").exists()
    assert run_rerun(["rrd", "verify", str(tmp_path / "a" / "recording.rrd")]).returncode == 0


def test_two_arms_work_at_the_same_time_and_never_touch(tmp_path: Path) -> None:
    # With this seed the arms were in each other's way from rest to rest until they went round each other.
    assert ran(["pair", "--seed", "1", "--objects", "4", "--no-record", "--out", str(tmp_path)]) == 0
    result = result_of(tmp_path)
    assert result["sorted"] == 4
    assert result["rounds_together"] == result["rounds"] == 2
    assert result["robot_contacts"] == 0


def test_two_arms_share_a_tray_sooner_than_by_turns_and_never_touch(tmp_path: Path) -> None:
    # In this instance the arms touch if the schedule is not kept.
    assert ran(["exchange", "--seed", "1", "--no-record", "--out", str(tmp_path)]) == 0
    result = result_of(tmp_path)
    assert (result["way"], result["robot_contacts"]) == ("decoupled", 0)
    alone_s = result["alone_s"]
    assert isinstance(alone_s, list)
    makespan_s = result["makespan_s"]
    assert isinstance(makespan_s, float)
    assert max(alone_s) <= makespan_s < 0.8 * sum(alone_s)


def test_parcels_for_a_shared_tray_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ran(["exchange", "--deliveries", "4", "--out", str(tmp_path)]) == 2
    assert "--deliveries is 4; valid: an integer from 1 to 3" in capsys.readouterr().err


@pytest.mark.slow
def test_a_panda_empties_most_of_a_tray(tmp_path: Path) -> None:
    """Random objects may roll or slip away; what is left is told, and so is the exit status."""
    status = ran(["tray", "--no-record", "--out", str(tmp_path)])
    result = result_of(tmp_path)
    assert isinstance(result["sorted"], int)
    assert isinstance(result["reasons"], dict)
    assert result["sorted"] >= 4
    assert len(result["reasons"]) == 6 - result["sorted"]
    assert status == (0 if result["sorted"] == 6 else 1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["sort", "--objects", "11"], "--objects is 11; valid: an integer from 1 to 10"),
        (["tray", "--seed", "-1"], "--seed is -1; valid: an integer from 0 to 2147483647"),
        (["sort", "--seed", "2147483648"], "--seed is 2147483648; valid: an integer from 0 to 2147483647"),
        (["chess"], "unknown command 'chess'; valid: sort, tray, pair"),
        (["sort", "--objects", "1", "--out", __file__], "--out"),
    ],
)
def test_bad_input_is_one_line(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert ran(words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1


def test_the_physics_engine_has_the_last_word(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths that lead into the table are no paths, however good they look to the spheres."""
    seen = []

    def bent(self: PathConfirmer, path: FloatArray, held: FloatArray | None = None, **settings: float) -> Confirmation:
        verdict = confirm(self, path + 0.3 * np.eye(7)[1], held, **settings)
        seen.append(verdict.what)
        return verdict

    confirm = PathConfirmer.confirm
    monkeypatch.setattr(PathConfirmer, "confirm", bent)
    assert ran(["sort", "--seed", "1", "--objects", "1", "--no-record", "--out", str(tmp_path)]) == 1
    result = result_of(tmp_path)
    assert seen[0].endswith(" - box")
    assert (result["sorted"], result["paths_refused"]) == (0, sum(map(bool, seen)))
    assert result["reasons"] == {"0": f"way to it: the physics engine refuses it: {seen[0]}"}


def test_a_schedule_that_the_engine_refuses_is_not_played(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    verdict = Confirmation(free=False, first_index=0, what="cup - the other arm's cup")
    monkeypatch.setattr(PathConfirmer, "confirm_beside", lambda *_: verdict)
    assert ran(["pair", "--objects", "2", "--no-record", "--out", str(tmp_path)]) == 1
    result = result_of(tmp_path)
    assert (result["sorted"], result["rounds"], result["rounds_together"]) == (0, 0, 0)
    assert result["reasons"] == dict.fromkeys(("0", "1"), "no schedule with the other arm")
