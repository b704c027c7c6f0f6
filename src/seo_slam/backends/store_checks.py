"""What every store checks before it takes a keyframe or an amendment, so that a bad one is refused whole."""

from dataclasses import replace
from typing import get_args

import numpy as np

from seo_slam.errors import MapError
from seo_slam.records import Amendment, EditOutcome, EditRecord, KeyframeRecord
from seo_slam.types import Landmark, Observations

LARGEST_NUMBER = 2**63 - 1


def require_next(record: KeyframeRecord, last_id: int | None) -> None:
    """Check that a record may follow keyframe ``last_id`` and holds no value that could not be read back.

    Raises:
        MapError: the id does not rise, there is not one landmark id an observation, a landmark has NaN or a wrong shape, or is
            given twice.
    """
    if record.keyframe_id < 0 or (last_id is not None and record.keyframe_id <= last_id):
        raise MapError(f"commit: got keyframe {record.keyframe_id}, wanted an id above {-1 if last_id is None else last_id}")
    where = f"commit of keyframe {record.keyframe_id}"
    if record.landmark_ids.shape != (len(record.observations),):
        raise MapError(f"{where}: got {record.landmark_ids.shape} landmark ids for {len(record.observations)} observations")
    for name, array, shape in (
        ("T_world_camera", record.T_world_camera, (4, 4)),
        ("covariance", record.covariance, (6, 6)),
        ("T_previous_current", record.T_previous_current, (4, 4)),
        ("motion_covariance", record.motion_covariance, (6, 6)),
    ):
        if array.shape != shape or not np.isfinite(array).all():
            raise MapError(f"{where}: {name} has shape {array.shape} or is not finite, wanted finite {shape}")
    if not np.isfinite(record.timestamp_s):
        raise MapError(f"{where}: timestamp_s is {record.timestamp_s}")
    _require_change(record, where)


def require_amendment(amendment: Amendment, last_id: int | None) -> None:
    """Check that an amendment is one of the newest keyframe, ``last_id``, and holds no value that could not be read back.

    Raises:
        MapError: another keyframe, or as for ``require_next``.
    """
    if last_id is None or amendment.keyframe_id != last_id:
        raise MapError(
            f"amend: got keyframe {amendment.keyframe_id}, wanted the newest, {'but there is none' if last_id is None else last_id}"
        )
    _require_change(amendment, f"amendment of keyframe {last_id}")


def _require_change(change: KeyframeRecord | Amendment, where: str) -> None:
    ids = [landmark.id for landmark in change.landmarks]
    if len(set(ids)) != len(ids) or len(set(change.removed_ids)) != len(change.removed_ids) or set(ids) & set(change.removed_ids):
        raise MapError(f"{where}: a landmark is given twice, or both changed and removed: {ids}, removed {change.removed_ids}")
    for landmark in change.landmarks:
        _require_landmark(landmark, where)
    for edit in change.edits:
        _require_edit(edit, where)


def _require_edit(edit: EditRecord, where: str) -> None:
    named = f"{where}: {edit.kind} of landmark {edit.landmark_id}"
    if not np.isfinite([edit.timestamp_s, edit.view_s]).all():
        raise MapError(f"{named}: stamps are {edit.timestamp_s} and {edit.view_s}, wanted finite seconds")
    if edit.outcome not in get_args(EditOutcome):
        raise MapError(f"{named}: got outcome {edit.outcome!r}, wanted one of {', '.join(get_args(EditOutcome))}")
    numbers = (edit.landmark_id, edit.other_id or 0, edit.view_keyframe_id, edit.keyframe_id)
    if any(abs(number) > LARGEST_NUMBER for number in numbers):
        raise MapError(f"{named}: a number of {numbers} has more than 64 bits")
    for landmark in edit.before:
        _require_landmark(landmark, named)


def _require_landmark(landmark: Landmark, where: str) -> None:
    for name, array, shape in (
        ("position_m", landmark.position_m, (3,)),
        ("covariance_m2", landmark.covariance_m2, (3, 3)),
        ("size_m", landmark.size_m, (3,)),
        ("embedding", landmark.embedding, (landmark.embedding.size,)),
    ):
        if array.shape != shape or not np.isfinite(array).all():
            raise MapError(f"{where}: landmark {landmark.id}: {name} has shape {array.shape} or is not finite, wanted {shape}")
    if not np.isfinite([landmark.first_seen_s, landmark.last_seen_s, *landmark.labels.values()]).all():
        raise MapError(f"{where}: landmark {landmark.id}: a stamp or a label's weight is not finite")
    if not 0 <= landmark.existence <= 1:
        raise MapError(f"{where}: landmark {landmark.id}: existence is {landmark.existence}, wanted 0..1")


def without_clouds(observations: Observations) -> Observations:
    """Return observations whose clouds are empty: a store keeps what the factor graph needs, and clouds would fill memory."""
    return replace(observations, clouds=(np.zeros((0, 3)),) * len(observations))
