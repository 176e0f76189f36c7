"""Parts: what stands in a page in place of ``<!-- site: NAME WORD -->``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from website.commands import commands
from website.drawings import figure
from website.gallery import moving_picture
from website.github import changelog
from website.notebooks import notebooks
from website.results import results
from website.robots import robots

if TYPE_CHECKING:  # of the extra `docs`, which tests of the parts do without
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import File, Files


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a part goes."""

    repository: Path
    page: File
    files: Files
    config: MkDocsConfig

    def add(self, path: str, content: str | bytes) -> None:
        """Add a file to the site, unless it is there.

        Args:
            path: From the root of the site.
            content: Of the file.
        """
        from mkdocs.structure.files import File

        if self.files.get_file_from_path(path) is None:
            self.files.append(File.generated(self.config, path, content=content))


PARTS: Mapping[str, Callable[[str, Place], str]] = MappingProxyType(
    {
        "changelog": lambda word, place: changelog(place.repository),
        "commands": lambda word, place: commands(),
        "drawing": lambda word, place: figure(word),
        "film": moving_picture,
        "notebooks": lambda word, place: notebooks(place),
        "results": lambda word, place: results(word, place.repository),
        "robots": lambda word, place: robots(),
    }
)
"""A part makes Markdown from the word behind its name, empty if there is none, and its place."""
