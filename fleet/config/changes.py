"""Settings that change in the middle of a run."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.config.settings import Settings, SettingValue, not_negative, require

CHANGEABLE = (
    # The allocator is made anew; whoever prices or plans tasks reads the weights each time.
    "allocation.allocator",
    "allocation.allocator_settings",
    "allocation.ageing",
    "allocation.lateness",
    "allocation.due",
    "allocation.late_s",
    "allocation.keep_gain_s",
    "allocation.keep_share",
    "allocation.busy_s",
    # The planner is made anew; the others count from the next request, or the next grant, on.
    "traffic.planner",
    "traffic.planner_settings",
    "traffic.horizon_n",
    "traffic.period_s",
    "traffic.latency_s",
    "traffic.iterations_n",
    "traffic.commit_moves_n",
    "traffic.grant_moves_n",
    "traffic.reorder_after_s",
    # Looked up each time.
    "timeouts.waiting_s",
    "timeouts.assigned_s",
    "timeouts.service_s",
    "timeouts.carried_s",
    "timeouts.visiting_s",
)
"""Settings that may change while a run lasts, by group and name. All others decide what a run starts from.
Those that end in `_settings` are given by one more name, as `traffic.planner_settings.rounds`."""
MEMBERS = {"allocator_settings": "allocator", "planner_settings": "planner"}
"""Settings of a planner or an allocator, and what names it: another one begins with its own defaults."""


@dataclass(frozen=True, kw_only=True)
class SettingChange(Settings):
    """A setting that has another value from some time on."""

    time_s: float
    name: str
    """One of `CHANGEABLE`."""
    value: SettingValue

    def __post_init__(self) -> None:
        super().__post_init__()
        not_negative("time_s", self.time_s)
        known = self.name in CHANGEABLE and self.setting not in MEMBERS
        known = known or (
            self.setting in MEMBERS and bool(self.member) and f"{self.group}.{self.setting}" in CHANGEABLE
        )
        valid = [f"{name}.NAME" if name.endswith("_settings") else name for name in CHANGEABLE]
        require(known, "setting that changes during a run", self.name, ", ".join(valid))

    @property
    def group(self) -> str:
        """Field of the configuration that holds the setting."""
        return self.name.partition(".")[0]

    @property
    def setting(self) -> str:
        """Its name there."""
        return self.name.split(".")[1] if "." in self.name else ""

    @property
    def member(self) -> str:
        """Name among the settings of a planner or an allocator; else empty."""
        return self.name.split(".", 2)[2] if self.name.count(".") > 1 else ""
