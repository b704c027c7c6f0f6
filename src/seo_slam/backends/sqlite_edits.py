"""From edits of agents to rows of map.db, and back."""

import json
from collections.abc import Iterable, Mapping
from typing import Any, cast, get_args

import numpy as np

from seo_slam.backends.sqlite_rows import EmbeddingId, Row
from seo_slam.geometry import FloatArray
from seo_slam.records import EditOutcome, EditRecord
from seo_slam.types import Landmark, LandmarkState

EDIT_COLUMNS = (
    "kind, landmark_id, other_id, outcome, detail, agent, model, prompt_hash, view_keyframe_id, view_s, judged_keyframe_id, "
    "timestamp_s, landmarks_before"
)


def edit_values(edit: EditRecord, embedding_id: EmbeddingId) -> Row:
    """The values of ``EDIT_COLUMNS``."""
    before = [_landmark_json(landmark, embedding_id) for landmark in edit.before]
    return (
        edit.kind,
        int(edit.landmark_id),
        None if edit.other_id is None else int(edit.other_id),
        edit.outcome,
        edit.detail,
        edit.agent,
        edit.model,
        edit.prompt_hash,
        int(edit.view_keyframe_id),
        float(edit.view_s),
        int(edit.keyframe_id),
        float(edit.timestamp_s),
        json.dumps(before, ensure_ascii=False, allow_nan=False),
    )


def embedding_ids(rows: Iterable[Row]) -> set[int]:
    """The embeddings that rows of ``EDIT_COLUMNS`` name."""
    found = {item["embedding_id"] for row in rows for item in json.loads(row[-1])}
    return {int(number) for number in found if number is not None}


def edit_from(row: Row, vectors: Mapping[int, FloatArray]) -> EditRecord:
    """The edit of a row with ``EDIT_COLUMNS``.

    Raises:
        ValueError: an outcome that no edit has, or landmarks that no commit wrote; the caller names the file.
    """
    kind, landmark_id, other_id, outcome, detail, *source, before = row
    if outcome not in get_args(EditOutcome):
        raise ValueError(f"edit of landmark {landmark_id}: got outcome {outcome!r}, wanted one of {', '.join(get_args(EditOutcome))}")
    agent, model, prompt_hash, view_keyframe_id, view_s, keyframe_id, timestamp_s = source
    return EditRecord(
        kind=kind,
        landmark_id=landmark_id,
        other_id=other_id,
        outcome=cast(EditOutcome, outcome),
        detail=detail,
        agent=agent,
        model=model,
        prompt_hash=prompt_hash,
        view_keyframe_id=view_keyframe_id,
        view_s=view_s,
        keyframe_id=keyframe_id,
        timestamp_s=timestamp_s,
        before=tuple(_landmark(item, vectors) for item in json.loads(before)),
    )


def _landmark_json(landmark: Landmark, embedding_id: EmbeddingId) -> dict[str, Any]:
    """All fields in full precision: an undo puts the landmark back as it was, not as map.json rounds it."""
    return {
        "id": int(landmark.id),
        "label": landmark.label,
        "category": landmark.category,
        "labels": {word: float(weight) for word, weight in landmark.labels.items()},
        "position_m": np.asarray(landmark.position_m, dtype=np.float64).tolist(),
        "covariance_m2": np.asarray(landmark.covariance_m2, dtype=np.float64).tolist(),
        "size_m": np.asarray(landmark.size_m, dtype=np.float64).tolist(),
        "observations": int(landmark.observations),
        "first_seen_s": float(landmark.first_seen_s),
        "last_seen_s": float(landmark.last_seen_s),
        "state": landmark.state,
        "version": int(landmark.version),
        "existence": float(landmark.existence),
        "embedding_id": embedding_id(landmark.embedding),
    }


def _landmark(item: dict[str, Any], vectors: Mapping[int, FloatArray]) -> Landmark:
    number, state = item["embedding_id"], item["state"]
    if state not in get_args(LandmarkState):
        raise ValueError(f"landmark {item['id']} before an edit: got state {state!r}, wanted one of {', '.join(get_args(LandmarkState))}")
    return Landmark(
        id=int(item["id"]),
        label=str(item["label"]),
        labels={str(word): float(weight) for word, weight in item["labels"].items()},
        position_m=np.array(item["position_m"], dtype=np.float64).reshape(3),
        covariance_m2=np.array(item["covariance_m2"], dtype=np.float64).reshape(3, 3),
        size_m=np.array(item["size_m"], dtype=np.float64).reshape(3),
        embedding=np.zeros(0) if number is None else vectors[number],
        observations=int(item["observations"]),
        first_seen_s=float(item["first_seen_s"]),
        last_seen_s=float(item["last_seen_s"]),
        state=cast(LandmarkState, state),
        version=int(item["version"]),
        existence=float(item["existence"]),
        category=str(item["category"]),
    )
