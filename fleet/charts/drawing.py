"""Drawing: lines, areas, boxes and words on a sheet, as SVG for a page and as PNG for a document."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import chain, pairwise
from pathlib import Path

from fleet.whole_file import draft_of, write_whole

Spot = tuple[float, float]
"""x to the right and y down from the upper left corner [px]."""

SCALE = 2
"""Pixels of the PNG for one of the drawing."""
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"
_PALE = 0.18
"""Opacity of areas."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line through some points."""

    points: Sequence[Spot]
    color: str
    """Such as #0072b2."""
    width: float = 1.0
    dashed: bool = False


@dataclass(frozen=True, kw_only=True)
class Area:
    """A pale area."""

    points: Sequence[Spot]
    color: str


@dataclass(frozen=True, kw_only=True)
class Dot:
    """A dot, with a word that a page shows when it is pointed at."""

    at: Spot
    color: str
    radius: float = 3.5
    title: str = ""


@dataclass(frozen=True, kw_only=True)
class Box:
    """A rectangle; `at` is its upper left corner."""

    at: Spot
    size: tuple[float, float]
    """Width and height [px]."""
    color: str
    opacity: float = 1.0
    title: str = ""
    """What a page shows when it is pointed at."""


@dataclass(frozen=True, kw_only=True)
class Words:
    """One line of text; `at` is its base line."""

    at: Spot
    text: str
    size: float = 12.0
    color: str = "#333333"
    anchor: str = "start"
    """start, middle or end."""
    bold: bool = False


@dataclass(frozen=True, kw_only=True)
class MovingDot:
    """A dot, with a word in it if there is one, that goes along a line, and begins again; a PNG has it at its start."""

    points: Sequence[Spot]
    """Where it is after equal times."""
    lasts_s: float
    """Time from the first point to the last [s]."""
    color: str
    radius: float = 9.0
    text: str = ""


Mark = Line | Area | Dot | Box | Words | MovingDot


