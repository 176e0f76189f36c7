"""Errors of the map layer."""


class MapsError(ValueError):
    """A map, site or graph is malformed; the message says what, where, the value and what is valid."""


class SiteError(MapsError):
    """A site cannot be used as it is drawn."""


class UnknownSiteError(SiteError):
    """No site of this name ships and no such file exists."""


class SiteFileError(SiteError):
    """A site file cannot be read, written, or does not have the expected entries."""


class PlanError(SiteError):
    """The drawn floor plan has a wrong shape, character or combination of cells."""


class StationError(SiteError):
    """A dock, its arm and its slots do not fit together."""


class LaneError(SiteError):
    """A place cannot be served by the lanes of the site."""
