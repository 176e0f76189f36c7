"""Sites of environments: checked, and worked out once."""

from __future__ import annotations

import functools

from fleet.config import Fidelity, require
from fleet.config.field_checks import is_whole
from fleet.envs.grid.fleet import FleetSite
from maps.site import Site, load_site, site_names


def check_site(site: object, fidelity: object, n_cars: object) -> None:
    """Refuse a site, a fidelity or a fleet size that an environment of a layer cannot have.

    Raises:
        ConfigError: An argument is outside its valid range.
        SiteError: The site cannot be read.
    """
    require(fidelity in list(Fidelity), "fidelity", fidelity, ", ".join(Fidelity))
    on_grid = fidelity == Fidelity.GRID
    valid = "a name, a path or a Site" if on_grid else "a name or a path; maps.site.save_site writes a file of a Site"
    require(isinstance(site, str) or (on_grid and isinstance(site, Site)), "site", getattr(site, "name", site), valid)
    read = site if isinstance(site, Site) else load_site(str(site))
    spots_n = len(read.parking)
    ok = is_whole(n_cars) and 1 <= n_cars <= spots_n
    require(ok, "n_cars", n_cars, f"1 to {spots_n} (parking cells of site {read.name})")


def place_of(site: str | Site) -> FleetSite:
    """What a fleet needs to know of a site; that of one that ships is worked out once in a process."""
    if isinstance(site, Site):
        return FleetSite.of(site)
    return _shipped(site) if site in site_names() else FleetSite.of(load_site(site))


@functools.lru_cache(maxsize=4)
def _shipped(site: str) -> FleetSite:
    return FleetSite.of(load_site(site))
