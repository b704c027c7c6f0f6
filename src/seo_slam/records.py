"""What a run leaves behind: edits and events of the map, keyframes for the store, results for the caller."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray
from seo_slam.types import (
    Association,
    Detections,
    IntArray,
    Landmark,
    Observations,
    OdometryStatus,
    require_rows,
)


@dataclass(frozen=True, slots=True)
class Confirm:
    """An agent found the landmark right as it is."""

    landmark_id: int
    version: int
    source: str = ""


@dataclass(frozen=True, slots=True)
class Doubt:
    """An agent found the landmark there, but its label wrong. It changes nothing by itself: whoever describes things is asked next."""

    landmark_id: int
    version: int
    source: str = ""


@dataclass(frozen=True, slots=True)
class Relabel:
    """An agent proposes another label.

    Attributes:
        label: in words that tell alike things apart: "green hiking boot".
        category: the plain word for such a thing, "shoe", for association and scoring; "" where the label is plain itself.
    """

    landmark_id: int
    version: int
    label: str
    source: str = ""
    category: str = ""


@dataclass(frozen=True, slots=True)
class Remove:
    """An agent proposes to take the landmark, and all its factors, out of the map."""

    landmark_id: int
    version: int
    source: str = ""


@dataclass(frozen=True, slots=True)
class Merge:
    """An agent proposes that ``drop_id`` is the same thing as ``keep_id``."""

    keep_id: int
    keep_version: int
    drop_id: int
    drop_version: int
    source: str = ""


Edit = Confirm | Doubt | Relabel | Remove | Merge

AgentRole = Literal["verification", "description", "merging", "any"]

EditOutcome = Literal["applied", "noted", "stale", "refused"]


@dataclass(frozen=True, slots=True)
class Proposal:
    """An edit and where it comes from.

    Attributes:
        edit: what is proposed.
        agent, model, prompt_hash: who proposed it; the model and prompt are "" for agents that ask none.
        view_keyframe_id, view_s: the keyframe that was looked at, and its stamp.
        camera_world: where its camera was, if known: verdicts from one side are one verdict.
        role: of the agent; what it names counts as evidence, but that of role "any", which stands alone, is taken at its word.
    """

    edit: Edit
    agent: str
    model: str = ""
    prompt_hash: str = ""
    view_keyframe_id: int = 0
    view_s: float = 0.0
    camera_world: tuple[float, float, float] | None = None
    role: AgentRole = "any"


@dataclass(frozen=True, slots=True, eq=False)
class EditRecord:
    """What became of a proposal.

    Attributes:
        kind: "confirm", "doubt", "relabel", "remove", "merge" or "undo".
        landmark_id: whose; for "merge" the one that goes.
        other_id: for "merge" the one that stays, for "undo" the number of the edit that was undone, else None.
        outcome: "applied"; "noted": it counts, but changes nothing (yet); "stale": the landmark changed meanwhile; "refused".
        detail: in words: the labels, or why it was not applied.
        proposal's agent, model, prompt_hash, view_keyframe_id, view_s: see ``Proposal``.
        keyframe_id, timestamp_s: when it was judged; ``timestamp_s - view_s`` is its age.
        before: the landmarks it changed, as they were; empty if it changed none.
    """

    kind: str
    landmark_id: int
    other_id: int | None
    outcome: EditOutcome
    detail: str
    agent: str
    model: str
    prompt_hash: str
    view_keyframe_id: int
    view_s: float
    keyframe_id: int
    timestamp_s: float
    before: tuple[Landmark, ...] = ()


@dataclass(frozen=True, slots=True)
class MapEvent:
    """One line of the map's history.

    Attributes:
        kind: "created", "stable", "lost", "found", "moved", "merged", "split", "relabelled", "removed" or "confirmed"; in a
            map that was changed after its run also "undone".
        landmark_id: whose. For "merged" the landmark that goes, for "moved" the one that stays, for "split" the new one.
        detail: in words: its label, the old and new one, from where to where it moved.
        source: "pipeline" or the agent's name.
        other_id: for "merged", the landmark it went into; for "split", the one it was part of; for "moved", the id that the thing had at
            its new place until then, which is never used again; else None.
    """

    kind: str
    landmark_id: int
    detail: str = ""
    source: str = "pipeline"
    other_id: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeRecord:
    """All that a store must keep of one keyframe, committed in one transaction.

    Attributes:
        keyframe_id: 0, 1, 2, …
        timestamp_s, T_world_camera, covariance: its stamp, (4, 4) pose and (6, 6) covariance when it was committed.
        T_previous_current, motion_covariance: the odometry factor from the keyframe before.
        observations, landmark_ids: the measurements used, one row each, and the landmark each was given to.
        landmarks: landmarks that are new or changed, as they are now.
        removed_ids: landmarks that left the map (merged into another or removed).
        events: the history lines of this keyframe.
        edits: what agents proposed, and what became of it.
    """

    keyframe_id: int
    timestamp_s: float
    T_world_camera: FloatArray
    covariance: FloatArray
    T_previous_current: FloatArray
    motion_covariance: FloatArray
    observations: Observations
    landmark_ids: IntArray
    landmarks: tuple[Landmark, ...]
    removed_ids: tuple[int, ...]
    events: tuple[MapEvent, ...]
    edits: tuple[EditRecord, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Amendment:
    """A change of the map without a keyframe: edits that came after the last one, or one that was undone.

    Attributes:
        keyframe_id: the newest keyframe.
        landmarks, removed_ids, events, edits: as in ``KeyframeRecord``.
    """

    keyframe_id: int
    landmarks: tuple[Landmark, ...]
    removed_ids: tuple[int, ...]
    events: tuple[MapEvent, ...]
    edits: tuple[EditRecord, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """What one frame did.

    Attributes:
        index, timestamp_s: of the frame.
        T_world_camera: (4, 4) pose of the camera, as estimated now.
        odometry_status: "ok" or "lost".
        keyframe_id: its number, or None where the frame only moved the camera.
        detections, observations, association: None between keyframes.
        landmark_ids: (K,) the landmark each observation went into, new ones included; ``REJECTED`` where none.
        events: what changed in the map.
        edits: what agents proposed that was judged at this frame.
        warnings: the world's failures, in words; the run goes on.
        seconds: stage -> seconds.
    """

    index: int
    timestamp_s: float
    T_world_camera: FloatArray
    odometry_status: OdometryStatus
    keyframe_id: int | None = None
    detections: Detections | None = None
    observations: Observations | None = None
    association: Association | None = None
    landmark_ids: IntArray | None = None
    events: tuple[MapEvent, ...] = ()
    edits: tuple[EditRecord, ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_keyframe(self) -> bool:
        """Whether detection and mapping ran on this frame."""
        return self.keyframe_id is not None


@dataclass(frozen=True, slots=True)
class FeatureRecipe:
    """How the features of things were made (DualMap Eq 1). Scores compare only where it is the same.

    Attributes:
        image_weight: of the picture.
        text_weight: of the word.
        image_encoder: name of what looked at the pictures; "" if nothing did: the features are of words only.
    """

    image_weight: float
    text_weight: float
    image_encoder: str = ""

    @property
    def has_pictures(self) -> bool:
        """Whether pictures are part of the features: then even its own word is not quite like a thing."""
        return bool(self.image_encoder) and self.image_weight > 0

    @property
    def in_words(self) -> str:
        """For people, such as "0.7 pictures (my_clip) and 0.3 words"; the same for recipes that come to the same."""
        if not self.has_pictures:
            return "words only"
        return f"{self.image_weight:g} pictures ({self.image_encoder}) and {self.text_weight:g} words"


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses over time.

    Attributes:
        timestamps_s: (N,), strictly rising.
        T_world_camera: (N, 4, 4).
    """

    timestamps_s: FloatArray
    T_world_camera: FloatArray

    def __post_init__(self) -> None:
        n = len(self.timestamps_s)
        require_rows("trajectory stamps", self.timestamps_s, (n,))
        require_rows("trajectory poses", self.T_world_camera, (n, 4, 4))
        if (np.diff(self.timestamps_s) <= 0).any():
            row = int(np.flatnonzero(np.diff(self.timestamps_s) <= 0)[0]) + 1
            raise FrameError(f"trajectory: stamps do not rise at row {row} (t={self.timestamps_s[row]})")

    def __len__(self) -> int:
        return len(self.timestamps_s)
