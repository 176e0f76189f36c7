"""Orders: what is to be done in a run, as its configuration says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fleet.config import RunConfig, require
from fleet.robots.tools import TOOLS
from fleet.tasks.order import LIFT, MAX_GENERATED_KG, Ability, generate_orders
from fleet.tasks.order_file import OrderBook, OrderTerms, read_orders
from fleet.tasks.stream import stream_orders
from maps.site import Site


def orders_of(config: RunConfig, site: Site, abilities: Sequence[Ability], rng: np.random.Generator) -> OrderBook:
    """Read the orders of a run, or draw them.

    Args:
        config: Names a file or a stream; without both, enough is drawn to keep the fleet busy.
        site: Where the run takes place.
        abilities: What each car can do.
        rng: Source of those that are drawn.

    Raises:
        ConfigError: Parcels are drawn that the arms cannot hold or the cars cannot carry.
        OrdersError: The orders file cannot be read, or none of its orders can be accepted.
    """
    terms = order_terms(config, site, abilities)
    if config.orders is not None:
        return read_orders(config.orders, site, abilities, n_chargers=terms.n_chargers, grip_kg=terms.grip_kg)
    require(
        terms.grip_kg >= MAX_GENERATED_KG,
        "--grip-force",
        config.grip_force_n,
        f"a force that holds {MAX_GENERATED_KG} kg, the heaviest generated parcel; "
        f"this one holds {terms.grip_kg:.3g} kg",
    )
    payload_kg = max(ability.max_payload_kg for ability in abilities)
    require(
        not all(LIFT in ability.capabilities for ability in abilities),
        "--cars",
        ", ".join(dict.fromkeys(config.models)),
        "a model beside those that carries parcels, or --orders with pods",
    )
    require(
        payload_kg >= MAX_GENERATED_KG,
        "payload of the cars",
        payload_kg,
        f"a car that carries {MAX_GENERATED_KG} kg, the heaviest generated parcel",
    )
    if config.stream is not None:
        return OrderBook(orders=stream_orders(site, config.stream, config.duration_s, config.tasks, rng))
    return OrderBook(orders=generate_orders(site, config.n_tasks, config.robots, rng))


def order_terms(config: RunConfig, site: Site, abilities: Sequence[Ability]) -> OrderTerms:
    """What orders of a run have to fit."""
    battery = config.battery
    return OrderTerms(
        site=site,
        abilities=abilities,
        n_chargers=len(site.chargers[: battery.chargers_n]) if battery.enabled else 0,
        grip_kg=TOOLS[config.grip].payload_kg(config.grip_force_n),
    )
