"""Notebooks: pages that `make notebooks` has made, taken into the site."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from website.parts import Place

FOLDER = Path("build", "notebooks")
_REMOTE_SCRIPT = re.compile(r"""<script\b[^>]*\bsrc=["']?(?:https?:)?//[^>]*>\s*</script>""")


def notebooks(place: Place) -> str:
    """Links to the notebooks, or how to make them; adds their files to the site."""
    pages = sorted((place.repository / FOLDER).glob("*.html"))
    if not pages:
        return "They are not part of this build: `make notebooks`, then `make docs`, takes them in."
    for page in pages:
        place.add(f"notebooks/{page.name}", without_remote_scripts(page.read_text(encoding="utf-8")))
    return "\n".join(f"- [{page.stem.replace('_', ' ')}](notebooks/{page.name})" for page in pages)


def without_remote_scripts(html: str) -> str:
    """A page that loads no scripts from elsewhere; those that converters ask for only set formulas and widgets."""
    return _REMOTE_SCRIPT.sub("", html)
