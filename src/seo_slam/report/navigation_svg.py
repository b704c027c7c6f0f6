"""A robot's search for something, seen from above: the floor it knew, where it looked, the way it planned and the way it made, as SVG."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Layout
from seo_slam.geometry import FloatArray
from seo_slam.report.escaping import clean_text, escaped
from seo_slam.report.label_layout import FAR_RINGS, place_labels
from seo_slam.report.map_frame import MapStyle, corners, grid, label_anchor, path_line, scale_bar, scale_bar_box
from seo_slam.report.projection import View, fit_view, hull
from seo_slam.types import BoolArray

STYLE = MapStyle("navigation", 900, 12, 4.2, 34, 80, 1.1, 0.5)

_HEAD_PX, _LEGEND_PX, _LINE_PX = 54.0, 30.0, 18.0
_LABEL_CHARACTERS = 22
_CARRIED_SHOWN = 3
_CSS = """
text{font-family:system-ui,-apple-system,"Segoe UI",Roboto,"Liberation Sans",sans-serif;fill:#1b222c}
.floor{fill:#eef1f5}.obstacles{fill:#c9d0d9}.walls{fill:#6b7583}
.grid{fill:none;stroke:#8a94a3;stroke-opacity:.16}.ticks text{fill:#5d6878}
.anchor{fill:#a16207;fill-opacity:.13;stroke:#a16207;stroke-opacity:.6}
.visited{fill:#1f5fbf;fill-opacity:.18;stroke:#1f5fbf;stroke-width:1.8}
.tag{paint-order:stroke;stroke:#fff;stroke-width:3px;stroke-linejoin:round}.tag.visited-name{fill:#1f4f9f;font-weight:650}
.leader{stroke:#5d6878;stroke-width:.8;fill:none}
.planned{fill:none;stroke:#c2410c;stroke-width:1.8;stroke-dasharray:6 4;stroke-opacity:.75}
.path{fill:none;stroke:#1f5fbf;stroke-width:2.6;stroke-linejoin:round}
.start{fill:#15803d;stroke:#fff;stroke-width:1.5}.stop{fill:#b91c1c;stroke:#fff;stroke-width:1.5}
.within{fill:#6d28d9;fill-opacity:.07;stroke:#6d28d9;stroke-dasharray:2 3}.target{fill:#6d28d9;stroke:#fff;stroke-width:1.2}
.believed{fill:none;stroke:#b91c1c;stroke-width:2.4}.number{fill:#fff;font-weight:700}.disc{fill:#1f5fbf;stroke:#fff;stroke-width:1.4}
.scale path{fill:none;stroke:#1b222c;stroke-width:1.6}.scale text{paint-order:stroke;stroke:#fff;stroke-width:3px}.dim{fill:#5d6878}
"""


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """A search as a picture shows it. World frame, metres.

    Attributes:
        abstract_map: what the robot knew when it set out.
        driven_world: (N, 2) the way it made, its start first and its stop last.
        planned: (id of the anchor, (M, 2) the way planned to it) of every place that was gone to, in order.
        title, subtitle: what was asked for, and how it ended.
        target_world: (2 or 3,) where the thing truly is; None where that is not known.
        believed_world: (2 or 3,) where the robot believes it to be; None if it found nothing.
        success_m: radius of the circle around the thing.
    """

    abstract_map: AbstractMap
    driven_world: FloatArray
    planned: Sequence[tuple[int, FloatArray]] = ()
    title: str = ""
    subtitle: str = ""
    target_world: FloatArray | None = None
    believed_world: FloatArray | None = None
    success_m: float = 1.0


def navigation_svg(search: Search, style: MapStyle = STYLE) -> str:
    """Return an SVG file of a search."""
    view = fit_view(_extent(search), style.width_px, style.tallest, style.flattest, style.margin_px)
    height = view.height_px + _HEAD_PX + _LEGEND_PX
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {view.width_px:g} {height:g}" width="{view.width_px:g}" '
        f'height="{height:g}" font-size="{style.font_px:g}" role="img" aria-label="{escaped(search.title, 300)}">',
        f'<style>{_CSS}</style><rect width="100%" height="100%" fill="#fff"/>',
        f'<text x="12" y="22" font-size="16" font-weight="650">{escaped(search.title, 110)}</text>',
        f'<text x="12" y="42" class="dim">{escaped(search.subtitle, 150)}</text>',
        f'<svg y="{_HEAD_PX:g}" width="{view.width_px:g}" height="{view.height_px:g}">',
        _floor(search.abstract_map.layout, view),
        grid(view, style, ("x", "y")),
        *(_footprint(anchor, view, _number_of(anchor, search) > 0) for anchor in search.abstract_map.anchors),
        _within(search, view),
        *(f'<polyline class="planned" points="{corners(view.pixels(path))}"/>' for _, path in search.planned if len(path) > 1),
        path_line(search.driven_world, view),
        _names(search, view, style),
        *_visits(search, view),
        *_marks(search, view, style),
        scale_bar(view, style),
        "</svg>",
        _legend(search, view.height_px + _HEAD_PX + _LINE_PX),
        "</svg>\n",
    ]
    return "".join(lines)


def _extent(search: Search) -> FloatArray:
    points = [search.driven_world, *(path for _, path in search.planned), *(a.footprint_world for a in search.abstract_map.anchors)]
    layout = search.abstract_map.layout
    if layout is not None:
        known = np.argwhere(layout.floor | layout.obstacles)
        points += [layout.middles(known)] if len(known) else []
    if search.target_world is not None:
        points.append(np.asarray(search.target_world)[:2] + search.success_m * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]))
    if search.believed_world is not None:
        points.append(np.asarray(search.believed_world)[None, :2])
    return np.concatenate([np.asarray(p, dtype=np.float64).reshape(-1, 2) for p in points])


def _floor(layout: Layout | None, view: View) -> str:
    if layout is None:
        return ""
    shown = (("floor", layout.floor), ("obstacles", layout.obstacles), ("walls", layout.walls))
    return "".join(f'<path class="{name}" d="{_runs(cells, layout, view)}"/>' for name, cells in shown)


def _runs(cells: BoolArray, layout: Layout, view: View) -> str:
    """One rectangle for each run of cells along x."""
    edges = np.diff(np.pad(cells.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, first = np.nonzero(edges > 0)
    _, end = np.nonzero(edges < 0)
    side = layout.cell_m * view.px_per_m
    left_top = view.pixels(layout.corner_world + layout.cell_m * np.stack([first, rows + 1], axis=-1))
    return "".join(f"M{x:.1f} {y:.1f}h{n * side:.1f}v{side:.2f}h{-n * side:.1f}z" for (x, y), n in zip(left_top, end - first, strict=True))


def _number_of(anchor: Anchor, search: Search) -> int:
    """Which attempt first went to an anchor: 1, 2, …; 0 for none."""
    return next((k for k, (anchor_id, _) in enumerate(search.planned, 1) if anchor_id == anchor.id), 0)


def _footprint(anchor: Anchor, view: View, visited: bool) -> str:
    outline = hull(anchor.footprint_world)
    told = f"{clean_text(anchor.label) or 'unnamed'} #{anchor.id}"
    carried = ", ".join(clean_text(v.label) or "unnamed" for v in anchor.volatiles)
    title = f"{told}: {carried}" if carried else told
    css = "visited" if visited else "anchor"
    return f'<polygon class="{css}" points="{corners(view.pixels(outline))}"><title>{escaped(title, 240)}</title></polygon>'


def _names(search: Search, view: View, style: MapStyle) -> str:
    anchors = sorted(search.abstract_map.anchors, key=lambda a: (-_number_of(a, search), a.id))
    if not anchors:
        return ""
    centres = view.pixels(np.array([anchor.xy_world for anchor in anchors]))
    texts = [_name(anchor) for anchor in anchors]
    inside = (4.0, 4.0, view.width_px - 4.0, view.height_px - style.font_px - 8.0)
    ends = view.pixels(search.driven_world[[0, -1]]) if len(search.driven_world) else np.zeros((0, 2))
    targets = [view.pixels(np.asarray(p)[:2]) for p in (search.target_world, search.believed_world) if p is not None]
    discs = [at for _, at in _discs(search, view)]
    taken = np.array([[x - 8, y - 8, x + 8, y + 8] for x, y in [*ends, *targets, *discs]] + [scale_bar_box(view, style)])
    font = 0.92 * style.font_px
    parts = []
    for anchor, text, centre, place in zip(
        anchors, texts, centres, place_labels(centres, texts, font, inside, taken, 4.0, FAR_RINGS[:5]), strict=True
    ):
        if place is not None:
            where, leader = label_anchor(place, centre, font)
            css = "tag visited-name" if _number_of(anchor, search) else "tag"
            parts.append(f'{leader}<text class="{css}" font-size="{font:g}" {where}>{escaped(text)}</text>')
    return "".join(parts)


def _name(anchor: Anchor) -> str:
    name = clean_text(anchor.label, _LABEL_CHARACTERS) or f"#{anchor.id}"
    carried = [clean_text(v.label, 14) for v in anchor.volatiles if v.label]
    more = f" +{len(carried) - _CARRIED_SHOWN}" if len(carried) > _CARRIED_SHOWN else ""
    return f"{name}: {', '.join(carried[:_CARRIED_SHOWN])}{more}" if carried else name


def _visits(search: Search, view: View) -> list[str]:
    return [
        f'<circle class="disc" cx="{x:.1f}" cy="{y:.1f}" r="8.5"/>'
        f'<text class="number" font-size="11" x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle">{number}</text>'
        for number, (x, y) in _discs(search, view)
    ]


def _discs(search: Search, view: View) -> list[tuple[int, FloatArray]]:
    """Number and place, in pixels, of every place that was gone to: the upper left corner of its footprint, else the end of the way."""
    known = {anchor.id: anchor for anchor in search.abstract_map.anchors}
    discs = []
    for number, (anchor_id, path) in enumerate(search.planned, 1):
        if anchor_id in known:
            low, high = known[anchor_id].bounds_world
            discs.append((number, view.pixels(np.array([low[0], high[1]]))))
        elif len(path):
            discs.append((number, view.pixels(np.asarray(path)[-1])))
    return discs


def _within(search: Search, view: View) -> str:
    if search.target_world is None:
        return ""
    x, y = view.pixels(np.asarray(search.target_world)[:2])
    return f'<circle class="within" cx="{x:.1f}" cy="{y:.1f}" r="{search.success_m * view.px_per_m:.1f}"/>'


def _marks(search: Search, view: View, style: MapStyle) -> list[str]:
    marks = []
    if search.target_world is not None:
        marks.append(_star(view.pixels(np.asarray(search.target_world)[:2]), 2.2 * style.dot_px))
    if search.believed_world is not None:
        x, y = view.pixels(np.asarray(search.believed_world)[:2])
        marks.append(f'<path class="believed" d="M{x - 6:.1f} {y - 6:.1f}l12 12m0 -12l-12 12"/>')
    if len(search.driven_world):
        (x0, y0), (x1, y1) = view.pixels(search.driven_world[[0, -1]])
        marks.append(f'<circle class="start" cx="{x0:.1f}" cy="{y0:.1f}" r="6.5"/>')
        marks.append(f'<rect class="stop" x="{x1 - 6:.1f}" y="{y1 - 6:.1f}" width="12" height="12"/>')
    return marks


def _star(at: FloatArray, radius: float) -> str:
    angles = -np.pi / 2 + np.pi / 5 * np.arange(10)
    radii = np.where(np.arange(10) % 2 == 0, radius, 0.45 * radius)
    return f'<polygon class="target" points="{corners(at + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1))}"/>'


def _legend(search: Search, y: float) -> str:
    """What the marks mean, in one line; only those that the picture has."""
    shown = [
        (True, '<circle class="start" cx="7" cy="-4" r="6"/>', "start"),
        (True, '<rect class="stop" x="1" y="-10" width="12" height="12"/>', "stop"),
        (True, '<path class="path" d="M0 -4h18"/>', "driven"),
        (bool(search.planned), '<path class="planned" d="M0 -4h18"/>', "planned"),
        (bool(search.planned), '<circle class="disc" cx="8" cy="-4" r="7"/>', "gone to, in this order"),
        (search.target_world is not None, _star(np.array([8.0, -4.0]), 8.0), f"true place, {search.success_m:g} m around it"),
        (search.believed_world is not None, '<path class="believed" d="M2 -10l12 12m0 -12l-12 12"/>', "believed place"),
    ]
    x, parts = 12.0, []
    for wanted, mark, words in shown:
        if wanted:
            parts.append(f'<g transform="translate({x:.0f} {y:.0f})">{mark}<text class="dim" x="23">{words}</text></g>')
            x += 46.0 + 6.4 * len(words)
    return "".join(parts)
