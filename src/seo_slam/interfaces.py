"""What a plug-in must look like.

``Protocol`` where we only ask for a shape; an ``ABC`` where we also hand over code (``Associator`` in association/,
``Agent`` in agents/). ``seo_slam.testing`` has a contract check for each: ``check_detector(mine)`` and so on.
"""

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.records import AgentRole, Amendment, Edit, EditRecord, KeyframeRecord
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
        """Return (N, D) float64 unit rows. Agents in the background ask from their thread; what was asked before should cost nothing."""
        ...


@runtime_checkable
class ImageEmbedder(Embedder, Protocol):
    """Turns words and pictures into vectors of one space, such as CLIP."""

    def embed_image(self, images: Sequence[NDArray[np.uint8]]) -> FloatArray:
        """Return (N, D) float64 unit rows of pictures (H, W, 3)."""
        ...


@runtime_checkable
class CropEmbedder(Protocol):
    """An image encoder that wants the whole frame, not crops: one with dense features, or a simulated one."""

    def embed_crops(self, frame: Frame, boxes_px: FloatArray) -> FloatArray:
        """Return (N, D) float64 unit rows of what is in boxes (N, 4) of a frame, in the space of the words."""
        ...


@dataclass(frozen=True, slots=True)
class ChatRequest:
    """One question to a chat model.

    Attributes:
        system: the instruction; ours, never text from an image.
        text: the question; what detectors or models said stands in it as JSON.
        images: encoded files, PNG or JPEG.
        schema: JSON schema of the reply, every field required; None for free text.
        schema_name: what the schema is called.
        turns: (reply, complaint) of earlier attempts at the same question, oldest first.
        temperature, max_tokens: the paper's values by default (SEO-SLAM IV-B).
    """

    system: str
    text: str
    images: tuple[bytes, ...] = ()
    schema: Mapping[str, Any] | None = None
    schema_name: str = "reply"
    turns: tuple[tuple[str, str], ...] = ()
    temperature: float = 0.7
    max_tokens: int = 250


@dataclass(frozen=True, slots=True)
class ChatReply:
    """What a chat model said.

    Attributes:
        text: the reply, as it came.
        model: which model said it.
        prompt_tokens, completion_tokens: as the server counts them; 0 for a cached reply, estimated where the server says nothing.
        cached: it was taken from a cache.
    """

    text: str
    model: str = ""
    prompt_tokens: int = 0
    completion_tokens: int = 0
    cached: bool = False


@runtime_checkable
class ChatModel(Protocol):
    """A language model that may see images."""

    @property
    def name(self) -> str:
        """Which model this is; written beside every edit that it led to."""
        ...

    async def complete(self, request: ChatRequest) -> ChatReply:
        """Return the reply to one question. Many may be asked at once.

        Raises:
            ChatRequestError: no reply could be had.
            ChatReplyError: the reply is empty or refused.
            BudgetExceeded: no question is allowed any more.
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

    def split(self, landmark_id: int, new_id: int, measurements: IntArray) -> None:
        """Give some measurements of a landmark to a new one.

        Args:
            landmark_id: keeps the others, of which there must be one, and what a continued map knew of it, which is enough.
            new_id: one that the graph does not hold.
            measurements: (M,) which of its measurements, counted from 0 in the order in which they came. After a merge those of the
                landmark that stayed come first. What a continued map knew is not counted.

        Raises:
            UnknownLandmarkError: there is no ``landmark_id``, ``new_id`` exists, or no such measurement, or nothing would be left for
                one of the two. Nothing has changed then.
        """
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
        """(T, 4, 4) poses ``T_world_camera`` of all keyframes as estimated now; maybe read-only, and never changed once given out."""
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
        """Return a keyframe as it was committed, but for clouds, which a store need not keep, and embeddings, maybe in single precision.

        Raises:
            MapError: no such keyframe.
        """
        ...

    def amend(self, amendment: Amendment) -> None:
        """Keep a change of the map that no keyframe made, wholly or not at all.

        Raises:
            MapError: its keyframe is not the newest, or the store is closed.
        """
        ...

    def edits(self) -> tuple[EditRecord, ...]:
        """Everything that agents proposed and what became of it, in the order it was kept; the first is edit number 1."""
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
class Evidence:
    """What the map knows of a landmark beside its row in ``Landmarks``.

    Attributes:
        existence: probability that it is there.
        hits, misses: views in which it should have been seen, and was, and was not.
        weights: word -> summed score of the detections that said it; what agents said is not in it.
        surface_world: (M, 3) points of its surface, metres.
        seen_apart: other landmark -> keyframes in which both were detected at once, in boxes of their own.
        is_new: no agent has said anything of it yet.
    """

    existence: float
    hits: int
    misses: int
    weights: Mapping[str, float]
    surface_world: FloatArray
    seen_apart: Mapping[int, int]
    is_new: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class AgentView:
    """The immutable view of the map that an agent is given.

    Attributes:
        frame: the image.
        T_world_camera: (4, 4) pose of its camera.
        landmarks: stable landmarks with ids and versions, world frame.
        boxes_px: landmark id -> (4,) box of it in the image, for those that are to be seen in it.
        keyframe_id: which keyframe the image is.
        asked: ids that this question is about, all with a box; empty: all with a box.
        known_labels: labels that agents gave so far; alike things are to get alike labels.
        evidence: landmark id -> what else is known, for those with a box.
    """

    frame: Frame
    T_world_camera: FloatArray
    landmarks: Landmarks
    boxes_px: Mapping[int, FloatArray]
    keyframe_id: int = 0
    asked: tuple[int, ...] = ()
    known_labels: tuple[str, ...] = ()
    evidence: Mapping[int, Evidence] = field(default_factory=dict)


class Agent(ABC):
    """Looks at the map and proposes edits; the map disposes (SEO-SLAM III-D). Subclass it and write ``propose``.

    Attributes:
        role: when it is asked (Fig 3). "verification": of every landmark in view, new ones first; it answers ``Confirm``, ``Doubt`` or
            ``Remove``. "description": of new landmarks and doubted ones; ``Relabel``, ``Confirm`` or ``Remove``. "merging": of those
            confirmed or relabelled; ``Merge``. "any": of every view, once, and may answer with anything.
        most_landmarks: how many it is asked of at once.
        confirms: False for a verification agent that only objects; description waits for one that confirms, if there is one.
    """

    role: AgentRole = "any"
    most_landmarks: int = 1000
    confirms: bool = True

    @property
    def name(self) -> str:
        """Written beside every edit of this agent."""
        return type(self).__name__

    @property
    def model(self) -> str:
        """Name of the model that it asks; "" if it asks none."""
        return ""

    @property
    def prompt_hash(self) -> str:
        """Which prompt it asks with; "" if it asks no model."""
        return ""

    @abstractmethod
    def propose(self, view: AgentView) -> Sequence[Edit] | Awaitable[Sequence[Edit]]:
        """Return edits of landmarks in ``view``; an empty sequence to abstain. May be an ``async def``: then many are asked at once.

        Raises:
            AgentError: no answer could be had; it becomes a warning and the run goes on.
        """
