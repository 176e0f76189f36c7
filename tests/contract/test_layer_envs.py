"""What the environments of the dispatch and of the traffic layer owe the libraries that train on them."""

from __future__ import annotations

import copy
import math
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.abstract.kernel import NEVER
from fleet.config import StreamConfig
from fleet.envs import dispatch_v1, traffic_v1
from fleet.envs.core.base import ActionError, EnvState, EpisodeError, StateError
from fleet.envs.dispatch.env import TERMS as DISPATCH_TERMS
from fleet.envs.dispatch.env import DispatchWeights
from fleet.envs.layers.layer import LayerEnv
from fleet.envs.policies import POLICIES, make_policy
from fleet.envs.traffic.env import TERMS as TRAFFIC_TERMS
from fleet.errors import ConfigError, FleetError
from maps.errors import MapsError
from maps.warehouse import generate_warehouse

ENVS = {"dispatch": dispatch_v1, "traffic": traffic_v1}
TERMS = {"dispatch": DISPATCH_TERMS, "traffic": TRAFFIC_TERMS}
MORE: dict[str, tuple[str, ...]] = {"dispatch": (), "traffic": ("pushed",)}
N_CYCLES = {"dispatch": 60, "traffic": 120}
Maker = Callable[..., LayerEnv]


@pytest.fixture(params=ENVS)
def layer(request: pytest.FixtureRequest) -> str:
    """Return the name of one layer."""
    return str(request.param)


@pytest.fixture
def make(layer: str) -> Iterator[Maker]:
    """Return a maker of environments that are closed after the test."""
    made: list[LayerEnv] = []

    def one(**arguments: Any) -> LayerEnv:
        arguments = {"site": "small", "n_cars": 4, "max_cycles": N_CYCLES[layer]} | arguments
        made.append(ENVS[layer].parallel_env(**arguments))
        return made[-1]

    yield one
    for env in made:
        env.close()
        env.close()


def chosen(observations: dict[str, Any], rng: np.random.Generator) -> dict[str, int]:
    """Return any legal action of every agent."""
    return {agent: int(rng.choice(np.flatnonzero(seen["action_mask"]))) for agent, seen in observations.items()}


def episode(env: LayerEnv, seed: int | None, n_steps: int | None = None) -> list[Any]:
    """Play one episode, or its first steps, and return all that the environment said."""
    rng = np.random.default_rng(0)
    said: list[Any] = [env.reset(seed=seed)]
    observations = said[0][0]
    while env.agents and n_steps != len(said) - 1:
        told = env.step(chosen(observations, rng))
        observations = told[0]
        said.append((*told, env.state()))
    return said


# --- Spaces, seeds, copies


@pytest.mark.parametrize("fidelity", ["grid", "kinematic"])
def test_every_step_keeps_to_the_spaces_and_the_team(layer: str, make: Maker, fidelity: str) -> None:
    env = make(fidelity=fidelity, max_cycles=30)
    team, rng = env.possible_agents, np.random.default_rng(1)
    observations, infos = env.reset(seed=4)
    for n in range(1, 31):
        assert list(observations) == list(infos) == env.agents == team
        for agent, seen in observations.items():
            assert env.observation_space(agent).contains(seen)
            assert seen["action_mask"][0] == 1
        assert env.state_space.contains(env.state())
        observations, rewards, terminations, truncations, infos = env.step(chosen(observations, rng))
        assert set(terminations.values()) == {False}
        assert set(truncations.values()) == {n == 30}
        for agent in team:
            assert set(infos[agent]) == {*TERMS[layer], *MORE[layer], "waits", "illegal"}
            assert rewards[agent] == pytest.approx(sum(infos[agent][term] for term in TERMS[layer]))
            assert infos[agent]["illegal"] is False
    assert env.agents == []
    with pytest.raises(EpisodeError, match="reset"):
        env.step({})


def test_observations_are_the_caller_s_own(make: Maker) -> None:
    env, twin = make(), make()
    observations, _ = env.reset(seed=0)
    twin.reset(seed=0)
    for seen in observations.values():
        seen["observation"][:] = 7.0
        seen["action_mask"][:] = 0
    assert np.array_equal(env.state(), twin.state())
    _, _, _, _, infos = env.step(dict.fromkeys(env.agents, 1))
    assert infos == twin.step(dict.fromkeys(twin.agents, 1))[4]


def test_orders_come_as_the_stream_has_it(make: Maker) -> None:
    usual, same = episode(make(load=0.9), 3, 20), episode(make(load=0.9, stream={"kind": "poisson"}), 3, 20)
    np.testing.assert_equal(same, usual)
    np.testing.assert_equal(episode(make(load=0.9, stream=StreamConfig()), 3, 20), usual)
    other = make(load=0.9, stream={"due_share": 0.0, "slack_s": [1.0, 2.0]})
    other.reset(seed=3)
    assert (other.fleet.grid.tasks.due == NEVER).all()


