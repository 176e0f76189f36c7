"""Spaces of the warehouse's agents: what each is told and may do (layout: see `fleet.envs.warehouse.env`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Space

from fleet.envs.warehouse.config import WarehouseConfig
from fleet.envs.warehouse.control.actions import N_CAR_ENTRIES, n_arm_entries
from fleet.envs.warehouse.rows import N_ARM_NUMBERS, N_CAR_NUMBERS


def observation_spaces(config: WarehouseConfig) -> dict[str, Space[Any]]:
    """Spaces by agent, each its own: seeding one must not seed another."""
    cars: dict[str, Space[Any]] = {car: _car_space(config) for car in config.car_names}
    return cars | {arm: _arm_space(config) for arm in config.arm_names}


def action_spaces(config: WarehouseConfig) -> dict[str, Space[Any]]:
    """Spaces by agent, each its own."""
    cars: dict[str, Space[Any]] = {car: _box(N_CAR_ENTRIES) for car in config.car_names}
    arms = zip(config.arm_names, config.arm_kinds, strict=True)
    return cars | {arm: _box(n_arm_entries(config.arm_action, kind.n_joints)) for arm, kind in arms}


def state_space(config: WarehouseConfig) -> Box:
    """The rows of all agents without lidar, cars first."""
    return _box(len(config.car_names) * N_CAR_NUMBERS + len(config.arm_names) * N_ARM_NUMBERS)


def _car_space(config: WarehouseConfig) -> Space[Any]:
    lidar = config.car_lidar
    row = _box(N_CAR_NUMBERS, 0 if lidar is None else lidar.n_rays)
    if config.camera is None:
        return row
    return Dict({"row": row, "image": Box(0, 255, (*config.camera, 3), np.uint8)})


def _arm_space(config: WarehouseConfig) -> Space[Any]:
    row = _box(N_ARM_NUMBERS)
    # With cameras all observations are dictionaries: PettingZoo's test compares those of different agents.
    return row if config.camera is None else Dict({"row": row})


def _box(n: int, n_distances: int = 0) -> Box:
    """Numbers in [-1, 1], and distances in [0, 1] behind them."""
    low = np.full(n + n_distances, -1.0, dtype=np.float32)
    low[n:] = 0.0
    return Box(low, np.ones(n + n_distances, dtype=np.float32), dtype=np.float32)
