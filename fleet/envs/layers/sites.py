"""Sites of environments, worked out once."""

from __future__ import annotations

import functools
from pathlib import Path

from fleet.abstract.fleet import FleetSite
from maps.site import Site, load_site, site_names


def place_of(site: str | Path | Site) -> FleetSite:
    """What a fleet needs to know of a site; that of one that ships is worked out once in a process."""
    if isinstance(site, Site):
        return FleetSite.of(site)
    name = str(site)
    return _shipped(name) if name in site_names() else FleetSite.of(load_site(name))


@functools.lru_cache(maxsize=4)
def _shipped(site: str) -> FleetSite:
    return FleetSite.of(load_site(site))
