"""Truth and map side by side, seen from above, as one SVG: for a file of its own, or for a page."""

import re
from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from seo_slam.evaluation.scores import LandmarksResult, Score
from seo_slam.evaluation.true_objects import Truth
from seo_slam.geometry import FloatArray
from seo_slam.records import Trajectory
from seo_slam.report.escaping import clean_text, escaped
from seo_slam.report.label_layout import FAR_RINGS, NEAR_RINGS, place_labels, text_width_px
from seo_slam.report.map_frame import MapStyle, corners, grid, label_anchor, path_line, scale_bar, scale_bar_box
from seo_slam.report.page import packaged
from seo_slam.report.projection import View, fit_view
from seo_slam.report.truth_scene import Comparison, Mark, compare
from seo_slam.types import Landmark

FILE = MapStyle("file", 700, 13, 4.2, 40, 70, 1.0, 0.55)
BESIDE = MapStyle("beside", 508, 12, 4.0, 34, 60, 1.2, 0.6)
BELOW = MapStyle("below", 360, 12, 3.8, 28, 52, 1.3, 0.8)
"""Sizes of one panel: beside each other in a file, on a wide page, and one below the other on a narrow one."""

_GAP_PX = 12.0
_LABEL_CHARACTERS = 26
_SMALL_BOX_PX = 80.0  # labels keep off boxes below this; in a larger one there is room for them
_TRUE_KINDS = {"object": "object", "seldom": "seldom in view", "moved": "moved away", "removed": "taken away"}
_FOUND_KINDS = {"matched": "matched", "duplicate": "duplicate", "ghost": "ghost", "false": "false", "missing": "missing"}


def truth_svg(
    landmarks: Iterable[Landmark],
    truth: Truth,
    result: LandmarksResult,
    trajectory: Trajectory | None = None,
    title: str = "",
) -> str:
    """Return an SVG file: on the left what is there, on the right what the map has of it.

    Args:
        landmarks: those that were scored, true world, z up.
        truth: what they were scored against.
        result: of ``evaluate_landmarks``.
        trajectory: camera poses, true world; None draws none.
        title: what the scene is called.
    """
    comparison = compare(landmarks, truth, result, trajectory)
    picture = draw_comparison(comparison, result, FILE, stacked=False, heading=(title, score_line(result)))
    style = re.sub(r"var\(--[\w-]+, ([^)]+)\)", r"\1", truth_css())  # programs other than browsers know no variables
    start = picture.index(">") + 1
    head = picture[:start].replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
    return f'{head}<style>{style}</style><rect width="100%" height="100%" fill="#ffffff"/>{picture[start:]}\n'


def score_line(result: LandmarksResult) -> str:
    """The scores in one line of words."""
    s: Score = result.score
    return (
        f"precision {s.precision:.2f}, recall {s.recall:.2f}, F1 {s.f1:.2f} "
        f"({result.protocol}, within {result.radius_m:g} m, labels {clean_text(result.label_rule, 60)})"
    )


def truth_css() -> str:
    """The rules of the picture; each colour is a variable with a value of its own for where it is not set."""
    return packaged("truth.css")


def draw_comparison(comparison: Comparison, result: LandmarksResult, style: MapStyle, stacked: bool, heading: Sequence[str] = ()) -> str:
    """Return one ``<svg>`` without its rules (``truth_css``).

    Args:
        comparison: what is drawn.
        result: for the numbers in names and legend.
        style: sizes of a panel.
        stacked: whether the panels stand one below the other.
        heading: lines above the panels.
    """
    view = fit_view(comparison.extent, style.width_px, style.tallest, style.flattest, style.margin_px)
    width = style.width_px if stacked else 2 * style.width_px + _GAP_PX
    lines = [line for text in heading if text for line in _wrapped(clean_text(text, 300), width - 16, style.font_px)]
    line_px = 1.6 * style.font_px
    top = len(lines) * line_px + (6 if lines else 0)
    name_px = 1.9 * style.font_px
    panel_px = name_px + view.height_px
    second = (0.0, top + panel_px + _GAP_PX) if stacked else (style.width_px + _GAP_PX, top)
    legend, legend_px = _legend(comparison, _sees_path(comparison, view), width, style)
    bottom = second[1] + panel_px
    height = bottom + legend_px
    objects = len(result.matched) + len(result.missing)
    parts = [
        f'<svg class="truth-map truth-{style.name}" viewBox="0 0 {width:g} {height:g}" role="group" font-size="{style.font_px:g}" '
        'aria-label="Truth and map side by side, seen from above">',
        _heading(lines, line_px),
        _panel("truth", f"Truth: {objects} {_plural('object', objects)}", comparison.truth, comparison, view, style, (0.0, top)),
        _panel(
            "map",
            f"Map: {result.score.landmarks} {_plural('landmark', result.score.landmarks)}",
            comparison.found,
            comparison,
            view,
            style,
            second,
        ),
        f'<g transform="translate(0 {bottom:.1f})">{legend}</g></svg>',
    ]
    return "".join(parts)


