"""The train command: agents learn, and what they learned is measured against a script and chance."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table

from fleet.cli.run_output import PLAIN_WIDTH, plain_console
from fleet.config import require
from fleet.terminal.interrupts import interrupts
from fleet.terminal.progress_bar import Bar
from fleet.training.errors import TrainingError
from fleet.training.recipes import RECIPES

if TYPE_CHECKING:
    from fleet.envs.policies.policy import Policy
    from fleet.training.ppo.trainer import Trainer
    from fleet.training.recipes import Recipe
    from fleet.training.settings import TrainConfig

DONE, INTERRUPTED = 0, 130
EXTRA = "pip install '.[train]'"
_EVALUATION = 3
"""Branch of the seed from which the episodes of the evaluation come."""


@dataclass(frozen=True, kw_only=True)
class Train:
    """Train agents with PPO; prints how they do against a script and chance, writes curves and a checkpoint."""

    env: Annotated[
        str,
        tyro.conf.arg(
            help=f"What is learned: {'; '.join(f'{name} ({one.summary})' for name, one in RECIPES.items())}."
        ),
    ] = "navigate"
    seed: int = 0
    """Seed of everything random."""
    steps: int | None = None
    """Steps of agents, the last update's whole; default that of the environment's recipe."""
    fidelity: str | None = None
    """How robots are moved, of those that the environment knows; default its own."""
    config: Path | None = None
    """TOML file with steps_n, checkpoint_n, tables [ppo] (settings of the algorithm) and [env] (its arguments)."""
    demonstrations: Path | None = None
    """File of what a teacher did, which is cloned first."""
    start_from: tuple[Path, ...] = ()
    """Folder of another run of this command, as whose agents these begin."""
    episodes: int = 20
    """Episodes that each policy plays in the evaluation."""
    out: Path = Path("runs/train")
    """Directory for checkpoint, curves and evaluation."""
    resume: bool = False
    """Go on from the checkpoint in the directory, with the same settings; begin if there is none yet."""

    def run(self) -> int:
        """Train, evaluate and print; returns the exit status."""
        require(self.env in RECIPES, "--env", self.env, ", ".join(RECIPES))
        require(self.episodes >= 1, "--episodes", self.episodes, "an integer >= 1")
        if importlib.util.find_spec("torch") is None:
            raise TrainingError(f"training needs PyTorch, which is not installed; valid: {EXTRA}")
        recipe = RECIPES[self.env]
        return self._train(self._config(recipe), recipe)

    def _config(self, recipe: Recipe) -> TrainConfig:
        from fleet.training.settings import TrainConfig, read_settings

        told: dict[str, Any] = read_settings(self.config) if self.config is not None else {}
        asked = told.pop("env", {})
        if self.fidelity is not None:
            asked["fidelity"] = self.fidelity
        arguments = {**recipe.arguments, **asked}
        ppo = dataclasses.replace(recipe.ppo, **told.pop("ppo", {}))
        settings = {"steps_n": recipe.n_steps, **told}
        if self.steps is not None:
            settings["steps_n"] = self.steps
        if self.demonstrations is not None:
            settings["demonstrations"] = str(self.demonstrations)
        if self.start_from:
            settings["start_from"] = tuple(map(str, self.start_from))
        return TrainConfig(
            env=self.env, seed=self.seed, arguments=arguments, held=tuple(sorted(asked)), ppo=ppo, **settings
        )

    def _train(self, config: TrainConfig, recipe: Recipe) -> int:
        from fleet.recording.rerun_stream.curves import write_curves
        from fleet.training.ppo.trainer import Trainer
        from fleet.training.results import (
            CHECKPOINT,
            RECORDING,
            append_progress,
            draw_progress,
            prepare_folder,
            write_config,
            write_progress,
        )

        chief = recipe.figures[0]
        trainer = Trainer(config, self.out, resume=self.resume)
        # Nothing is written before the trainer has agreed with what it is given and what is there.
        prepare_folder(self.out, resume=self.resume)
        write_config(self.out, config, recipe.stages)
        write_progress(self.out, trainer.rows)
        curves, end_curves = _tensorboard(self.out, trainer.rows)
        try:
            with interrupts() as interrupted, Bar(config.steps_n, "steps", shown=True) as bar:

                def progress(row: Mapping[str, float]) -> None:
                    append_progress(self.out, row)
                    curves(row)
                    if bar.due():
                        steps = int(row["steps"])
                        known = not math.isnan(row[chief])
                        figure = f"{chief} {row[chief]:.3g}" if known else "no episode has ended yet"
                        if len(recipe.stages) > 1:
                            figure = f"{recipe.stages[int(row['stage']) - 1].name}: {figure}"
                        bar.show(min(steps, config.steps_n), figure, f"{steps} of {config.steps_n} steps, {figure}")

                complete = trainer.run(progress, interrupted)
        finally:
            trainer.close()
            end_curves()
        console = plain_console(columns=PLAIN_WIDTH)
        if not complete:
            since = (
                "goes on from the last checkpoint"
                if (self.out / CHECKPOINT).exists()
                else "begins anew: no checkpoint yet"
            )
            console.print(f"interrupted: --resume {since}", soft_wrap=True)
            return INTERRUPTED
        draw_progress(self.out, trainer.rows, chief)
        write_curves(self.out / RECORDING, f"{config.env}, seed {config.seed}", trainer.rows)
        return self._evaluate(config, recipe, trainer, console)

    def _evaluate(self, config: TrainConfig, recipe: Recipe, trainer: Trainer, console: Console) -> int:
        import numpy as np

        from fleet.envs.policies.policy import Random
        from fleet.training.evaluation import evaluate
        from fleet.training.results import LEARNED, RANDOM, SCRIPTED, findings, write_episodes, write_evaluation

        sequence = np.random.SeedSequence([config.seed, _EVALUATION])
        seeds = [int(seed) for seed in sequence.generate_state(self.episodes) // 2]
        ways = {LEARNED if k == 0 else f"{LEARNED}, {way}": way for k, way in enumerate(recipe.plays)}
        policies: dict[str, Policy] = {
            name: trainer.policy(config.seed if way == "drawn" else None) for name, way in ways.items()
        }
        policies |= {SCRIPTED: recipe.scripted(), RANDOM: Random(config.seed)}
        total = len(policies) * len(seeds)
        with Bar(total, "episodes", shown=True) as bar:

            def progress(done: int) -> None:
                if bar.due():
                    bar.show(done, "evaluation", f"{done} of {total} episodes of the evaluation")

            scores = evaluate(recipe, config.arguments, policies, seeds, progress)
        found = findings(scores, (*recipe.figures, *recipe.at_end), shares=recipe.shares)
        write_episodes(self.out, scores, seeds)
        write_evaluation(self.out, found, cpu_s=trainer.cpu_s)
        console.print(_table(config, recipe, found))
        console.print(f"results: {self.out}", soft_wrap=True)
        return DONE


def _tensorboard(
    folder: Path, before: list[dict[str, float]]
) -> tuple[Callable[[Mapping[str, float]], None], Callable[[], None]]:
    """What writes a row of figures for TensorBoard, and what ends it; nothing is done where it is not installed."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return lambda row: None, lambda: None
    writer = SummaryWriter(str(folder / "tensorboard"), purge_step=int(before[-1]["steps"]) + 1 if before else None)

    def write(row: Mapping[str, float]) -> None:
        for name, value in row.items():
            if name not in ("update", "steps") and not math.isnan(value):
                writer.add_scalar(name, value, int(row["steps"]))

    return write, writer.close


def _table(config: TrainConfig, recipe: Recipe, found: Mapping[str, Any]) -> Table:
    from fleet.training.intervals import Interval, heading

    n_episodes = found["episodes"]
    table = Table(title=f"{config.env}, seed {config.seed}: {heading(n_episodes)}")
    table.add_column("policy")
    names = (*recipe.figures, *recipe.at_end, "return")
    for name in names:
        table.add_column(name, justify="right")
    for policy, figures in found["policies"].items():
        table.add_row(policy, *(Interval(**figures[name]).of(n_episodes) for name in names))
    for policy, figures in found["gain"].items():
        table.add_row(f"learned - {policy}", *(Interval(**figures[name]).of(n_episodes) for name in names))
    return table
