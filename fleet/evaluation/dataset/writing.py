"""Writing: a policy plays, and every step goes to a data set that is whole or not there."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from gymnasium.spaces import Discrete

from fleet.evaluation.dataset.layout import ABOUT, FORMAT, INFO, STEPS
from fleet.evaluation.episodes import Observations, play_episode
from fleet.evaluation.errors import DatasetError, PolicyError
from fleet.evaluation.players import Player
from fleet.evaluation.scenarios import FIRST_SEED, Case, scenario_named
from fleet.recording import commit, versions
from fleet.training.batch import type_of, vector
from maps.reading.shown import shown


def write_dataset(
    folder: Path,
    name: str,
    split: str,
    player: Player,
    seeds: range,
    on_episode: Callable[[], None] = lambda: None,
) -> None:
    """Play episodes and keep every step.

    Args:
        folder: Of the data set; it is made, and is not there if anything goes wrong.
        name: Of the scenario.
        split: Whose cases are played, in turn.
        player: Who plays.
        seeds: Of the episodes, below those of evaluations.
        on_episode: Called after each episode; what it raises ends the writing.

    Raises:
        DatasetError: The folder is there or cannot be written, or the seeds are those of evaluations.
        PolicyError: The policy cannot play the scenario, or failed in it.
    """
    if seeds.stop > FIRST_SEED:
        raise DatasetError(
            f"seeds to {seeds.stop - 1}; valid: less than {FIRST_SEED}, where those of evaluations begin"
        )
    scenario = scenario_named(name)
    envs: dict[Case, Any] = {}
    figures = []
    try:
        with _whole(folder) as part:
            for case in scenario.splits[split]:
                envs[case] = scenario.make(case)
                player.check(scenario, envs[case])
            with _StepWriter(part / STEPS) as writer:
                for episode, seed in enumerate(seeds):
                    env = envs[scenario.case_of(split, episode)]
                    writer.begin(env, episode)
                    tally, _ = play_episode(env, player, seed, writer.note)
                    writer.end()
                    figures.append({measure: round(how.of(tally), 6) for measure, how in scenario.measures.items()})
                    on_episode()
            about = {
                "format": FORMAT,
                "scenario": name,
                "split": split,
                "env": scenario.env,
                "definition": scenario.definition(split),
                "policy": player.name,
                "policy_digest": player.digest,
                "seeds": list(seeds),
                "figures": figures,
                "commit": commit(),
                "versions": versions(),
            }
            (part / ABOUT).write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    finally:
        for env in envs.values():
            env.close()


@contextmanager
def _whole(folder: Path) -> Iterator[Path]:
    """A folder beside this one, which takes its name when all has gone well, and is gone otherwise."""
    if folder.exists():
        raise DatasetError(f"--out {folder}: is there already; valid: a folder that is not")
    part = folder.with_name(f".{folder.name}.part")
    try:
        shutil.rmtree(part, ignore_errors=True)  # of a run that was killed
        part.mkdir(parents=True)
        yield part
        part.rename(folder)
    except OSError as reason:
        raise DatasetError(f"--out {folder}: {reason.strerror}; valid: a folder that can be written") from reason
    finally:
        shutil.rmtree(part, ignore_errors=True)


class _StepWriter:
    """Collects the rows of an episode, and writes them as a group when it has ended.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: pq.ParquetWriter | None = None

    def __enter__(self) -> _StepWriter:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def begin(self, env: Any, episode: int) -> None:
        """An episode of an environment begins."""
        self._episode, self._step = episode, 0
        self._rows: list[dict[str, Any]] = []
        self._discrete = all(isinstance(env.action_space(agent), Discrete) for agent in env.possible_agents)

    def note(self, observations: Observations, actions: Mapping[str, Any], returned: tuple[Any, ...]) -> None:
        """A step was made; see `OnStep`."""
        after, rewards, terminations, truncations, infos = returned
        for agent, seen in observations.items():
            row = self._seen(agent, seen, self._step)
            if agent in actions:
                row["action"] = self._told(agent, actions[agent])
            row["reward"] = rewards[agent]
            row["terminated"], row["truncated"] = bool(terminations[agent]), bool(truncations[agent])
            row |= {f"{INFO}{key}": float(value) for key, value in infos[agent].items()}
            self._rows.append(row)
            if row["terminated"] or row["truncated"]:
                self._rows.append(self._seen(agent, after[agent], self._step + 1))
        self._step += 1

    def _told(self, agent: str, action: Any) -> int | list[float]:
        """An action, as the file has it."""
        try:
            return int(action) if self._discrete else [float(part) for part in action]
        except (TypeError, ValueError, OverflowError) as reason:
            valid = "a whole number" if self._discrete else "a row of numbers"
            raise PolicyError(f"action of {agent} is {shown(action)}; valid in a data set: {valid}") from reason

    def end(self) -> None:
        """The episode has ended: write its rows."""
        self._file = self._file or pq.ParquetWriter(self._path, self._schema(), compression="zstd")
        self._file.write_table(pa.Table.from_pylist(self._rows, schema=self._file.schema))

    def _seen(self, agent: str, seen: Any, step: int) -> dict[str, Any]:
        mask = seen["action_mask"] if isinstance(seen, Mapping) else None
        return {
            "episode": self._episode,
            "step": step,
            "agent": agent,
            "type": type_of(agent),
            "observation": vector(seen),
            "mask": mask,
            "terminated": False,
            "truncated": False,
        }

    def _schema(self) -> pa.Schema:
        told = dict.fromkeys(key for row in self._rows for key in row if key.startswith(INFO))
        columns = {
            "episode": pa.int32(),
            "step": pa.int32(),
            "agent": pa.string(),
            "type": pa.string(),
            "observation": pa.list_(pa.float32()),
            "mask": pa.list_(pa.int8()),
            "action": pa.int32() if self._discrete else pa.list_(pa.float32()),
            "reward": pa.float64(),
            **dict.fromkeys(told, pa.float64()),
            "terminated": pa.bool_(),
            "truncated": pa.bool_(),
        }
        return pa.schema(list(columns.items()))
