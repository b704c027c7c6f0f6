"""The report's map: landmarks, their uncertainty and footprints, and the way of the camera, as SVG for a page."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.records import Trajectory
from seo_slam.report.escaping import clean_text, escaped
from seo_slam.report.label_layout import Placement, place_labels
from seo_slam.report.map_frame import MapStyle, corners, grid, label_anchor, path_line, scale_bar, scale_bar_box
from seo_slam.report.projection import Projection, View, choose_projection, far_away, fit_view, hull
from seo_slam.types import Landmark

_LABEL_CHARACTERS = 24
_SIGMAS = 2.0


WIDE = MapStyle("wide", 920, 13, 4.0, 46, 70, 0.72, 0.45)
NARROW = MapStyle("narrow", 360, 12, 3.5, 30, 52, 1.25, 0.8)


@dataclass(frozen=True, slots=True, eq=False)
class DrawnLandmark:
    """A landmark on the plane of the map: ``centre`` (2,), ``outline`` (H, 2), ``covariance`` (2, 2), metres."""

    landmark: Landmark
    centre: FloatArray
    outline: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything on the plane of the map, before it has a size.

    Attributes:
        projection: the plane.
        drawn: landmarks inside the picture, those seen most often first.
        left_out: ids of landmarks too far away to be drawn with the others, or with a position that is not finite.
        path: (N, 2) camera positions; ``headings`` (2, 2): where the first and the last camera look.
        extent: (M, 2) points that the picture must hold.
    """

    projection: Projection
    drawn: tuple[DrawnLandmark, ...]
    left_out: tuple[int, ...]
    path: FloatArray
    headings: FloatArray
    extent: FloatArray


