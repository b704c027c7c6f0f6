"""From landmarks, measurements and keyframes to rows of map.db, and back."""

import json
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from seo_slam.geometry import FloatArray
from seo_slam.records import KeyframeRecord, MapEvent
from seo_slam.types import Landmark, LandmarkState, Observations

EmbeddingId = Callable[[FloatArray], int | None]
Row = tuple[Any, ...]

LANDMARK_COLUMNS = (
    "state, label, labels, x_m, y_m, z_m, covariance_m2, size_m, embedding_id, observations, first_seen_s, last_seen_s, version, "
    "existence, category"
)
OBSERVATION_COLUMNS = (
    "keyframe_id, row, landmark_id, p_camera, cov_camera, size_m, label, score, box_px, truncated, detection_row, embedding_id"
)


def blob(array: ArrayLike) -> bytes:
    """Pack as little-endian float64."""
    return np.ascontiguousarray(array, dtype="<f8").tobytes()


def unblob(data: bytes, shape: tuple[int, ...]) -> FloatArray:
    """Unpack ``blob``.

    Raises:
        ValueError: wrong size; the caller names the file.
    """
    return np.frombuffer(data, dtype="<f8").reshape(shape).astype(np.float64)


def vector_blob(embedding: FloatArray) -> bytes:
    """Pack an embedding as little-endian float32."""
    return np.ascontiguousarray(embedding, dtype="<f4").tobytes()


def vector(data: bytes) -> FloatArray:
    """Unpack ``vector_blob`` to float64."""
    return np.frombuffer(data, dtype="<f4").astype(np.float64)


def landmark_values(landmark: Landmark, embedding_id: EmbeddingId) -> Row:
    """The values of ``LANDMARK_COLUMNS``."""
    x, y, z = landmark.position_m.tolist()
    return (
        landmark.state,
        landmark.label,
        json.dumps(dict(landmark.labels), ensure_ascii=False),
        x,
        y,
        z,
        blob(landmark.covariance_m2),
        blob(landmark.size_m),
        embedding_id(landmark.embedding),
        int(landmark.observations),
        float(landmark.first_seen_s),
        float(landmark.last_seen_s),
        int(landmark.version),
        float(landmark.existence),
        landmark.category,
    )


def readable_landmark_columns(user_version: int) -> str:
    """``LANDMARK_COLUMNS`` as a file of a version can give them: version 1 knew no existence, version 2 no category."""
    columns = LANDMARK_COLUMNS
    if user_version < 3:
        columns = columns.replace(", category", ", ''")
    return columns if user_version > 1 else columns.replace(", existence", ", 1.0")


def landmark_from(row: Row, vectors: Mapping[int, FloatArray]) -> Landmark:
    """The landmark of a row ``id, LANDMARK_COLUMNS``."""
    landmark_id, state, label, labels, x, y, z, covariance, size, embedding_id, observations, *others = row
    first_s, last_s, version, existence, category = others
    if state not in get_args(LandmarkState):
        raise ValueError(f"landmark {landmark_id}: got state {state!r}, wanted one of {', '.join(get_args(LandmarkState))}")
    return Landmark(
        id=landmark_id,
        label=label,
        labels={str(word): float(weight) for word, weight in json.loads(labels).items()},
        position_m=np.array([x, y, z], dtype=np.float64),
        covariance_m2=unblob(covariance, (3, 3)),
        size_m=unblob(size, (3,)),
        embedding=np.zeros(0) if embedding_id is None else vectors[embedding_id],
        observations=observations,
        first_seen_s=first_s,
        last_seen_s=last_s,
        state=cast(LandmarkState, state),
        version=version,
        existence=float(existence),
        category=category,
    )


def observation_rows(record: KeyframeRecord, embedding_id: EmbeddingId) -> list[Row]:
    """The values of ``OBSERVATION_COLUMNS``, one row a measurement."""
    o = record.observations
    bits = o.truncated.astype(np.int64) @ np.array([1, 2, 4, 8])
    return [
        (
            record.keyframe_id,
            k,
            int(record.landmark_ids[k]),
            blob(o.p_camera[k]),
            blob(o.cov_camera[k]),
            blob(o.size_m[k]),
            o.labels[k],
            float(o.scores[k]),
            blob(o.boxes_px[k]),
            int(bits[k]),
            int(o.rows[k]),
            embedding_id(o.embeddings[k]),
        )
        for k in range(len(o))
    ]


def observations_from(rows: Sequence[Row], vectors: Mapping[int, FloatArray], embedding_size: int) -> Observations:
    """The measurements of rows with ``OBSERVATION_COLUMNS``; their clouds are empty."""
    n = len(rows)
    bits = np.array([row[9] for row in rows], dtype=np.int64)
    embeddings = [vectors[row[11]] if row[11] is not None else np.zeros(embedding_size) for row in rows]
    return Observations(
        p_camera=np.array([unblob(row[3], (3,)) for row in rows]).reshape(n, 3),
        cov_camera=np.array([unblob(row[4], (3, 3)) for row in rows]).reshape(n, 3, 3),
        size_m=np.array([unblob(row[5], (2,)) for row in rows]).reshape(n, 2),
        labels=tuple(row[6] for row in rows),
        scores=np.array([row[7] for row in rows], dtype=np.float64),
        embeddings=np.array(embeddings, dtype=np.float64).reshape(n, embedding_size),
        boxes_px=np.array([unblob(row[8], (4,)) for row in rows]).reshape(n, 4),
        truncated=(bits[:, None] & np.array([1, 2, 4, 8])) > 0,
        clouds=tuple(np.zeros((0, 3)) for _ in rows),
        rows=np.array([row[10] for row in rows], dtype=np.int64),
    )


def keyframe_values(record: KeyframeRecord, session: int) -> Row:
    """The values of the keyframe table."""
    return (
        record.keyframe_id,
        session,
        float(record.timestamp_s),
        blob(record.T_world_camera),
        blob(record.covariance),
        blob(record.T_previous_current),
        blob(record.motion_covariance),
        len(record.observations),
        int(record.observations.embeddings.shape[1]),
    )


EVENT_COLUMNS = "kind, landmark_id, detail, source, other_id"


def event_values(event: MapEvent) -> Row:
    """The values of ``EVENT_COLUMNS``."""
    return (event.kind, int(event.landmark_id), event.detail, event.source, None if event.other_id is None else int(event.other_id))


def with_keyframe(user_version: int) -> str:
    """Which rows of a file of a version belong to a keyframe itself, and not to what was amended after it."""
    return "keyframe_id = ? AND amendment = 0" if user_version > 2 else "keyframe_id = ?"


def read_vectors(connection: sqlite3.Connection, where: str, parameters: Row = ()) -> dict[int, FloatArray]:
    """Embeddings by number, of those that ``where`` (the end of a query) chooses."""
    return {number: vector(data) for number, data in connection.execute(f"SELECT id, vector FROM embedding {where}", parameters)}
