"""Results: the file that keeps what was played, so that nothing is played twice."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fleet.config.field_checks import is_number
from fleet.evaluation.comparison import findings
from fleet.evaluation.errors import EvaluationError
from fleet.evaluation.players import Player
from fleet.evaluation.scenarios import scenario_named
from fleet.evaluation.scores import SplitScores
from fleet.whole_file import write_whole
from maps.reading.text_file import FileError, read_json

FORMAT = 1
"""Of the file."""
_VALID = f"valid: results of fleet.evaluate, format {FORMAT}"


class ResultsFile:
    """Scores that are kept, so that nothing is played twice.

    Args:
        path: A JSON file, written after every split; None keeps nothing.

    Raises:
        EvaluationError: The file is there and holds something else.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self.scores: list[SplitScores] = []
        """In the order in which they were played."""
        if path is not None and path.exists():
            self.scores = _read(path)

    def find(self, scenario: str, split: str, player: Player, n_episodes: int) -> SplitScores | None:
        """What was played before, of the same policy and definition, with as many episodes; None if nothing was."""
        wanted = scenario_named(scenario)
        known = {
            "scenario": scenario,
            "split": split,
            "policy": player.name,
            "digest": player.digest,
            "definition": json.loads(json.dumps(wanted.definition(split))),
        }
        for one in self.scores:
            alike = all(getattr(one, name) == value for name, value in known.items())
            if alike and one.n_episodes == n_episodes and set(one.figures) == set(wanted.measures):
                return one
        return None

    def add(self, scores: SplitScores) -> None:
        """Keep scores, in place of older ones of the same policy, and write the file, whole or not at all."""
        key = (scores.scenario, scores.split, scores.policy)
        self.scores = [one for one in self.scores if (one.scenario, one.split, one.policy) != key]
        self.scores.append(scores)
        if self._path is not None:
            played, found = _lines(self.scores), _lines(findings(self.scores))
            write_result(self._path, f'{{"format": {FORMAT},\n"scores": [\n{played}\n],\n"findings": [\n{found}\n]}}\n')


def write_result(path: Path, text: str) -> None:
    """Write a file, whole or not at all.

    Raises:
        EvaluationError: It cannot be written.
    """
    try:
        write_whole(path, text)
    except OSError as reason:
        raise EvaluationError(f"{path}: {reason.strerror}; valid: a file that can be written") from reason


def _read(path: Path) -> list[SplitScores]:
    try:
        told = read_json(path)
        if not isinstance(told, dict) or told.get("format") != FORMAT:
            raise ValueError("it holds something else")
        found = [SplitScores(**one) for one in told["scores"]]
        if not all(_is_sound(one.figures) for one in found):
            raise TypeError("figures")
        return found
    except FileError as reason:  # names the file
        told, _, _ = str(reason).partition("; valid")
        raise EvaluationError(f"{told}; {_VALID}") from reason
    except (KeyError, TypeError) as reason:  # in Python's words
        raise EvaluationError(f"{path}: scores are missing or have other fields; {_VALID}") from reason
    except (OSError, ValueError) as reason:
        raise EvaluationError(f"{path}: {reason}; {_VALID}") from reason


def _is_sound(figures: object) -> bool:
    """Whether figures are numbers by name, as many of each, and some."""
    if not isinstance(figures, dict) or not figures:
        return False
    rows = [row for row in figures.values() if isinstance(row, list) and row and all(map(is_number, row))]
    return len(rows) == len(figures) and len(set(map(len, rows))) == 1


def _lines(found: Sequence[Any]) -> str:
    return ",\n".join(json.dumps(dataclasses.asdict(one)) for one in found)
