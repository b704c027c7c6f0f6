"""What every map of the report has around its things: sizes, grid, scale bar and the way of the camera."""

from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.report.escaping import escaped
from seo_slam.report.label_layout import Placement
from seo_slam.report.projection import View

_MOST_PATH_POINTS = 800


@dataclass(frozen=True, slots=True)
class MapStyle:
    """Sizes for one width of screen; all in pixels of the picture, which is shown at about its own size.

    ``tallest`` and ``flattest`` are heights as shares of the width.
    """

    name: str
    width_px: float
    font_px: float
    dot_px: float
    margin_px: float
    grid_px: float
    tallest: float
    flattest: float


def grid(view: View, style: MapStyle, names: tuple[str, str]) -> str:
    """Lines with their metres; ``names`` are those of the axes."""
    step = view.grid_step_m(style.grid_px)
    w, h, font = view.width_px, view.height_px, style.font_px
    small = f'font-size="{0.85 * font:g}"'
    lines, texts = [], []
    for metres, x in view.lines(0, step):
        lines.append(f"M{x:.1f} 0V{h:g}")
        if 2.5 * font < x < w - 9 * font:
            texts.append(f'<text x="{x:.1f}" y="{h - 5:.1f}" text-anchor="middle">{metres:.10g}</text>')
    for metres, y in view.lines(1, step):
        lines.append(f"M0 {y:.1f}H{w:g}")
        if 2.5 * font < y < h - 2 * font:
            texts.append(f'<text x="5" y="{y - 3:.1f}">{metres:.10g}</text>')
    return (
        f'<path class="grid" d="{"".join(lines)}"/><g class="ticks" {small}>{"".join(texts)}'
        f'<text class="axis" x="5" y="{font + 3:g}">{escaped(names[1])} ↑ m</text>'
        f'<text class="axis" x="{w - 5:g}" y="{h - 5:g}" text-anchor="end">{escaped(names[0])} → m</text></g>'
    )


def scale_bar_box(view: View, style: MapStyle) -> list[float]:
    """Left, top, right, bottom of the scale bar, pixels."""
    length = view.grid_step_m(style.grid_px) * view.px_per_m
    right, bottom = view.width_px - 12.0, view.height_px - 1.9 * style.font_px
    return [right - max(length, 5 * style.font_px), bottom - 1.9 * style.font_px, right, bottom]


def scale_bar(view: View, style: MapStyle) -> str:
    """A bar as long as one step of the grid."""
    step = view.grid_step_m(style.grid_px)
    _, _, right, bottom = scale_bar_box(view, style)
    left = right - step * view.px_per_m
    name = f"{step:g} m" if step >= 1 else f"{100 * step:g} cm"
    return (
        f'<g class="scale"><path d="M{left:.1f} {bottom - 6:.1f}v6H{right:.1f}v-6"/>'
        f'<text x="{right - 4:.1f}" y="{bottom - 9:.1f}" text-anchor="end">{name}</text></g>'
    )


def path_line(path: FloatArray, view: View) -> str:
    """The way of the camera (N, 2), metres on the plane, thinned but with its end."""
    if len(path) == 0:
        return ""
    every = max(int(np.ceil(len(path) / _MOST_PATH_POINTS)), 1)
    points = view.pixels(np.concatenate([path[:-1:every], path[-1:]]))
    return f'<polyline class="path" points="{corners(points)}"/>'


def corners(points_px: FloatArray) -> str:
    """Points (N, 2) as the value of a ``points`` attribute."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points_px)


def label_anchor(place: Placement, centre_px: FloatArray, font_px: float) -> tuple[str, str]:
    """The attributes of a label's ``<text>``, and the line that leads to it from its point ("" if it stands beside)."""
    left, top, right, bottom = place.box_px
    leader = ""
    if place.leader:
        tip = np.clip(centre_px, [left, top], [right, bottom])
        leader = f'<path class="leader" d="M{centre_px[0]:.1f} {centre_px[1]:.1f}L{tip[0]:.1f} {tip[1]:.1f}"/>'
    if right <= centre_px[0]:
        anchor, x = "end", right
    elif left >= centre_px[0]:
        anchor, x = "start", left
    else:
        anchor, x = "middle", (left + right) / 2
    return f'x="{x:.1f}" y="{top + 0.95 * font_px:.1f}" text-anchor="{anchor}"', leader
