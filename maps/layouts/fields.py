"""FormatFields: what stands in a file of a layout, checked against what a format has, with messages that say where."""

from __future__ import annotations

from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from maps.layouts.layout import LayoutError
from maps.reading.shown import named, shown

MOST_M = 1e5
"""Greatest coordinate [m]: a floor of a hundred kilometres is a mistake in units."""
Coordinate = Annotated[float, Field(allow_inf_nan=False, ge=-MOST_M, le=MOST_M)]
Angle = Annotated[float, Field(allow_inf_nan=False, ge=-1e3, le=1e3)]


class FormatFields(BaseModel):
    """A group of fields of a format; those that are not read may hold anything."""

    model_config = ConfigDict(extra="ignore", frozen=True, coerce_numbers_to_str=True)


Read = TypeVar("Read", bound=FormatFields)


def read_fields(model: type[Read], content: Any, where: str) -> Read:
    """Check a tree of lists, texts and numbers.

    Args:
        model: What the format has.
        content: As a parser gave it.
        where: Opens every message.

    Raises:
        LayoutError: Something is missing or of another kind; says where it stands, its value and what is valid.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        problem = error.errors()[0]
        path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in problem["loc"]).lstrip(".")
        place = f"{named(path)} " if path else ""
        if problem["type"] == "missing":
            raise LayoutError(f"{where}: {place}is missing; valid: {path.rpartition('.')[2]} and its value") from error
        valid = problem["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
        raise LayoutError(f"{where}: {place}is {shown(problem['input'])}; valid: {valid}") from error
