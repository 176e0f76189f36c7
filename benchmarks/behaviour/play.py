"""Play: runs one case here and leaves what it did as text: `python -m benchmarks.behaviour.play NAME FOLDER`.

Only what a user sees is touched: settings, sessions, simulations, environments and the command line. So the cases
outlive every change of what is behind.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import struct
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from fleet.config import RunConfig
    from fleet.simulation import Simulation

REPOSITORY = Path(__file__).resolve().parents[2]
FIGURES = "figures.json"
"""File of the figures of a case, beside one text file for each of its parts."""
LINES = ".txt"
WORK = "work"
"""Folder beside them, for whatever files a case needs and leaves."""
_RUN = Path("run")
_NOT_SETTLED = ("wall_s", "real_time_factor", "first_move_s", "planner_ms_mean", "planner_ms_max", "run", "versions")
"""Entries of a result that are others in every run or on every machine."""
_READABLE = ("tasks_done", "tasks_total", "sim_s", "throughput_per_h", "state_hash")
"""Entries of a result by which a person judges a difference."""
_CAUSES = ("causes", "causes_legend")
"""Kinds of the events that tell what each robot waits for."""
_WALL = re.compile(
    r"wall|real.time|planner.ms|planner, a call|first.(move|motion)"
    r"|^\W*time\W+[\d.]+ s\b|s simulated, \d+ of|^\d+ of \d+ runs done",
    re.IGNORECASE,
)
"""Lines of a command's output that tell how long it took, or how far it was when."""


@dataclass(kw_only=True)
class Played:
    """What a case did."""

    parts: dict[str, list[str]] = field(default_factory=dict)
    """Lines of text by the name of the part."""
    figures: dict[str, Any] = field(default_factory=dict)
    """What a person judges a difference by."""

    def write(self, folder: Path) -> None:
        """Write a text file for each part, and the figures."""
        for name, lines in self.parts.items():
            (folder / f"{name}{LINES}").write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        (folder / FIGURES).write_text(json.dumps(self.figures, indent=2) + "\n", encoding="utf-8")

    @staticmethod
    def read(folder: Path) -> Played:
        """What `write` left."""
        parts = {
            path.stem: path.read_text(encoding="utf-8").split("\n")[:-1] for path in sorted(folder.glob(f"*{LINES}"))
        }
        return Played(parts=parts, figures=json.loads((folder / FIGURES).read_text(encoding="utf-8")))


def main() -> int:
    """Play the case whose name is the first argument, in the folder that is the second."""
    from benchmarks.behaviour.cases import CASES

    name, folder = sys.argv[1], Path(sys.argv[2]).resolve()
    work = folder / WORK
    work.mkdir(parents=True, exist_ok=True)
    # Paths in messages are then the same wherever the folder is.
    os.chdir(work)
    CASES[name].play().write(folder)
    return 0


# --- Runs of a fleet


def run(config: RunConfig, **session: Any) -> Played:
    """Run a fleet to its end with all its files; without a recording unless asked for one."""
    from fleet.session import SessionConfig, run_session

    chosen: dict[str, Any] = {"out": _RUN, "record": False, "progress": False} | session
    run_session(config, SessionConfig(**chosen))
    return read_run(_RUN)


def read_run(folder: Path) -> Played:
    """What the files of a run tell that is the same whenever it is run again."""
    with (folder / "run.jsonl").open(encoding="utf-8") as file:
        events = [json.loads(line) for line in file]
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    for name in _NOT_SETTLED:
        result.pop(name, None)
    played = _logged([event for event in events if event["kind"] != "run"])
    played.parts["trace"] = _trace_lines((folder / "run.trace").read_bytes())
    played.parts["result"] = _entries(result)
    played.figures = {name: result[name] for name in _READABLE if name in result} | played.figures
    return played


def simulate(config: RunConfig, look: Callable[[Simulation, int], Iterator[str]], *, every_s: float) -> Played:
    """Run a fleet tick by tick, without files, and ask it something now and then.

    Args:
        config: What to run.
        look: Is given the simulation and how often it was called; may act, and yields what it was told.
        every_s: Simulated time between two calls [s].
    """
    from fleet.simulation import Simulation

    events: list[dict[str, Any]] = []
    said: list[str] = []

    def note(event: Any) -> None:
        events.append({"tick": event.tick, "sim_s": event.sim_s, "kind": event.kind, **event.facts})

    with Simulation(config, on_event=note) as simulation:
        n_calls = 0
        while not simulation.finished:
            if simulation.sim_s >= n_calls * every_s:
                said += (f"{simulation.sim_s:.3f} s: {line}" for line in look(simulation, n_calls))
                n_calls += 1
            simulation.tick()
        summary = dict(vars(simulation.summary()))
    played = _logged(events)
    played.parts["said"] = said
    played.parts["result"] = _entries(summary)
    played.figures = {name: summary[name] for name in _READABLE if name in summary} | played.figures
    return played


