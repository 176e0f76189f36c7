"""Hooks: what mkdocs calls while it builds the site, see `mkdocs.yml`."""

from __future__ import annotations

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

from website.github import with_plain_bars, without_source_links
from website.parts import PARTS, Place

REPOSITORY = Path(__file__).resolve().parents[1]
_MARK = re.compile(r"^<!-- site: (?P<part>\w+)(?: (?P<word>[\w-]+))? -->$", re.MULTILINE)
_REMOTE = re.compile(r"""<(?:script|img|iframe|source|video|link)\b[^>]*\b(?:src|href)=["']?(?:https?:)?//[^>]*>""")


def on_config(config: MkDocsConfig) -> None:
    """Put all pages of a folder into the navigation where it names the folder."""
    config.nav = _unfolded(config.nav, Path(config.docs_dir))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Fill in the parts that are made when the site is built, and take out links to the source.

    Raises:
        PluginError: A page asks for a part that there is not.
    """

    def made(mark: re.Match[str]) -> str:
        name, word = mark["part"], mark["word"] or ""
        if name not in PARTS:
            raise PluginError(f"{page.file.src_uri}: {mark[0]}; valid: {', '.join(sorted(PARTS))}")
        try:
            return PARTS[name](word, Place(repository=REPOSITORY, page=page.file, files=files, config=config))
        except KeyError as error:
            raise PluginError(f"{page.file.src_uri}: {mark[0]}; valid: another word than {error}") from error

    return with_plain_bars(without_source_links(_MARK.sub(made, markdown), page.file.src_uri, REPOSITORY))


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> None:  # noqa: ARG001 - as MkDocs calls it
    """See that a page loads nothing from elsewhere.

    Raises:
        PluginError: It does.
    """
    if found := _REMOTE.search(output):
        raise PluginError(f"{page.file.src_uri} loads from elsewhere: {found[0]}; valid: files of the site")


def _unfolded(entry: object, docs: Path) -> object:
    """An entry of the navigation, with folders as lists of their pages, the README first."""
    if isinstance(entry, list):
        return [_unfolded(one, docs) for one in entry]
    if isinstance(entry, dict):
        return {title: _unfolded(one, docs) for title, one in entry.items()}
    if isinstance(entry, str) and entry.endswith("/"):
        pages = sorted((docs / entry).glob("*.md"), key=lambda page: (page.name != "README.md", page.name))
        return [page.relative_to(docs).as_posix() for page in pages]
    return entry
