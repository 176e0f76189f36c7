"""An interrupt ends a command in one line, wherever it arrives and whatever was half made at that moment."""

import signal
import time

import pytest

from fleet.cli.main import INTERRUPTED, main
from fleet.cli.why import Why


class HalfMade:
    """Like the compiler's objects: interrupted while it is made, it complains when it is thrown away."""

    def __init__(self) -> None:
        raise KeyboardInterrupt
        self.handle = 1

    def __del__(self) -> None:
        del self.handle


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_what_is_half_made_at_an_interrupt_says_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Why, "run", lambda self: HalfMade())
    with pytest.raises(SystemExit) as ended:
        main(["why", "car_0", "runs/none"])
    assert ended.value.code == INTERRUPTED
    assert capsys.readouterr().err == "python -m fleet: interrupted\n"


class Interrupted:
    """The signal arrives while this is thrown away, where Python forgets it."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_in_a_destructor_is_not_lost_and_wakes_what_sleeps(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(command: Why) -> int:
        thing = Interrupted()
        del thing
        time.sleep(60.0)
        return 0

    monkeypatch.setattr(Why, "run", run)
    with pytest.raises(SystemExit) as ended:
        main(["why", "car_0", "runs/none"])
    assert ended.value.code == INTERRUPTED
    assert capsys.readouterr().err == "python -m fleet: interrupted\n"