def tried(what: str, act: Callable[[], object]) -> str:
    """What came of a request: what it returned, or why it was refused."""
    try:
        said = act()
    except Exception as refusal:  # whatever it is called: the words are what a user reads
        return f"{what}: refused: {refusal}"
    return f"{what}: {'done' if said is None else said}"


@contextmanager
def physics_server() -> Iterator[int]:
    """A physics engine in a process of its own; gives the key by which it is reached."""
    serve = (
        "import sys, pybullet\n"
        "server = pybullet.connect(pybullet.SHARED_MEMORY_SERVER, key=int(sys.argv[1]))\n"
        "sys.stderr.write('ready\\n' if server >= 0 else 'refused\\n')\n"
        "sys.stderr.flush()\n"
        "sys.stdin.read()\n"
        "pybullet.disconnect(server)\n"
    )
    key = 100_000 + 2 * os.getpid()  # a server also takes the next key
    command = [sys.executable, "-c", serve, str(key)]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    if process.stderr is None:
        raise RuntimeError("the physics server has no output")
    for line in process.stderr:  # among what the engine prints
        if line.strip() == "ready":
            break
    else:
        raise RuntimeError("the physics server did not start")
    try:
        yield key
    finally:
        process.communicate()


def _logged(events: Sequence[Mapping[str, Any]]) -> Played:
    """Events and causes as lines, and how many there were of each kind."""
    kinds = Counter(str(event["kind"]) for event in events)
    texts = [(str(event["kind"]), json.dumps(_plain(event), sort_keys=True)) for event in events]
    parts = {"events": [text for kind, text in texts if kind not in _CAUSES]}
    causes = [text for kind, text in texts if kind in _CAUSES]
    if causes:
        parts["causes"] = causes
    return Played(parts=parts, figures={"kinds": dict(sorted(kinds.items()))})


def _entries(result: Mapping[str, Any]) -> list[str]:
    """A result, one entry in a line."""
    return [f"{name}: {json.dumps(_plain(value), sort_keys=True)}" for name, value in sorted(result.items())]


def _trace_lines(content: bytes) -> list[str]:
    """A trace after its head: the digest of each tick, the mark of each robot, and what has changed."""
    head, _, rest = content.partition(b"\n")
    about = json.loads(head)
    n_robots = about["cars"] + about["arms"]
    lines: list[str] = []
    tick = at = 0
    while at < len(rest):
        n_ticks, n_changes = struct.unpack_from("<II", rest, at)
        at += 8
        digests = np.frombuffer(rest, "<u8", n_ticks, at)
        at += digests.nbytes
        marks = np.frombuffer(rest, "<u2", n_ticks * n_robots, at).reshape(n_ticks, n_robots)
        at += marks.nbytes
        changes: dict[int, list[str]] = {}
        for of, robot, quantity, value in struct.iter_unpack("<iHBi", rest[at : at + 11 * n_changes]):
            changes.setdefault(of, []).append(f"{robot}.{quantity}={value}")
        at += 11 * n_changes
        for k in range(n_ticks):
            changed = " ".join(changes.get(tick, ()))
            shown = " ".join(f"{mark:04x}" for mark in marks[k])
            lines.append(f"tick {tick}: {digests[k]:016x} [{shown}] {changed}".rstrip())
            tick += 1
    return lines


# --- Commands


@dataclass(frozen=True, kw_only=True)
class Said:
    """What a command printed and with which status it ended."""

    status: int
    out: list[str]
    error: list[str]

    @property
    def lines(self) -> list[str]:
        """The status and the output."""
        return [f"exit status {self.status}", *self.out]


def command(*words: str, module: str = "fleet") -> Said:
    """Run `python -m MODULE WORDS` here; paths of this machine and lines about wall time are taken out of its output.

    Raises:
        RuntimeError: A signal ended it.
    """
    path = os.pathsep.join(filter(None, (str(REPOSITORY), os.environ.get("PYTHONPATH"))))
    surroundings = {**os.environ, "PYTHONPATH": path, "COLUMNS": "120", "NO_COLOR": "1", "TERM": "dumb"}
    done = subprocess.run(
        [sys.executable, "-m", module, *words], env=surroundings, capture_output=True, text=True, check=False
    )
    if done.returncode < 0:
        raise RuntimeError(f"{module} {' '.join(words)}: signal {-done.returncode}: {done.stderr.strip()[-300:]}")
    return Said(status=done.returncode, out=_without_machine(done.stdout), error=_without_machine(done.stderr))


def commands(*all_words: Sequence[str], errors: bool = False) -> list[str]:
    """Run commands one after the other; returns what they printed, with the words of each before it."""
    lines: list[str] = []
    for words in all_words:
        said = command(*words)
        lines += [f"$ {' '.join(words)}", *said.lines, *(said.error if errors else [])]
    return lines


def text_of(path: Path, *, without: str = "") -> list[str]:
    """Lines of a file that are the same whenever it is written again; `without` is a pattern of lines to leave out."""
    lines = _without_machine(path.read_text(encoding="utf-8"))
    return [line for line in lines if not (without and re.search(without, line))]


