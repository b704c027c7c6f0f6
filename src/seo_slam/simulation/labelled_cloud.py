"""The true points of a simulated recording: every surface that was in view, with the thing and the class that it belongs to."""

from collections.abc import Iterator

import numpy as np

from seo_slam.config import KeyframeSettings
from seo_slam.errors import ConfigError, EvaluationError
from seo_slam.evaluation.labelled_points import LabelledCloud
from seo_slam.geometry import FloatArray, transform_points
from seo_slam.simulation.detector import DetectorKnobs
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.simulation.structure_names import StructureNames
from seo_slam.simulation.true_views import keyframe_indices
from seo_slam.simulation.world import STRUCTURE_ID
from seo_slam.types import IntArray

_PENDING = 400_000  # points that wait to be put together
_HALF = 1 << 15  # cells on either side of the origin


def labelled_cloud(
    recording: SimulatedRecording, voxel_m: float = 0.02, every: int = 1, keyframes: KeyframeSettings | None = None
) -> LabelledCloud:
    """Return the surfaces that were in view, at true poses and exact depth, of the world as it is at the end.

    A thing that was moved is taken only where it is at the end. Structure gets instances of its own, with ids above all things': one of
    all walls, one of all floors, one of all ceilings, and one for each other piece (a table that is no thing, a curtain).

    Args:
        recording: the frames are drawn, or taken from its cache.
        voxel_m: one point, the mean, for each cube of this side and each thing.
        every: only every so-manieth keyframe.
        keyframes: which frames are keyframes; None: those of the default settings along the true path.

    Returns:
        Points with instances and classes, and for each thing the keyframes that saw it by enough pixels for a detector
        (``visible_keyframes``; only those drawn, so give ``every`` 1 if it matters). Class names are those of the whole world, in
        alphabetical order.

    Raises:
        ConfigError: a voxel or a step that is not above 0.
        EvaluationError: nothing was in view.
    """
    if not (np.isfinite(voxel_m) and voxel_m > 0):
        raise ConfigError(f"voxel_m: got {voxel_m}, wanted metres above 0")
    if every < 1:
        raise ConfigError(f"every: got {every}, wanted 1 or more")
    things = recording.scene.end.things
    structure = StructureNames(recording.scene.end)
    first_piece = max((thing.id for thing in things), default=0) + 1
    names = {thing.id: thing.label for thing in things} | {first_piece + i: name for i, name in enumerate(structure.names)}
    class_names = tuple(sorted(set(names.values())))
    voxels = _Voxels(voxel_m)
    seen = dict.fromkeys(names, 0)
    enough_px = DetectorKnobs().smallest_in(recording.camera.height, recording.camera.width)
    for p_world, ids in _views(recording, structure, first_piece, keyframe_indices(recording.trajectory, keyframes)[::every]):
        voxels.add(p_world, ids)
        for number, count in zip(*np.unique(ids, return_counts=True), strict=True):
            seen[int(number)] += int(count >= enough_px)
    p_world, ids = voxels.points()
    if not len(p_world):
        raise EvaluationError(f"{recording.name}: got no surface in view, wanted a recording that shows something")
    class_of = {number: class_names.index(name) for number, name in names.items()}
    class_ids = np.array([class_of[number] for number in ids.tolist()], dtype=np.int64)
    return LabelledCloud(p_world, ids, class_ids, class_names, seen)


def _views(
    recording: SimulatedRecording, structure: StructureNames, first_piece: int, indices: list[int]
) -> Iterator[tuple[FloatArray, IntArray]]:
    """Points (M, 3) and instances (M,) of each view that still hold at the end."""
    camera = recording.camera
    since = {thing.id: recording.scene.last_change_s(thing.id) for thing in recording.scene.end.things}
    for index in indices:
        timestamp_s = float(recording.trajectory.timestamps_s[index])
        view = recording.rendered(index)
        v, u = np.nonzero(view.depth_m > 0)
        ids = view.instance_ids[v, u].astype(np.int64)
        holds = [STRUCTURE_ID, *(number for number, stamp_s in since.items() if timestamp_s >= stamp_s)]
        kept = np.isin(ids, holds)
        v, u, ids = v[kept], u[kept], ids[kept]
        p_camera = camera.back_project(np.stack([u, v], axis=-1).astype(np.float64), view.depth_m[v, u])
        p_world = transform_points(recording.trajectory.T_world_camera[index], p_camera)
        of_structure = ids == STRUCTURE_ID
        ids[of_structure] = first_piece + structure.piece_of(p_world[of_structure])
        yield p_world, ids


class _Voxels:
    """Means of points by voxel and instance, put together from many views."""

    def __init__(self, voxel_m: float) -> None:
        self._voxel_m = voxel_m
        self._keys = np.zeros(0, dtype=np.int64)  # instance and cell in one number
        self._sums = np.zeros((0, 4))  # of x, y, z and of how many points
        self._waiting: list[tuple[IntArray, FloatArray]] = []

    def add(self, p_world: FloatArray, ids: IntArray) -> None:
        """Take points (M, 3) of instances (M,)."""
        cells = np.floor(p_world / self._voxel_m).astype(np.int64) + _HALF
        if len(cells) and (cells.min() < 0 or cells.max() >= 2 * _HALF):
            raise ConfigError(f"voxel_m: got {self._voxel_m}, wanted one that cuts the world into at most {2 * _HALF} cells each way")
        keys = ((ids * 2 * _HALF + cells[:, 0]) * 2 * _HALF + cells[:, 1]) * 2 * _HALF + cells[:, 2]
        self._waiting.append(_together(keys, np.column_stack([p_world, np.ones(len(p_world))])))
        if sum(len(keys) for keys, _ in self._waiting) > max(_PENDING, len(self._keys)):
            self._merge()

    def points(self) -> tuple[FloatArray, IntArray]:
        """Return the means (N, 3) and instances (N,), by rising instance and cell."""
        self._merge()
        return self._sums[:, :3] / self._sums[:, 3:], self._keys // (2 * _HALF) ** 3

    def _merge(self) -> None:
        keys = np.concatenate([self._keys, *(keys for keys, _ in self._waiting)])
        sums = np.concatenate([self._sums, *(sums for _, sums in self._waiting)])
        self._keys, self._sums = _together(keys, sums)
        self._waiting = []


def _together(keys: IntArray, sums: FloatArray) -> tuple[IntArray, FloatArray]:
    """Add up the rows of equal keys; keys come back rising."""
    if not len(keys):
        return keys, sums
    order = np.argsort(keys, kind="stable")
    keys, sums = keys[order], sums[order]
    starts = np.flatnonzero(np.concatenate([[True], np.diff(keys) != 0]))
    return keys[starts], np.add.reduceat(sums, starts, axis=0)