def _sees_path(comparison: Comparison, view: View) -> bool:
    """Whether any of the camera's path lies inside the picture: it may have passed farther away."""
    points = view.pixels(comparison.path)
    return bool(((points >= 0) & (points <= [view.width_px, view.height_px])).all(axis=1).any())


def _plural(word: str, count: int) -> str:
    return word if count == 1 else f"{word}s"


def _wrapped(text: str, width_px: float, font_px: float) -> list[str]:
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and text_width_px(longer, font_px) > width_px:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _heading(lines: Sequence[str], line_px: float) -> str:
    texts = (
        f'<text class="{"title" if row == 0 else "score"}" x="6" y="{(row + 0.8) * line_px:.1f}">{escaped(line, 300)}</text>'
        for row, line in enumerate(lines)
    )
    return f'<g class="heading">{"".join(texts)}</g>' if lines else ""


def _panel(
    side: str, name: str, marks: Sequence[Mark], comparison: Comparison, view: View, style: MapStyle, at: tuple[float, float]
) -> str:
    name_px = 1.9 * style.font_px
    edge = f"truth-edge-{style.name}-{side}"
    size = f'width="{view.width_px:g}" height="{view.height_px:g}" rx="8"'
    painted = sorted(marks, key=lambda mark: -float(mark.size.sum()))  # small things on top
    return (
        f'<g class="side {side}" transform="translate({at[0]:.1f} {at[1]:.1f})">'
        f'<text class="panel-name" x="6" y="{0.72 * name_px:.1f}">{escaped(name)}</text>'
        f'<g transform="translate(0 {name_px:.1f})"><clipPath id="{edge}"><rect {size}/></clipPath>'
        f'<rect class="ground" {size}/><g clip-path="url(#{edge})">{grid(view, style, ("x", "y"))}{path_line(comparison.path, view)}'
        f"{''.join(_shape(mark, view, style) for mark in painted)}{_labels(marks, view, style)}</g>{scale_bar(view, style)}</g></g>"
    )


def _shape(mark: Mark, view: View, style: MapStyle) -> str:
    centre = view.pixels(mark.centre)
    way = ""
    if mark.leads_to is not None:
        end = view.pixels(mark.leads_to)
        way = _arrow(centre, end, style) if mark.kind == "moved" else f'<path class="off" d="{_line(centre, end)}"/>'
    return (
        f'<g class="mark {mark.kind}"><title>{escaped(mark.title, 240)}</title>'
        f'<polygon class="box" points="{corners(view.pixels(mark.outline))}"/>{way}{_symbol(mark.kind, centre, style.dot_px)}</g>'
    )


def _line(start: FloatArray, end: FloatArray) -> str:
    return f"M{start[0]:.1f} {start[1]:.1f}L{end[0]:.1f} {end[1]:.1f}"


def _arrow(start: FloatArray, end: FloatArray, style: MapStyle) -> str:
    length = float(np.linalg.norm(end - start))
    if length < 2 * style.dot_px:
        return ""
    ahead = (end - start) / length * 2.2 * style.dot_px
    across = np.array([-ahead[1], ahead[0]]) * 0.45
    return (
        f'<path class="way" d="{_line(start, end - ahead)}"/>'
        f'<polygon class="arrow" points="{corners(np.array([end, end - ahead + across, end - ahead - across]))}"/>'
    )


def _symbol(kind: str, at: FloatArray, r: float) -> str:
    """A form of its own for each kind, so that colour is not all that tells them apart."""
    x, y = float(at[0]), float(at[1])
    if kind in ("object", "seldom"):
        return f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="{0.5 * r:.1f}"/>'
    if kind == "duplicate":
        return f'<rect class="dot" x="{x - r:.1f}" y="{y - r:.1f}" width="{2 * r:.1f}" height="{2 * r:.1f}"/>'
    if kind == "ghost":
        s = 1.4 * r
        return f'<path class="dot" d="M{x:.1f} {y - s:.1f}l{s:.1f} {s:.1f}l{-s:.1f} {s:.1f}l{-s:.1f} {-s:.1f}z"/>'
    if kind in ("false", "removed"):
        return f'<path class="dot" d="M{x - r:.1f} {y - r:.1f}l{2 * r:.1f} {2 * r:.1f}m0 {-2 * r:.1f}l{-2 * r:.1f} {2 * r:.1f}"/>'
    return f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}"/>' if kind == "matched" else ""