def json_of(path: Path, *without: str) -> list[str]:
    """Entries of a file with a JSON object, without some."""
    content = json.loads(path.read_text(encoding="utf-8"))
    return _entries({name: value for name, value in content.items() if name not in without})


def _without_machine(text: str) -> list[str]:
    for place in (str(Path(sys.executable).parent), str(Path.cwd()), str(REPOSITORY)):
        text = text.replace(place, ".")
    return [line.rstrip() for line in text.splitlines() if not _WALL.search(line)]


# --- Environments


def episode(env: Any, act: Callable[[Mapping[str, Any]], dict[str, Any]], n_steps: int, *, seed: int) -> list[str]:
    """Play some steps of a PettingZoo environment from its reset on; returns a line for each step."""
    observations, infos = env.reset(seed=seed)
    lines = [f"reset {seed}: {_marked(observations=observations, infos=infos, state=env.state())}"]
    for step in range(n_steps):
        if not env.agents:
            lines.append(f"step {step}: the episode has ended")
            break
        observations, line = _step(env, act(observations))
        lines.append(f"step {step}: {line}")
    return lines


def go_on(env: Any, observations: Mapping[str, Any], act: Callable[..., dict[str, Any]], n_steps: int) -> list[str]:
    """Play some more steps of an episode that is under way; returns a line for each step."""
    lines = []
    for step in range(n_steps):
        observations, line = _step(env, act(observations))
        lines.append(f"further step {step}: {line}")
    return lines


def chance(env: Any, seed: int) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    """Actions from the agents' spaces, each seeded; of masked ones only legal ones."""
    for number, agent in enumerate(env.possible_agents):
        env.action_space(agent).seed(1000 * seed + number)

    def act(observations: Mapping[str, Any]) -> dict[str, Any]:
        actions = {}
        for agent in env.agents:
            seen, space = observations[agent], env.action_space(agent)
            masked = isinstance(seen, Mapping) and "action_mask" in seen
            actions[agent] = space.sample(seen["action_mask"]) if masked else space.sample()
            if agent.startswith("car_") and not masked:
                actions[agent][-1] = abs(actions[agent][-1])  # forward: so cars get somewhere
        return actions

    return act


def scripted(env: Any, layer: str, name: str) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    """Actions of a policy that ships."""
    from fleet.envs.policies import make_policy

    policy = make_policy(layer, name, seed=1)

    def act(observations: Mapping[str, Any]) -> dict[str, Any]:
        return policy.act(env, observations)

    return act


def single(name: str, n_steps: int, *, seed: int, **arguments: Any) -> list[str]:
    """Play some steps of a gymnasium environment with actions by chance, episode after episode; a line for each."""
    import gymnasium

    env = gymnasium.make(f"fleet.envs:fleet/{name}", **arguments)
    env.action_space.seed(seed)
    observation, info = env.reset(seed=seed)
    lines = [f"reset: {_marked(observation=observation, info=info)}"]
    for step in range(n_steps):
        observation, reward, ended, cut, info = env.step(env.action_space.sample())
        told = _marked(observation=observation, end=(bool(ended), bool(cut)), info=info)
        lines.append(f"step {step}: reward {float(reward):.6g} {_marked(reward=reward)} {told}")
        if ended or cut:
            observation, info = env.reset()
            lines.append(f"reset: {_marked(observation=observation, info=info)}")
    env.close()
    return lines


def _step(env: Any, actions: dict[str, Any]) -> tuple[Mapping[str, Any], str]:
    observations, rewards, terminations, truncations, infos = env.step(actions)
    told = _marked(
        actions=actions,
        observations=observations,
        rewards=rewards,
        terminations=terminations,
        truncations=truncations,
        infos=infos,
        state=env.state(),
    )
    return observations, f"reward {sum(map(float, rewards.values())):.6g} {told}"


def _marked(**things: Any) -> str:
    """Each thing by a digest of its exact value."""
    shown = []
    for name, thing in things.items():
        digest = hashlib.sha256()
        _feed(digest, thing)
        shown.append(f"{name} {digest.hexdigest()[:8]}")
    return " ".join(shown)


def _feed(digest: Any, thing: Any) -> None:
    """Feed an exact value: mappings by sorted keys, arrays by shape, type and bytes."""
    if isinstance(thing, Mapping):
        for key in sorted(thing, key=str):
            digest.update(f"{key}:".encode())
            _feed(digest, thing[key])
    elif isinstance(thing, np.ndarray):
        digest.update(f"{thing.dtype}{thing.shape}".encode())
        digest.update(np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, np.generic):
        _feed(digest, thing.item())
    elif isinstance(thing, list | tuple):
        digest.update(f"{len(thing)}".encode())
        for item in thing:
            _feed(digest, item)
    else:
        digest.update(f"{type(thing).__name__}{thing!r}".encode())


def _plain(value: Any) -> Any:
    """What JSON knows of a value."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return _plain(vars(value))
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


if __name__ == "__main__":
    raise SystemExit(main())
