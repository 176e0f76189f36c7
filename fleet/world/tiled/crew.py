"""TileCrew: the tiles of a world, in this process or shared by several."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, NamedTuple, Protocol, cast

import numpy as np

from fleet.arrays import IntArray
from fleet.errors import BrokenRunError
from fleet.world.scene import Scene
from fleet.world.tiled.board import TileBoard
from fleet.world.tiled.config import TiledConfig
from fleet.world.tiled.split import Split
from fleet.world.tiled.tile import Tile

STEP = "step"
"""Asked of all tiles in every tick."""


class TileWorkerError(BrokenRunError):
    """A process that computes tiles has ended."""


class TileSetup(NamedTuple):
    """What tiles are made of."""

    scene: Scene
    split: Split
    config: TiledConfig


class TileCrew(Protocol):
    """Whoever has the tiles."""

    is_lost: bool
    """Whether a process has ended, and its tiles are gone."""

    def ask(self, tile: int, question: str, *words: Any) -> Any:
        """Call a method of a tile; returns or raises what that does."""

    def ask_all(self, question: str, *words: Any) -> list[Any]:
        """Call a method of all tiles; returns what they return, in their order."""

    def close(self) -> None:
        """Free them; calling twice is harmless."""


class LocalCrew:
    """Tiles of this process.

    Args:
        setup: What they are made of.
        board: Where they write.
        numbers: Which of them.
    """

    def __init__(self, setup: TileSetup, board: TileBoard, numbers: list[int]) -> None:
        self.is_lost = False
        self._tiles: dict[int, Tile] = {}
        try:
            for number in numbers:
                self._tiles[number] = Tile(number, setup.scene, setup.split, setup.config, board)
        except BaseException:
            self.close()
            raise

    def ask(self, tile: int, question: str, *words: Any) -> Any:
        """See `TileCrew`."""
        return getattr(self._tiles[tile], question)(*words)

    def ask_all(self, question: str, *words: Any) -> list[Any]:
        """See `TileCrew`."""
        return [getattr(tile, question)(*words) for tile in self._tiles.values()]

    def close(self) -> None:
        """See `TileCrew`."""
        for tile in self._tiles.values():
            tile.close()


class WorkerCrew:
    """Tiles of several processes, which work at the same time and end with this one.

    Where cars start decides which process has a tile, see `shares`; tiles never see one another within a tick, so the
    number of processes changes nothing.

    Args:
        setup: What the tiles are made of.
        board: Where they write.

    Raises:
        TileWorkerError: A process cannot be started, or ends.
    """

    def __init__(self, setup: TileSetup, board: TileBoard) -> None:
        n_workers = min(setup.config.n_workers, setup.split.n_tiles)
        self._n_tiles = setup.split.n_tiles
        self.is_lost = False
        self._workers: list[_Worker] = []
        self._shares = shares(np.bincount(board.tile_of, minlength=self._n_tiles), n_workers)
        self._worker_of = {tile: worker for worker, tiles in enumerate(self._shares) for tile in tiles}
        try:
            for tiles in self._shares:
                self._workers.append(_Worker(setup, board, tiles))
            self._heard(self._workers)
        except BaseException:
            self.close()
            raise

    def ask(self, tile: int, question: str, *words: Any) -> Any:
        """See `TileCrew`."""
        worker = self._workers[self._worker_of[tile]]
        worker.say((tile, question, words))
        return self._heard([worker])[0]

    def ask_all(self, question: str, *words: Any) -> list[Any]:
        """See `TileCrew`."""
        for worker in self._workers:
            worker.say((None, question, words))
        answers: list[Any] = [None] * self._n_tiles
        for tiles, heard in zip(self._shares, self._heard(self._workers), strict=True):
            for tile, answer in zip(tiles, heard, strict=True):
                answers[tile] = answer
        return answers

    def _heard(self, workers: list[_Worker]) -> list[Any]:
        """The answers of some workers; what one of them raises comes after all have been heard."""
        answers: list[Any] = []
        errors: list[Exception] = []
        for worker in workers:
            try:
                answers.append(worker.hear())
            except Exception as error:
                self.is_lost = self.is_lost or isinstance(error, TileWorkerError)
                errors.append(error)
        if errors:
            raise errors[0]
        return answers

    def close(self) -> None:
        """See `TileCrew`."""
        for worker in self._workers:
            worker.end()


def shares(n_cars: IntArray, n_workers: int) -> list[list[int]]:
    """Share tiles among processes, so that each has as many tiles as the others and about as many cars.

    A step takes as long as the process with the most to do: by the tiles' numbers alone, of two processes that share
    1,000 cars one had 30 % more. The tiles with the most cars are dealt out first, to each process one, and the larger
    of them to the one that has less so far.

    Args:
        n_cars: Cars that start in each tile, shape (n_tiles,).
        n_workers: Number of processes.

    Returns:
        The tiles of each, ascending.
    """
    tiles = np.argsort(-n_cars, kind="stable").tolist()
    dealt: list[list[int]] = [[] for _ in range(n_workers)]
    loads = [0] * n_workers
    for first in range(0, len(tiles), n_workers):
        lightest = sorted(range(n_workers), key=loads.__getitem__)
        for worker, tile in zip(lightest, tiles[first : first + n_workers], strict=False):
            dealt[worker].append(tile)
            loads[worker] += int(n_cars[tile])
    return [sorted(own) for own in dealt]


class _Worker:
    """One process of `fleet.world.tiled.worker`."""

    def __init__(self, setup: TileSetup, board: TileBoard, numbers: list[int]) -> None:
        self._numbers = numbers
        memory = board.file.fileno()
        os.set_inheritable(memory, True)
        try:
            # A session of its own: Ctrl-C reaches this process only, which then ends the workers in order.
            self._process = subprocess.Popen(
                [sys.executable, "-m", "fleet.world.tiled.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                cwd=Path(__file__).resolve().parents[3],
                pass_fds=(memory,),
                start_new_session=True,
            )
        except OSError as error:
            raise TileWorkerError(f"a process for tiles cannot be started: {error.strerror or error}") from error
        self.say((setup, board.sizes, memory, numbers))

    def say(self, message: object) -> None:
        """Hand over a message."""
        pipe = cast("IO[bytes]", self._process.stdin)
        with suppress(OSError, ValueError):  # `hear` says why
            pickle.dump(message, pipe, protocol=pickle.HIGHEST_PROTOCOL)
            pipe.flush()

    def hear(self) -> Any:
        """Wait for the answer."""
        try:
            failed, answer = pickle.load(cast("IO[bytes]", self._process.stdout))
        except (EOFError, OSError, ValueError, pickle.UnpicklingError) as error:
            self._process.kill()  # if it has not ended, what it says cannot be understood
            status = self._process.wait()
            raise TileWorkerError(
                f"the process that computes tiles {self._numbers} has ended with status {status}; valid: one that runs "
                "as long as the world, or --workers 1"
            ) from error
        if failed:
            raise answer
        return answer

    def end(self) -> None:
        """End the process."""
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                cast("IO[bytes]", pipe).close()
        try:
            self._process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
