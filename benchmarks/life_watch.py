"""Watches a map while it is made, knowing the truth at every keyframe: which landmark stands for which thing, and what is hidden."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from seo_slam.evaluation.landmarks import assign, distances
from seo_slam.evaluation.true_objects import TruthObject, reach_m
from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.pipeline import Pipeline
from seo_slam.records import MapEvent, StepResult
from seo_slam.simulation.renderer import Rendered
from seo_slam.simulation.scene import SceneChange
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.simulation.world import STRUCTURE_ID, Thing, World
from seo_slam.types import Frame

MARGIN_SHARE = 0.05
"""Share of the image at its border that counts as outside."""


@dataclass(frozen=True, slots=True)
class Seen:
    """How much of a thing is in a true image.

    Attributes:
        visible_px: pixels that show it.
        covered_px: pixels that it would cover if nothing stood before it.
        inside: whether the centre of its box is in the image by a margin.
    """

    visible_px: int
    covered_px: int
    inside: bool

    @property
    def share(self) -> float:
        """Which part of it is not hidden."""
        return self.visible_px / self.covered_px if self.covered_px else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class TrueMoment:
    """What is true at a keyframe.

    Attributes:
        timestamp_s: its stamp.
        objects: the things present; ids are those of the world, as text.
        seen: thing id -> how much of it is in the image.
        open_places: indices of those changes of the scene whose old place should be seen: inside, in range, nothing nearer before it.
    """

    timestamp_s: float
    objects: tuple[TruthObject, ...]
    seen: Mapping[int, Seen]
    open_places: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A landmark at a keyframe."""

    label: str
    p_world: FloatArray
    state: str
    existence: float


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A keyframe: what is true, and the map right after it.

    Attributes:
        true: what is true.
        landmarks: id -> landmark, in every state.
        owners: thing id -> stable landmark that stands for it: one-to-one by place alone, labels ignored.
        hits: ids of the landmarks that got an observation.
        events: of this keyframe.
    """

    true: TrueMoment
    landmarks: Mapping[int, Known]
    owners: Mapping[int, int]
    hits: frozenset[int] = frozenset()
    events: tuple[MapEvent, ...] = ()

    @property
    def timestamp_s(self) -> float:
        """Its stamp."""
        return self.true.timestamp_s


@dataclass(slots=True, eq=False)
class _Surface:
    """Running mean of a thing's visible surface, as long as it stays where it is."""

    T_world_thing: FloatArray
    total_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    points: int = 0


