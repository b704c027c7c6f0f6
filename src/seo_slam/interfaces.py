"""What a plug-in must look like.

``Protocol`` where we only ask for a shape; an ``ABC`` where we also hand over code (``Associator`` in association/,
``Agent`` in agents/). ``seo_slam.testing`` has a contract check for each: ``check_detector(mine)`` and so on.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.records import Edit, KeyframeRecord
from seo_slam.types import (
    Association,
    Estimate,
    Frame,
    IntArray,
    Landmark,
    Landmarks,
    Motion,
    Observations,
)


@runtime_checkable
class Detector(Protocol):
    """Finds objects in the colour image.

    ``detect`` may return ``Detections`` or any object with boxes, labels and scores: see ``perception.adapters.to_detections``.
    """

    def detect(self, frame: Frame) -> Any:
        """Return what is in ``frame.rgb``; an empty ``Detections`` when nothing is."""
        ...


@runtime_checkable
class Odometry(Protocol):
    """Says how the camera moved."""

    def update(self, frame: Frame) -> Motion:
        """Return the motion from the frame given before to this one. Called once a frame, in order of time."""
        ...


@runtime_checkable
class AssignmentSolver(Protocol):
    """Solves a linear assignment problem."""

    def solve(self, cost: FloatArray) -> IntArray:
        """Return (K,) int64: the column given to each row, all different, so that the sum of ``cost`` (K, M), M >= K, is least.

        Raises:
            FrameError: a cost is not finite, or there are fewer columns than rows.
        """
        ...


@runtime_checkable
class Embedder(Protocol):
    """Turns words into vectors."""

    @property
    def name(self) -> str:
        """Which model this is; written into the map, so that a query uses the same one."""
        ...

    @property
    def size(self) -> int:
        """D, the length of a vector."""
        ...

    def embed_text(self, texts: Sequence[str]) -> FloatArray:
        """Return (N, D) float64 unit rows."""
        ...


@runtime_checkable
class ChatModel(Protocol):
    """A language model that may see images."""

    def complete(self, system: str, text: str, images: Sequence[np.ndarray[Any, np.dtype[np.uint8]]] = ()) -> str:
        """Return the reply to one message; ``images`` are uint8 (H, W, 3) RGB.

        Raises:
            AgentError: no reply could be had.
        """
        ...


@runtime_checkable
class Smoother(Protocol):
    """Estimates camera poses and landmark positions from odometry and measurements (Eq 1)."""

    def start(self, T_world_camera: FloatArray, covariance: FloatArray, landmarks: Landmarks | None = None) -> Estimate:
        """Place the first camera, and the landmarks of a map to be continued, with their uncertainty."""
        ...

    def predict(self, motion: Motion) -> Estimate:
        """Where the camera is after ``motion`` from the last keyframe. Changes nothing."""
        ...

    def update(self, motion: Motion | None, observations: Observations, landmark_ids: IntArray, robust: bool = True) -> Estimate:
        """Add a keyframe (``motion`` from the last one; None for the first) and its measurements, and solve.

        Args:
            motion: composed since the last keyframe.
            observations: K rows.
            landmark_ids: (K,) of known or new ids, all >= 0.
            robust: whether measurements get a robust loss.

        Raises:
            OptimizationError: the graph has no solution.
        """
        ...

    def remove(self, landmark_id: int) -> None:
        """Take all factors of a landmark out of the graph."""
        ...

    def merge(self, keep_id: int, drop_id: int) -> None:
        """Give all measurements of ``drop_id`` to ``keep_id``."""
        ...

    def rename(self, old_id: int, new_id: int) -> None:
        """Give a landmark another id, one that the graph does not hold (any more): a thing that moved keeps its name.

        Raises:
            UnknownLandmarkError: there is no ``old_id``, or a landmark ``new_id`` already.
        """
        ...

    def positions(self) -> tuple[IntArray, FloatArray]:
        """Ids (N,) and positions (N, 3), world frame, of all landmarks, by rising id."""
        ...

    def covariances(self, landmark_ids: IntArray) -> FloatArray:
        """(N, 3, 3) marginal covariances, world frame, of landmarks."""
        ...

    def poses(self) -> FloatArray:
        """(T, 4, 4) poses ``T_world_camera`` of all keyframes as estimated now."""
        ...


@runtime_checkable
class MapStore(Protocol):
    """Keeps every keyframe, so that a process killed at any moment loses nothing that was committed."""

    def commit(self, record: KeyframeRecord) -> None:
        """Keep a keyframe, wholly or not at all.

        Raises:
            MapError: its id does not rise, or the store is closed.
        """
        ...

    def keyframe(self, keyframe_id: int) -> KeyframeRecord:
        """Return a keyframe as it was committed, but for the observations' clouds, which a store need not keep.

        Raises:
            MapError: no such keyframe.
        """
        ...

    def set_meta(self, key: str, value: str) -> None:
        """Keep a fact about the whole map, such as its "gravity" or "embedder"."""
        ...

    def meta(self) -> dict[str, str]:
        """Every fact kept by ``set_meta``."""
        ...

    def keyframe_ids(self) -> IntArray:
        """(T,) ids of the keyframes kept, rising."""
        ...

    def landmarks(self) -> tuple[Landmark, ...]:
        """All landmarks in the map, by rising id, tentative ones included."""
        ...

    def near(self, p_world: FloatArray, radius_m: float) -> tuple[int, ...]:
        """Ids of landmarks within ``radius_m`` of a point (3,), nearest first."""
        ...

    def next_id(self) -> int:
        """The lowest landmark id that was never used, also not by a landmark that left the map."""
        ...

    def history(self, landmark_id: int) -> tuple[tuple[int, str, str, str], ...]:
        """``(keyframe_id, kind, detail, source)`` of every event of a landmark, oldest first; also of ids that left the map."""
        ...

    def close(self) -> None:
        """Release files. A closed store takes no more commits."""
        ...


class Associator(ABC):
    """Decides which landmark each observation belongs to (SEO-SLAM III-B). Subclass it, or start from ``TwoStageAssociator``."""

    @abstractmethod
    def associate(self, observations: Observations, landmarks: Landmarks, estimate: Estimate) -> Association:
        """Return a landmark id, ``NEW`` or ``REJECTED`` for each of the K observations; no id twice.

        Args:
            observations: K rows, camera frame.
            landmarks: the whole map, tentative ones included, world frame.
            estimate: the predicted camera pose; ``estimate.joint_covariance(ids)`` is Sigma of Eq 4.
        """


@dataclass(frozen=True, slots=True, eq=False)
class AgentView:
    """The immutable view of the map that an agent is given.

    Attributes:
        frame: the image.
        T_world_camera: (4, 4) pose of its camera.
        landmarks: stable landmarks with ids and versions, world frame.
        boxes_px: landmark id -> (4,) box of it in the image, for those that project into it.
    """

    frame: Frame
    T_world_camera: FloatArray
    landmarks: Landmarks
    boxes_px: dict[int, FloatArray]


class Agent(ABC):
    """Looks at the map and proposes edits; the map disposes (SEO-SLAM III-D). Subclass it and write ``propose``."""

    @property
    def name(self) -> str:
        """Written beside every edit of this agent."""
        return type(self).__name__

    @abstractmethod
    def propose(self, view: AgentView) -> Sequence[Edit]:
        """Return edits of landmarks in ``view``; an empty sequence to abstain.

        Raises:
            AgentError: no answer could be had; it becomes a warning and the run goes on.
        """