def make_scene(landmarks: Sequence[Landmark], gravity: str, trajectory: Trajectory) -> Scene:
    """Project landmarks (stable and tentative) and trajectory on the plane that fits ``gravity``."""
    projection = choose_projection(gravity, trajectory)
    poses = trajectory.T_world_camera.reshape(-1, 4, 4)
    path = projection.points(poses[:, :3, 3])
    centres = projection.points(np.array([m.position_m for m in landmarks], dtype=np.float64).reshape(-1, 3))
    thin = path[:: max(len(path) // max(len(landmarks), 1), 1)]  # as many points of the path as landmarks: neither outvotes
    far = far_away(np.concatenate([centres, thin]))[: len(centres)]
    ranked = sorted((i for i in range(len(centres)) if not far[i]), key=lambda i: (-landmarks[i].observations, landmarks[i].id))
    near = [_project(landmarks[i], centres[i], projection) for i in ranked]
    core = np.concatenate([path, *(d.outline for d in near if d.landmark.state == "stable")])
    drawn = tuple(d for d in near if d.landmark.state == "stable" or _is_close(d.centre, core))
    ends = poses[[0, -1]] if len(poses) else np.zeros((0, 4, 4))
    return Scene(
        projection=projection,
        drawn=drawn,
        left_out=tuple(sorted({m.id for m in landmarks} - {d.landmark.id for d in drawn})),
        path=path,
        headings=ends[:, :3, 2] @ projection.axes.T,
        extent=np.concatenate([core, *(d.outline for d in drawn)]),
    )


def _is_close(point: FloatArray, core: FloatArray) -> bool:
    """Whether a tentative landmark is near enough to what is sure, so that drawing it shrinks the rest by a third at most."""
    if len(core) == 0:
        return True
    low, high = core.min(axis=0), core.max(axis=0)
    return bool((np.abs(point - (low + high) / 2) <= 0.75 * max(float((high - low).max()), 0.5)).all())


def _project(landmark: Landmark, centre: FloatArray, projection: Projection) -> DrawnLandmark:
    half = np.nan_to_num(np.abs(landmark.size_m)) / 2
    corners = landmark.position_m + np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half
    covariance = projection.covariance(np.nan_to_num(landmark.covariance_m2))
    return DrawnLandmark(landmark, centre, hull(projection.points(corners)), covariance)


def sigma_ellipse(covariance: FloatArray, sigmas: float = _SIGMAS) -> tuple[float, float, float]:
    """Half axes (greater first, metres) and the angle of the greater one (radians, counter-clockwise from right) of a (2, 2)."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    minor, major = sigmas * np.sqrt(np.maximum(values, 0.0))
    return float(major), float(minor), float(np.arctan2(vectors[1, 1], vectors[0, 1]))


def render_map(scene: Scene, style: MapStyle, colour_class: Callable[[str], str]) -> str:
    """Return one ``<svg>``; ``colour_class`` gives the CSS class of a label. Landmarks link to ``#landmark-<id>``."""
    view = fit_view(scene.extent, style.width_px, style.tallest, style.flattest, style.margin_px)
    centres = view.pixels(np.array([d.centre for d in scene.drawn]).reshape(-1, 2))
    reach = np.array([[-1.0, -1.0, 1.0, 1.0]]) * (style.dot_px + 1)
    obstacles = np.concatenate([np.tile(centres, 2) + reach, [scale_bar_box(view, style)]])
    names = [_short_name(d.landmark) for d in scene.drawn]
    inside = (4.0, 4.0, view.width_px - 4.0, view.height_px - style.font_px - 8.0)
    placements = place_labels(centres, names, style.font_px, inside, obstacles, gap_px=style.dot_px + 4)
    painted = sorted(zip(scene.drawn, centres, strict=True), key=lambda pair: -_extent_m(pair[0]))  # small things on top
    clip = f"map-edge-{style.name}"
    parts = [
        f'<svg class="map map-{style.name}" id="map-{style.name}" viewBox="0 0 {view.width_px:g} {view.height_px:g}" '
        f'role="group" aria-label="Map: {escaped(scene.projection.caption, 300)}" font-size="{style.font_px:g}">',
        f'<clipPath id="{clip}"><rect width="{view.width_px:g}" height="{view.height_px:g}" rx="8"/></clipPath>',
        f'<rect class="ground" width="{view.width_px:g}" height="{view.height_px:g}" rx="8"/><g clip-path="url(#{clip})">',
        grid(view, style, scene.projection.names),
        _path(scene, view, style),
        *(_landmark(d, centre, view, style, colour_class(d.landmark.label)) for d, centre in painted),
        *(
            _label(d.landmark, name, centre, place, style)
            for d, name, centre, place in zip(scene.drawn, names, centres, placements, strict=True)
            if place is not None
        ),
        "</g>",
        scale_bar(view, style),
        "</svg>",
    ]
    return "".join(parts)


def _short_name(landmark: Landmark) -> str:
    return clean_text(landmark.label, _LABEL_CHARACTERS) or f"#{landmark.id}"


def _extent_m(drawn: DrawnLandmark) -> float:
    return float(np.ptp(drawn.outline, axis=0).sum())


def _path(scene: Scene, view: View, style: MapStyle) -> str:
    if len(scene.path) == 0:
        return ""
    ends = view.pixels(scene.path[[0, -1]])
    marks = [
        f'<g class="camera {name}"><title>camera at the {name}</title>{_view_cone(at, heading, style)}'
        f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{style.dot_px:g}"/></g>'
        for name, at, heading in zip(("start", "end"), ends, scene.headings, strict=True)
    ]
    return f"{path_line(scene.path, view)}{''.join(marks)}"


def _view_cone(at: FloatArray, heading: FloatArray, style: MapStyle) -> str:
    """A small triangle that opens where the camera looks; its length shows how level it looks."""
    ahead = np.array([heading[0], -heading[1]]) * 5.5 * style.dot_px
    across = np.array([-ahead[1], ahead[0]]) * 0.5
    tips = np.array([at, at + ahead + across, at + ahead - across])
    return f'<polygon points="{corners(tips)}"/>'


def _landmark(drawn: DrawnLandmark, centre: FloatArray, view: View, style: MapStyle, colour: str) -> str:
    m = drawn.landmark
    major, minor, angle = sigma_ellipse(drawn.covariance)
    place = f"{centre[0]:.1f} {centre[1]:.1f}"
    x, y = place.split()
    size = " x ".join(f"{100 * s:.0f}" for s in m.size_m)
    title = f"{clean_text(m.label) or 'unnamed'} #{m.id}, {m.state}, seen in {m.observations} keyframes, {size} cm"
    return (
        f'<a class="landmark {m.state} {colour}" href="#landmark-{m.id}" data-id="{m.id}"><title>{escaped(title, 240)}</title>'
        f'<polygon class="footprint" points="{corners(view.pixels(drawn.outline))}"/>'
        f'<ellipse class="sigma" rx="{major * view.px_per_m:.1f}" ry="{minor * view.px_per_m:.1f}" '
        f'transform="translate({place}) rotate({-np.degrees(angle):.1f})"/>'
        f'<circle class="touch" cx="{x}" cy="{y}" r="{3.5 * style.dot_px:g}"/>'
        f'<circle class="dot" cx="{x}" cy="{y}" r="{style.dot_px:g}"/></a>'
    )


def _label(landmark: Landmark, name: str, centre: FloatArray, place: Placement, style: MapStyle) -> str:
    where, leader = label_anchor(place, centre, style.font_px)
    return (
        f'{leader}<a class="tag {landmark.state}" href="#landmark-{landmark.id}" data-id="{landmark.id}" tabindex="-1">'
        f"<text {where}>{escaped(name)}</text></a>"
    )