def _labels(marks: Sequence[Mark], view: View, style: MapStyle) -> str:
    centres = view.pixels(np.array([mark.centre for mark in marks]).reshape(-1, 2))
    reach = np.array([[-1.0, -1.0, 1.0, 1.0]]) * (style.dot_px + 1)
    obstacles = np.concatenate([np.tile(centres, 2) + reach, [scale_bar_box(view, style)]])
    names = [clean_text(mark.name, _LABEL_CHARACTERS) for mark in marks]
    inside = (4.0, 4.0, view.width_px - 4.0, view.height_px - style.font_px - 8.0)
    boxes = [np.concatenate([view.pixels(mark.outline).min(axis=0), view.pixels(mark.outline).max(axis=0)]) for mark in marks]
    small = [box for box in boxes if max(box[2] - box[0], box[3] - box[1]) < _SMALL_BOX_PX]
    free = np.concatenate([obstacles, np.array(small).reshape(-1, 4) + 3 * np.array([-1.0, 0.0, 1.0, 0.0])])
    layout = partial(place_labels, centres, font_px=style.font_px, bounds_px=inside, gap_px=style.dot_px + 3)
    places = layout(names, obstacles_px=free, rings=NEAR_RINGS)
    # Where it is crowded, a label over a neighbour's box, or far away, is better than none.
    taken = np.array([place.box_px for place in places if place is not None]).reshape(-1, 4)
    left = ["" if place else name for place, name in zip(places, names, strict=True)]
    rest = layout(left, obstacles_px=np.concatenate([obstacles, taken]), rings=FAR_RINGS)
    places = [first or second for first, second in zip(places, rest, strict=True)]
    texts = []
    for mark, name, centre, place in zip(marks, names, centres, places, strict=True):
        if place is not None:
            where, leader = label_anchor(place, centre, style.font_px)
            texts.append(f'<g class="mark {mark.kind}">{leader}<text {where}>{escaped(name)}</text></g>')
    return "".join(texts)


def _legend(comparison: Comparison, with_path: bool, width_px: float, style: MapStyle) -> tuple[str, float]:
    """The kinds that occur, how many of each, and what else is drawn; and the height of it all, pixels."""
    row_px, key_px = 1.9 * style.font_px, 2.2 * style.font_px
    items: list[tuple[str, str]] = []
    for kinds, marks in ((_TRUE_KINDS, comparison.truth), (_FOUND_KINDS, comparison.found)):
        for kind, words in kinds.items():
            count = sum(mark.kind == kind for mark in marks)
            if count:
                items.append((kind, f"{words} {count}"))
    items += [("path", "camera path")] if with_path else []
    items += [("", f"not drawn, too far away: {_ids(comparison.left_out)}")] if comparison.left_out else []
    x, y, parts = 6.0, row_px, []
    for kind, words in items:
        needed = key_px + text_width_px(words, style.font_px) + 14
        if x > 6.0 and x + needed > width_px:
            x, y = 6.0, y + row_px
        parts.append(_legend_key(kind, x, y - 0.35 * style.font_px, key_px, style))
        left = x + (key_px if kind else 0)
        parts.append(f'<text class="legend-words" x="{left:.1f}" y="{y:.1f}">{escaped(words, 200)}</text>')
        x += needed
    return "".join(parts), y + 0.7 * row_px


def _legend_key(kind: str, x: float, y: float, key_px: float, style: MapStyle) -> str:
    at = np.array([x + 0.42 * key_px, y])
    if kind == "path":
        return f'<polyline class="path" points="{x:.1f},{y:.1f} {x + 0.8 * key_px:.1f},{y:.1f}"/>'
    if not kind:
        return ""
    box = at + np.array([[-1.0, -0.7], [1.0, -0.7], [1.0, 0.7], [-1.0, 0.7]]) * 0.34 * key_px
    return f'<g class="mark {kind}"><polygon class="box" points="{corners(box)}"/>{_symbol(kind, at, style.dot_px)}</g>'


def _ids(ids: Sequence[int]) -> str:
    return ", ".join(f"#{i}" for i in ids[:8]) + (f" and {len(ids) - 8} more" if len(ids) > 8 else "")
