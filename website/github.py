"""GitHub: what a page means there, said so that the site means the same."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

DOCS = "docs"
_LINK = re.compile(r"(?<![`!])\[(?P<words>[^\]]*)\]\((?P<target>[^)\s#]+)(?:#[^)\s]*)?\)")
_CODE = re.compile(r"(?<!`)`[^`\n]+`(?!`)")


def without_source_links(markdown: str, page: str, repository: Path) -> str:
    """Name the path where a page links to a file of the repository that the site does not have.

    Args:
        markdown: Text of the page.
        page: Its path, from the folder of the pages.
        repository: Root of the repository.

    Returns:
        The text; links to what is nowhere are left, and end a strict build.
    """
    folder = posixpath.dirname(posixpath.join(DOCS, page))

    def named(link: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(folder, link["target"]))
        there = repository / path
        in_site = path.startswith(f"{DOCS}/") and there.is_file()
        if "://" in link["target"] or in_site or not there.exists():
            return link[0]
        words = link["words"]
        return f"`{path}`" if words.strip("`") == path else f"{words} (`{path}`)"

    return _LINK.sub(named, markdown)


def with_plain_bars(markdown: str) -> str:
    """Bars inside of code as they are: in tables GitHub wants a backslash before them, and hides it."""
    return _CODE.sub(lambda code: code[0].replace(r"\|", "|"), markdown)


def changelog(repository: Path) -> str:
    """The changelog as a page of the site."""
    text = (repository / "CHANGELOG.md").read_text(encoding="utf-8")
    return text.replace(f"]({DOCS}/", "](")
