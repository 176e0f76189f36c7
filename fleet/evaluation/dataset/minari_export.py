"""Minari: a data set of a single robot in the format of Farama's library, which has none for teams.

See https://minari.farama.org.
"""

from __future__ import annotations

import importlib
import importlib.util
import warnings
from typing import Any

import numpy as np

from fleet.evaluation.dataset.reading import Dataset
from fleet.evaluation.errors import DatasetError
from fleet.evaluation.scenarios import scenario_named
from fleet.training.solo import SoloEnv

EXTRA = "pip install '.[minari]'"


def require_minari(name: str, dataset_id: str) -> None:
    """Refuse what could not become a data set of Minari, before minutes are spent.

    Args:
        name: Of the scenario.
        dataset_id: Of the data set.

    Raises:
        DatasetError: Minari is not installed, the scenario is one of a team, or there is a data set of that name.
    """
    if importlib.util.find_spec("minari") is None:
        raise DatasetError(f"--minari needs Minari, which is not installed; valid: {EXTRA}")
    if not isinstance(_env(name), SoloEnv):
        raise DatasetError(f"--minari: scenario {name} is one of a team; valid: one of a single robot, such as reach")
    if dataset_id in importlib.import_module("minari").list_local_datasets():
        raise DatasetError(f"--minari {dataset_id}: is there already; valid: a name that is not")


def write_minari(dataset: Dataset, dataset_id: str) -> None:
    """Make a data set of Minari, among those of this machine.

    Args:
        dataset: Of a single robot.
        dataset_id: As Minari has it, such as `fleet/reach/script-v0`.

    Raises:
        DatasetError: Minari refuses it, as the name is malformed.
    """
    minari = importlib.import_module("minari")
    buffers = importlib.import_module("minari.data_collector")
    (steps,) = dataset.types.values()
    env = _env(str(dataset.about["scenario"]))
    episodes = []
    for number, seed in enumerate(dataset.about["seeds"]):
        own = np.flatnonzero(steps.episode == number)
        episodes.append(
            buffers.EpisodeBuffer(
                id=number,
                seed=seed,
                observations=np.concatenate((steps.rows[own], steps.next_rows[own[-1:]])),
                actions=steps.actions[own],
                rewards=steps.rewards[own].tolist(),
                terminations=steps.terminated[own].tolist(),
                truncations=steps.truncated[own].tolist(),
                infos=None,
            )
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of authors and the like that are not told
            minari.create_dataset_from_buffers(
                dataset_id,
                buffer=episodes,
                observation_space=env.env.observation_space,
                action_space=env.env.action_space,
                algorithm_name=str(dataset.about["policy"]),
                description=f"{dataset.about['scenario']} of fleet, commit {dataset.about['commit']}",
            )
    except ValueError as reason:
        raise DatasetError(f"--minari {dataset_id}: {reason}; valid: NAMESPACE/NAME-v0") from reason


def _env(name: str) -> Any:
    scenario = scenario_named(name)
    env = scenario.make(scenario.splits["train"][0])
    env.close()
    return env
