"""RmfYaml: reads and writes the YAML of Open-RMF, for which the extra `rmf` is needed."""

from __future__ import annotations

from typing import Any

from maps.layouts.layout import LayoutError
from maps.reading.aliases import check_aliases
from maps.reading.shown import shown

EXTRA = "pip install '.[rmf]'"


def parse_yaml(text: str, where: str, *, valid: str) -> dict[str, Any]:
    """Read YAML whose root is a mapping.

    Args:
        text: Content of a file.
        where: Opens every message.
        valid: Ends every message: what such a file holds.

    Raises:
        LayoutError: It is no YAML or no mapping; says the line. Or PyYAML is not installed.
    """
    yaml = _yaml()
    try:
        content = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        check_aliases(content)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = "" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: "
        reason = getattr(error, "problem", None) or str(error) or "nested too deeply"
        raise LayoutError(f"{where}: {place}is no YAML ({' '.join(reason.split())}); valid: {valid}") from error
    if not isinstance(content, dict):
        raise LayoutError(f"{where}: is {shown(content)}; valid: {valid}")
    return content


def dump_yaml(content: dict[str, Any]) -> str:
    """Write a mapping, small groups in one line.

    Raises:
        LayoutError: PyYAML is not installed.
    """
    return str(_yaml().safe_dump(content, default_flow_style=None, sort_keys=False, width=120, allow_unicode=True))


def _yaml() -> Any:
    try:
        import yaml
    except ImportError as error:
        raise LayoutError(f"the formats of Open-RMF need PyYAML, which is not installed; valid: {EXTRA}") from error
    return yaml