@pytest.mark.parametrize(
    ("stream", "message"),
    [
        ("waves", "valid: a StreamConfig, or a dictionary of its settings"),
        ({"kind": "flood"}, "valid: poisson"),
        ({"rate_per_h": 9.0}, "stream is 'rate_per_h'; valid: kind, wave_s"),
        ({"bottleneck_share": 2.0}, "valid: a number from 0 to 1"),
    ],
)
def test_streams_that_are_none_are_refused(make: Maker, stream: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make(stream=stream)


def test_same_seed_same_episodes(make: Maker) -> None:
    one, two = make(max_cycles=600), make(max_cycles=600, seed=9)
    first = episode(one, 3)
    np.testing.assert_equal(episode(two, 3), first)
    # The series goes on alike, and begins anew with its seed.
    second = episode(one, None, 100)
    np.testing.assert_equal(episode(two, None, 100), second)
    np.testing.assert_equal(episode(one, 3, 100), first[:101])
    assert not np.array_equal(first[100][-1], second[100][-1])


def test_same_seed_same_episode_of_the_whole_fleet(make: Maker) -> None:
    first = episode(make(fidelity="kinematic"), 3, 25)
    np.testing.assert_equal(episode(make(fidelity="kinematic"), 3, 25), first)


SHOW_HASH = """
import hashlib, numpy as np
from fleet.envs import {module} as layer
env = layer.parallel_env(n_cars=5)
env.reset(seed=5)
digest = hashlib.sha256()
for n in range(120):
    env.step({{agent: n % 5 for agent in env.agents}})
    digest.update(env.state().tobytes())
print(digest.hexdigest())
"""


def test_same_seed_same_episode_in_another_process(
    layer: str, repository: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = SHOW_HASH.format(module=ENVS[layer].__name__.rpartition(".")[2])
    there = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, check=True)
    exec(code, {})
    assert capsys.readouterr().out == there.stdout != ""


def test_copies_are_made_by_the_arguments(make: Maker) -> None:
    site = generate_warehouse(rows=12, cols=16, pick=1, drop=1, parking=4)
    env = make(site=site, load=2.0, max_cycles=20)
    played = episode(env, 6)
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert twin.agents == []
        np.testing.assert_equal(episode(twin, 6), played)
        twin.close()


@pytest.mark.parametrize(("fidelity", "n_before"), [("grid", 40), ("kinematic", 15)])
def test_a_saved_moment_comes_back_exactly(make: Maker, tmp_path: Path, fidelity: str, n_before: int) -> None:
    env = make(fidelity=fidelity)
    said = episode(env, 2, n_before)
    state = env.save_state()
    rng = np.random.default_rng(5)
    observations, plays, told = said[-1][0], [], []
    for _ in range(10):
        plays.append(chosen(observations, rng))
        told.append(env.step(plays[-1]))
        observations = told[-1][0]
    state.write(tmp_path / "moment")
    episode(env, 8, 5)  # another episode in between
    other = make(fidelity=fidelity)
    for player, moment in ((env, state), (env, state), (other, EnvState.read(tmp_path / "moment"))):
        np.testing.assert_equal(player.load_state(moment), said[-1][0])
        np.testing.assert_equal([player.step(play) for play in plays], told)
    with pytest.raises(StateError, match="n_cars"):
        make(fidelity=fidelity, n_cars=3).load_state(state)


def test_illegal_actions_do_nothing_and_are_flagged(make: Maker) -> None:
    env, idle = make(), make()
    observations, _ = env.reset(seed=2)
    idle.reset(seed=2)
    for _ in range(10):
        wrong = {"car_0": 99, "car_1": -1, "car_2": math.nan, "car_3": 0.5}
        *_, infos = env.step(wrong)
        assert [info["illegal"] for info in infos.values()] == [True] * 4
        observations, *_, infos = idle.step({"car_0": np.int64(0), "car_1": np.array([0]), "car_2": 0, "car_3": 0.0})
        assert [info["illegal"] for info in infos.values()] == [False] * 4
        assert np.array_equal(env.state(), idle.state())
    observations, *_ = env.step(dict.fromkeys(env.agents, 1))
    agent, masked = next(
        (agent, int(np.argmin(seen["action_mask"])))
        for agent, seen in observations.items()
        if not all(seen["action_mask"])
    )
    *_, infos = env.step({agent: masked})
    assert infos[agent]["illegal"] is True


@pytest.mark.parametrize("action", ["left", [1, 2], {}, 1j])
def test_actions_of_the_wrong_kind_are_refused_and_change_nothing(make: Maker, action: object) -> None:
    env, twin = make(), make()
    env.reset(seed=2)
    twin.reset(seed=2)
    with pytest.raises(ActionError, match="car_1"):
        env.step({"car_0": 0, "car_1": action})
    with pytest.raises(ActionError, match="nobody_7"):
        env.step({"nobody_7": 0})
    np.testing.assert_equal(env.step({}), twin.step({}))


def test_calls_in_the_wrong_order_are_refused(make: Maker) -> None:
    env = make()
    for call in (lambda: env.step({}), env.state, env.save_state, lambda: env.view):
        with pytest.raises(EpisodeError, match="reset"):
            call()


def test_policies_that_look_at_the_fleet_need_an_episode(layer: str, make: Maker) -> None:
    for name in POLICIES[layer].keys() - {"random", "nearest"}:  # which only look at what they are shown
        env = make()
        for k in range(2):
            with pytest.raises(EpisodeError, match="reset"):
                make_policy(layer, name).act(env, {})
            if k == 0:
                env.reset(seed=0)
                env.close()


@pytest.mark.parametrize("max_cycles", [1, 3])
def test_the_shortest_episodes_have_an_order_for_each_car(make: Maker, max_cycles: int) -> None:
    env = make(n_cars=2, max_cycles=max_cycles)
    for seed in range(5):
        env.reset(seed=seed)
        while env.agents:
            env.step({})
        assert env.n_steps == max_cycles


def test_calls_that_mean_nothing_are_refused_and_the_episode_goes_on(make: Maker, tmp_path: Path) -> None:
    env = make(n_cars=2)
    env.reset(seed=0)
    with pytest.raises(ActionError, match="actions are a list; valid: a dictionary"):
        env.step([0, 0])
    for seed in (-1, 1.5, "one", math.nan):
        with pytest.raises(ConfigError, match="seed is"):
            env.reset(seed=seed)
    with pytest.raises(StateError, match="the state is a int"):
        env.load_state(3)
    with pytest.raises(StateError, match="can be written"):
        env.save_state().write(tmp_path / "no" / "folder")
    env.save_state().write(str(tmp_path / "moment"))
    whole = (tmp_path / "moment").read_bytes()
    for n in range(0, len(whole) - 1, 7):
        (tmp_path / "moment").write_bytes(whole[:n] + bytes([whole[n] ^ 1]) + whole[n + 1 :])
        with pytest.raises(StateError, match="it is damaged"):
            EnvState.read(tmp_path / "moment")
    env.step({})


def test_a_folder_that_cannot_be_recorded_to_is_refused_and_no_episode_begins(make: Maker, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    env = make(n_cars=2, render_mode="rerun", record_to=tmp_path / "file")
    with pytest.raises(FleetError, match="cannot be made"):
        env.reset(seed=0)
    with pytest.raises(EpisodeError, match="reset"):
        env.step({})
    (tmp_path / "file").unlink()
    env.reset(seed=0)
    env.step({})
    env.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"n_cars": 99}, "parking cells of site small"),
        ({"n_cars": 0}, "1 to 18"),
        ({"n_cars": 2.0}, "1 to 18"),
        ({"n_cars": True}, "1 to 18"),
        ({"fidelity": "real"}, "physics, mixed, kinematic, grid"),
        ({"load": 0.0}, "> 0"),
        ({"load": math.nan}, "> 0"),
        ({"load": True}, "> 0"),
        ({"max_cycles": 0}, ">= 1"),
        ({"max_cycles": True}, ">= 1"),
        ({"seed": -1}, ">= 0"),
        ({"seed": True}, ">= 0"),
        ({"render_mode": "ansi"}, "rgb_array"),
        ({"site": 7}, "a name"),
        ({"record_to": 3}, "record_to is 3; valid: a path"),
        ({"weights": {"lost": 1.0}}, "Weights, or None"),
        ({"site": generate_warehouse(rows=12, cols=16, pick=1, drop=1, parking=4), "fidelity": "physics"}, "save_site"),
    ],
)
def test_bad_arguments_are_refused(make: Maker, arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        make(**arguments)


def test_unknown_sites_and_arguments_are_refused(make: Maker) -> None:
    with pytest.raises(MapsError, match="nowhere"):
        make(site="nowhere")
    with pytest.raises(TypeError, match="robots"):
        make(robots=3)
    with pytest.raises(ConfigError, match="1 to 64"):
        dispatch_v1.parallel_env(candidates_n=0)
    for odd in (2.5, True):
        with pytest.raises(ConfigError, match="whole number"):
            dispatch_v1.parallel_env(decision_s=odd)
    for wrong, words in (
        ({"breakdowns_per_h": -1.0}, "breakdowns_per_h is -1.0; valid: a number from 0"),
        ({"breakdowns_per_h": 1.0, "fidelity": "kinematic"}, "breakdowns_per_h is 1.0; valid: 0 but for fidelity grid"),
        ({"repair_s": 0.0}, "repair_s is 0.0; valid: a number > 0"),
        ({"lost_share": 1.5}, "lost_share is 1.5; valid: a number from 0 to 1"),
        ({"battery_s": -1.0}, "battery_s is -1.0; valid: a number from 0"),
        ({"battery_s": 9.0, "fidelity": "kinematic"}, "battery_s is 9.0; valid: 0 but for fidelity grid"),
        ({"battery_s": 9.0, "site": "dense"}, "battery_s is 9.0; valid: 0 as site dense has no chargers"),
        ({"charge_s": 0}, "charge_s is 0; valid: a number > 0"),
    ):
        with pytest.raises(ConfigError, match=words):
            dispatch_v1.parallel_env(**wrong)
    with pytest.raises(ConfigError, match="weight lost is True; valid: a number"):
        DispatchWeights(lost=True)


# --- Agents at work


def played(env: LayerEnv, layer: str, policy: str, seed: int = 0) -> tuple[int, float]:
    """Play an episode; returns deliveries and the sum of all rewards."""
    mind, total = make_policy(layer, policy), 0.0
    observations, _ = env.reset(seed=seed)
    while env.agents:
        observations, rewards, *_ = env.step(mind.act(env, observations))
        total += sum(rewards.values())
    return env.n_delivered, total


@pytest.mark.parametrize("name", [name for name in POLICIES["dispatch"] if name != "random"])
def test_every_dispatch_policy_beats_chance(name: str) -> None:
    site = generate_warehouse(rows=36, cols=16, pick=6, drop=6, parking=12)
    env = dispatch_v1.parallel_env(site=site, n_cars=8, max_cycles=200)
    assert played(env, "dispatch", name)[1] > 1.05 * played(env, "dispatch", "random")[1]


@pytest.mark.parametrize("name", [name for name in POLICIES["traffic"] if name != "random"])
def test_every_traffic_policy_beats_chance(name: str) -> None:
    env = traffic_v1.parallel_env(n_cars=6, max_cycles=300)
    assert played(env, "traffic", name)[0] >= 10 > played(env, "traffic", "random")[0]


def test_pibt_as_a_policy_is_always_granted() -> None:
    env = traffic_v1.parallel_env(site="small", n_cars=14, max_cycles=200)
    mind = make_policy("traffic", "pibt")
    observations, _ = env.reset(seed=0)
    while env.agents:
        observations, *_, infos = env.step(mind.act(env, observations))
        assert not any(info["waits"] or info["pushed"] for info in infos.values())


@pytest.mark.parametrize(("layer", "policy"), [("dispatch", "hungarian"), ("traffic", "pibt")])
def test_the_grid_tells_what_the_whole_fleet_does(layer: str, policy: str) -> None:
    n_cycles = {"dispatch": 60, "traffic": 300}[layer]  # five minutes
    delivered = [
        played(ENVS[layer].parallel_env(site="small", n_cars=4, fidelity=fidelity, max_cycles=n_cycles), layer, policy)
        for fidelity in ("grid", "kinematic")
    ]
    assert abs(delivered[0][0] - delivered[1][0]) <= 3
    assert min(delivered)[0] >= 10


def test_two_cars_that_choose_one_task_are_told_who_waits() -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=4, max_cycles=10)
    observations, _ = env.reset(seed=0)
    firsts = env.candidates[:, 0]
    *_, infos = env.step({agent: int(seen["action_mask"][1]) for agent, seen in observations.items()})
    losers = [car for car in range(4) if infos[f"car_{car}"]["waits"]]
    winners = [car for car in range(4) if car not in losers]
    assert losers, "four cars side by side have the same nearest task"
    assert len({firsts[car] for car in winners}) == len(winners)
    # Of equal rank the lower index goes first; who lost comes first the next time.
    assert all(any(firsts[winner] == firsts[loser] and winner < loser for winner in winners) for loser in losers)
    assert DispatchWeights().lost == infos[f"car_{losers[0]}"]["lost"]


@pytest.mark.parametrize("policy", ["random", "shortest_way", "multi_step_pibt"])
def test_nobody_collides_whatever_agents_choose(policy: str) -> None:
    env = traffic_v1.parallel_env(site="small", n_cars=12, fidelity="kinematic", max_cycles=60)
    played(env, "traffic", policy)
    fleet = env.fleet
    assert fleet.simulation.world.contacts().robot == 0
    assert fleet.simulation.world.min_clearance_m() > 0.1
    env.close()