class LifeWatch:
    """Collects a ``Moment`` a keyframe and variant; ``on_keyframe`` goes to ``run_variants``."""

    def __init__(self, recording: SimulatedRecording, radius_m: float, max_depth_m: float) -> None:
        """Watch a recording.

        Args:
            recording: the one that the variants run on; its drawn frames should be cached.
            radius_m: of a match.
            max_depth_m: farther things cannot be mapped.
        """
        self.moments: dict[str, list[Moment]] = {}
        self._recording = recording
        self._radius_m = radius_m
        self._max_depth_m = max_depth_m
        self._surfaces: dict[int, _Surface] = {}
        self._true: tuple[int, TrueMoment] | None = None
        self._old_places = old_places(recording.scene.changes, recording)

    def on_keyframe(self, name: str, pipeline: Pipeline, frame: Frame, step: StepResult) -> None:
        """Keep what is true and what the map says of it."""
        if self._true is None or self._true[0] != frame.index:
            self._true = (frame.index, self._true_moment(frame))
        true = self._true[1]
        snapshot = pipeline.snapshot()
        known = {row.id: Known(row.label, row.position_m, row.state, row.existence) for row in (*snapshot.landmarks, *snapshot.tentative)}
        hits = frozenset(int(i) for i in step.landmark_ids if i >= 0) if step.landmark_ids is not None else frozenset()
        owners = owners_of(known, true.objects, self._radius_m)
        self.moments.setdefault(name, []).append(Moment(true, known, owners, hits, step.events))

    def _true_moment(self, frame: Frame) -> TrueMoment:
        recording, camera = self._recording, frame.camera
        T_world_camera = recording.trajectory.T_world_camera[frame.index]
        world, rendered = recording.scene.world_at(frame.timestamp_s), recording.rendered(frame.index)
        T_camera_world = inverse(T_world_camera)

        def inside(p_world: FloatArray) -> tuple[bool, float, tuple[int, int]]:
            """Whether a point is in the image by a margin, its depth, its row and column."""
            p_camera = transform_points(T_camera_world, p_world)
            uv = camera.project(p_camera)
            size = np.array([camera.width, camera.height])
            low, high = MARGIN_SHARE * size, (1.0 - MARGIN_SHARE) * size - 1.0
            if not (np.isfinite(uv).all() and (uv >= low).all() and (uv <= high).all()):
                return False, float(p_camera[2]), (0, 0)
            return bool(p_camera[2] > 0), float(p_camera[2]), (round(float(uv[1])), round(float(uv[0])))

        open_places = set()
        for index, place in self._old_places.items():
            within, z_m, pixel = inside(place.p_world)
            true_m = float(rendered.depth_m[pixel])
            if within and z_m <= self._max_depth_m and (true_m == 0 or true_m >= z_m):
                open_places.add(index)
        ids, counts = np.unique(rendered.instance_ids, return_counts=True)
        visible = dict(zip(ids.tolist(), counts.tolist(), strict=True))
        seen = {
            thing.id: Seen(visible.get(thing.id, 0), rendered.covered_px.get(thing.id, 0), inside(thing.p_world)[0])
            for thing in world.things
        }
        self._add_surfaces(world, rendered, frame, T_world_camera)
        objects = tuple(self._object(thing) for thing in world.things)
        return TrueMoment(frame.timestamp_s, objects, seen, frozenset(open_places))

    def _add_surfaces(self, world: World, rendered: Rendered, frame: Frame, T_world_camera: FloatArray) -> None:
        v, u = np.nonzero(rendered.instance_ids[::2, ::2] != STRUCTURE_ID)
        v, u = 2 * v, 2 * u
        p_world = transform_points(T_world_camera, frame.camera.back_project(np.stack([u, v], axis=-1), rendered.depth_m[v, u]))
        of = rendered.instance_ids[v, u]
        for thing in world.things:
            surface = self._surfaces.get(thing.id)
            if surface is None or not np.array_equal(surface.T_world_thing, thing.T_world_thing):
                surface = self._surfaces[thing.id] = _Surface(thing.T_world_thing)
            own = p_world[of == thing.id]
            surface.total_m = surface.total_m + own.sum(axis=0)
            surface.points += len(own)

    def _object(self, thing: Thing) -> TruthObject:
        surface = self._surfaces[thing.id]
        centers = [thing.p_world] + ([surface.total_m / surface.points] if surface.points else [])
        low, high = thing.bounds_world
        return TruthObject(
            str(thing.id), (thing.label, *thing.accepted_labels), np.array(centers), float(min(high[0] - low[0], high[1] - low[1])) / 2
        )


def old_places(changes: Sequence[SceneChange], recording: SimulatedRecording) -> dict[int, Thing]:
    """Return, by the index of each change that leaves a place, the thing as it stood there."""
    return {
        index: recording.scene.world_at(float(np.nextafter(change.timestamp_s, -np.inf))).thing(change.thing.id)
        for index, change in enumerate(changes)
        if change.event in ("removed", "moved")
    }


def owners_of(landmarks: Mapping[int, Known], objects: Sequence[TruthObject], radius_m: float) -> dict[int, int]:
    """Return thing id -> stable landmark: one-to-one, as many as possible, then nearest; labels are ignored."""
    stable = sorted(i for i, known in landmarks.items() if known.state == "stable")
    if not stable or not objects:
        return {}
    distance_m = distances(np.array([landmarks[i].p_world for i in stable]), objects)
    allowed = distance_m <= np.array([reach_m(item, radius_m) for item in objects])
    return {int(objects[column].id): stable[row] for row, column in assign(distance_m, allowed)}


def heir_of(landmark_id: int, events: Iterable[MapEvent]) -> int:
    """Return which landmark a landmark went into, by mergers and by moves that take a later one in."""
    for event in events:
        if event.kind == "merged" and event.landmark_id == landmark_id and event.other_id is not None:
            landmark_id = event.other_id
        elif event.kind == "moved" and event.other_id == landmark_id:
            landmark_id = event.landmark_id
    return landmark_id


def events_of(moments: Iterable[Moment]) -> list[MapEvent]:
    """Return the events of many moments, in order."""
    return [event for moment in moments for event in moment.events]
