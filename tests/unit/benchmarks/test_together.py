"""Together: teams whose cars and arms were trained apart."""

from typing import Any

from benchmarks.training.whole.together import TeamByType


class Says:
    """Says the same to all agents that it is shown."""

    def __init__(self, word: str) -> None:
        self._word = word

    def act(self, env: Any, observations: dict[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        del env
        assert observations
        return dict.fromkeys(observations, self._word)


def test_each_type_is_played_by_its_own_policy() -> None:
    team = TeamByType({"car": Says("drive"), "arm": Says("set")})
    assert team.act(None, {"arm_0": 1, "car_1": 2}) == {"arm_0": "set", "car_1": "drive"}


def test_a_policy_whose_agents_are_gone_is_not_asked() -> None:
    team = TeamByType({"car": Says("drive"), "arm": Says("set")})
    assert team.act(None, {"arm_0": 1, "arm_1": 2}) == {"arm_0": "set", "arm_1": "set"}
