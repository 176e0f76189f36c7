"""An interrupt ends a command in one line, whatever was half made at that moment."""

import pytest

from fleet.cli import INTERRUPTED, main
from fleet.commands.why import Why


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