@dataclass(kw_only=True)
class Drawing:
    """A sheet and what is on it, in the order of painting."""

    width: int
    height: int
    marks: list[Mark] = field(default_factory=list)

    def svg(self) -> str:
        """The drawing as an SVG element."""
        body = "\n".join(_svg(mark) for mark in self.marks)
        size = f'viewBox="0 0 {self.width} {self.height}" width="{self.width}" height="{self.height}"'
        return f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="{FONT}" role="img">\n{body}\n</svg>'

    def _repr_html_(self) -> str:
        """What a notebook shows: on white, also where its page is dark."""
        return self.svg().replace("<svg ", '<svg style="background:#ffffff;max-width:100%;height:auto" ', 1)

    def write(self, folder: Path, name: str) -> None:
        """Write ``NAME.svg`` and ``NAME.png`` into a folder."""
        write_whole(folder / f"{name}.svg", self.svg() + "\n")
        self.write_png(folder / f"{name}.png")

    def write_png(self, path: Path) -> None:
        """Paint the drawing into a file."""
        from PIL import Image, ImageDraw, ImageFont

        # Painted at twice the size and reduced: lines and dots get smooth edges.
        zoom = 2 * SCALE
        image = Image.new("RGB", (self.width * zoom, self.height * zoom), "white")
        pen = ImageDraw.Draw(image, "RGBA")
        for mark in chain.from_iterable(map(_still, self.marks)):
            if isinstance(mark, Area):
                pen.polygon(_zoomed(mark.points, zoom), fill=f"{mark.color}{round(255 * _PALE):02x}")
            elif isinstance(mark, Line):
                for piece in _dashes(mark.points) if mark.dashed else [mark.points]:
                    pen.line(_zoomed(piece, zoom), fill=mark.color, width=round(mark.width * zoom), joint="curve")
            elif isinstance(mark, Box):
                far = (mark.at[0] + mark.size[0], mark.at[1] + mark.size[1])
                pen.rectangle(_zoomed([mark.at, far], zoom), fill=f"{mark.color}{round(255 * mark.opacity):02x}")
            elif isinstance(mark, Dot):
                pen.circle(_zoomed([mark.at], zoom)[0], mark.radius * zoom, fill=mark.color)
            else:
                anchor = {"start": "ls", "middle": "ms", "end": "rs"}[mark.anchor]
                font = ImageFont.load_default(mark.size * zoom)
                bold = zoom // 3 if mark.bold else 0
                spot = _zoomed([mark.at], zoom)[0]
                pen.text(spot, mark.text, fill=mark.color, font=font, anchor=anchor, stroke_width=bold // 2)
        with draft_of(path) as draft:
            image.resize((self.width * SCALE, self.height * SCALE), Image.Resampling.LANCZOS).save(draft, format="PNG")


def _still(mark: Mark) -> Sequence[Line | Area | Dot | Box | Words]:
    """A mark without its motion."""
    if not isinstance(mark, MovingDot):
        return (mark,)
    (x, y), size = mark.points[0], 1.2 * mark.radius
    word = Words(at=(x, y + 0.35 * size), text=mark.text, size=size, color="#ffffff", anchor="middle", bold=True)
    dot = Dot(at=(x, y), color=mark.color, radius=mark.radius)
    return (dot, word) if mark.text else (dot,)


def _zoomed(points: Sequence[Spot], zoom: int) -> list[Spot]:
    return [(x * zoom, y * zoom) for x, y in points]


def _dashes(points: Sequence[Spot], length: float = 5.0) -> list[list[Spot]]:
    """Cut straight pieces of a line into dashes."""
    dashes = []
    for (x0, y0), (x1, y1) in pairwise(points):
        total = max(((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5, 1e-9)
        at = 0.0
        while at < total:
            a, b = at / total, min(at + length, total) / total
            dashes.append([(x0 + a * (x1 - x0), y0 + a * (y1 - y0)), (x0 + b * (x1 - x0), y0 + b * (y1 - y0))])
            at += 2 * length
    return dashes


def _svg(mark: Mark) -> str:
    if isinstance(mark, MovingDot):
        x0, y0 = mark.points[0]
        places = ";".join(f"{x - x0:.1f},{y - y0:.1f}" for x, y in mark.points)
        how = f'attributeName="transform" type="translate" dur="{mark.lasts_s:g}s" repeatCount="indefinite"'
        body = "".join(_svg(still) for still in _still(mark))
        return f'<g>{body}<animateTransform {how} values="{places}"/></g>'
    if isinstance(mark, Words):
        weight = ' font-weight="600"' if mark.bold else ""
        at = f'x="{mark.at[0]:.1f}" y="{mark.at[1]:.1f}" font-size="{mark.size:g}"'
        return f'<text {at} fill="{mark.color}" text-anchor="{mark.anchor}"{weight}>{escape(mark.text)}</text>'
    if isinstance(mark, Dot):
        at = f'cx="{mark.at[0]:.1f}" cy="{mark.at[1]:.1f}" r="{mark.radius:g}"'
        title = f"<title>{escape(mark.title)}</title>" if mark.title else ""
        return f'<circle {at} fill="{mark.color}">{title}</circle>'
    if isinstance(mark, Box):
        at = f'x="{mark.at[0]:.1f}" y="{mark.at[1]:.1f}" width="{mark.size[0]:.1f}" height="{mark.size[1]:.1f}"'
        pale = f' fill-opacity="{mark.opacity:.2f}"' if mark.opacity < 1.0 else ""
        title = f"<title>{escape(mark.title)}</title>" if mark.title else ""
        return f'<rect {at} fill="{mark.color}"{pale}>{title}</rect>'
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in mark.points)
    if isinstance(mark, Area):
        return f'<polygon points="{points}" fill="{mark.color}" fill-opacity="{_PALE}"/>'
    dashed = ' stroke-dasharray="5 5"' if mark.dashed else ""
    return f'<polyline points="{points}" fill="none" stroke="{mark.color}" stroke-width="{mark.width:g}"{dashed}/>'
