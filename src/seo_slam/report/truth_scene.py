"""What is drawn where truth and map are compared, seen from above, before it has a size."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.evaluation.scores import ENOUGH_KEYFRAMES, ExtraLandmark, LandmarksResult
from seo_slam.evaluation.true_objects import FormerPlace, Truth, TruthObject
from seo_slam.geometry import FloatArray
from seo_slam.records import Trajectory
from seo_slam.report.escaping import clean_text
from seo_slam.report.projection import far_away
from seo_slam.types import Landmark

_UNKNOWN_SIZE_M = 0.08  # edge of the box of a thing whose size the truth does not say
_PATH_SHARE = 1.35  # the camera's path may make the picture so much larger, then it is cut at the edge


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """A thing on the plane, metres.

    Attributes:
        kind: "object", "seldom", "removed" or "moved" (truth), "missing", "matched", "duplicate", "ghost" or "false" (map).
        name: what stands beside it.
        title: what is told of it when the pointer rests on it.
        centre: (2,).
        size: (2,) of its box along x and y.
        leads_to: (2,) where a moved thing is now, or the true centre of a matched one; None for the others.
    """

    kind: str
    name: str
    title: str
    centre: FloatArray
    size: FloatArray
    leads_to: FloatArray | None = None

    @property
    def outline(self) -> FloatArray:
        """(4, 2) corners of its box."""
        return np.asarray(self.centre + np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * self.size)


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Truth and map on one plane (world x to the right, y up).

    Attributes:
        truth, found: the marks of either side; those whose label matters most come first.
        path: (N, 2) the way of the camera.
        extent: (M, 2) points that the picture must hold.
        left_out: ids of landmarks too far away to be drawn with the others.
    """

    truth: tuple[Mark, ...]
    found: tuple[Mark, ...]
    path: FloatArray
    extent: FloatArray
    left_out: tuple[int, ...]


def compare(landmarks: Iterable[Landmark], truth: Truth, result: LandmarksResult, trajectory: Trajectory | None = None) -> Comparison:
    """Lay out a scored map beside its truth.

    Args:
        landmarks: those that were scored, true world.
        truth: what they were scored against.
        result: of ``evaluate_landmarks``.
        trajectory: camera poses, true world; None draws none.
    """
    by_id = {landmark.id: landmark for landmark in landmarks if landmark.state == "stable"}
    objects = {item.id: item for item in truth.objects}
    true_marks = (*(_object(item) for item in truth.objects), *_left_marks(truth, result.radius_m))
    extra = [_extra(by_id[item.landmark_id], item) for item in result.extra]
    far = _strays(extra, true_marks)
    found = (
        *(mark for mark, stray in zip(extra, far, strict=True) if not stray),
        *(_missing(objects[item.object_id]) for item in result.missing),
        *(_matched(by_id[pair.landmark_id], objects[pair.object_id], pair.distance_m) for pair in result.matched),
    )
    path = trajectory.T_world_camera[:, :2, 3] if trajectory is not None else np.zeros((0, 2))
    return Comparison(
        truth=true_marks,
        found=found,
        path=path,
        extent=_extent(np.concatenate([mark.outline for mark in (*true_marks, *found)]), path),
        left_out=tuple(item.landmark_id for item, stray in zip(result.extra, far, strict=True) if stray),
    )


def _object(item: TruthObject) -> Mark:
    centre, size = _place(item)
    seldom = item.visible_keyframes is not None and item.visible_keyframes < ENOUGH_KEYFRAMES
    seen = "" if item.visible_keyframes is None else f", in view in {item.visible_keyframes} keyframes"
    return Mark("seldom" if seldom else "object", item.labels[0], f"{_called(item)}{seen}", centre, size)


def _place(item: TruthObject) -> tuple[FloatArray, FloatArray]:
    if item.box_m is None:
        return item.centers_m[0, :2], np.full(2, _UNKNOWN_SIZE_M)
    return item.box_m.mean(axis=0)[:2], (item.box_m[1] - item.box_m[0])[:2]


def _called(item: TruthObject) -> str:
    return f"{item.labels[0]} ({item.id})"


def _left_marks(truth: Truth, radius_m: float) -> list[Mark]:
    """The places that objects left, each with an arrow to the object's next place, if there is one."""
    now = {item.id: _place(item)[0] for item in truth.objects}
    routes: dict[str, list[FormerPlace]] = {}
    for place in truth.left_places(radius_m):
        route = routes.setdefault(place.id, [])
        if not route or np.abs(route[-1].center_m - place.center_m).max() > 1e-6:  # where one move ends, the next begins
            route.append(place)
    marks = []
    for thing_id, route in routes.items():
        ends = [*(place.center_m[:2] for place in route[1:]), now.get(thing_id)]
        for place, end in zip(route, ends, strict=True):
            name = place.labels[0] if place.labels else thing_id
            size = np.full(2, _UNKNOWN_SIZE_M) if place.size_m is None else place.size_m[:2]
            kind, words = ("removed", "was taken away from here") if end is None else ("moved", "was moved away from here")
            marks.append(Mark(kind, name, f"{name} ({thing_id}) {words}", place.center_m[:2], size, end))
    return marks


def _extra(landmark: Landmark, item: ExtraLandmark) -> Mark:
    what = f"{item.kind} of {item.of}" if item.of else f"false, nearest is {item.nearest_object_id}, {item.nearest_m:.2f} m away"
    return Mark(item.kind, _name(landmark), f"{_title(landmark)}: {what}", landmark.position_m[:2], _size(landmark))


def _missing(item: TruthObject) -> Mark:
    centre, size = _place(item)
    return Mark("missing", item.labels[0], f"{_called(item)}: no landmark", centre, size)


def _matched(landmark: Landmark, item: TruthObject, distance_m: float) -> Mark:
    nearest = int(np.argmin(np.linalg.norm(item.centers_m - landmark.position_m, axis=1)))
    title = f"{_title(landmark)}: {_called(item)}, {100 * distance_m:.1f} cm off"
    return Mark("matched", _name(landmark), title, landmark.position_m[:2], _size(landmark), item.centers_m[nearest, :2])


def _name(landmark: Landmark) -> str:
    return clean_text(landmark.label) or f"#{landmark.id}"


def _title(landmark: Landmark) -> str:
    return f"landmark {landmark.id} ({clean_text(landmark.label) or 'unnamed'})"


def _size(landmark: Landmark) -> FloatArray:
    return np.nan_to_num(np.abs(landmark.size_m[:2]))


def _strays(extra: Sequence[Mark], true_marks: Sequence[Mark]) -> list[bool]:
    """Which landmarks without an object are so far from everything that they would shrink the picture to a dot."""
    centres = np.array([mark.centre for mark in (*extra, *true_marks)]).reshape(-1, 2)
    return [bool(far) for far in far_away(centres)[: len(extra)]]


def _extent(core: FloatArray, path: FloatArray) -> FloatArray:
    """The things, and the camera's path where that leaves them large enough to be told apart."""
    both = np.concatenate([core, path])
    return both if (np.ptp(both, axis=0) <= _PATH_SHARE * max(float(np.ptp(core, axis=0).max()), 1.0)).all() else core
