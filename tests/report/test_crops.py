import cv2
import numpy as np
import pytest
from made_up_desk import CAMERA, painted_frame, step

from seo_slam.records import MapEvent, StepResult
from seo_slam.report.crop import crop_value
from seo_slam.report.crops import ReportRecorder
from seo_slam.report.life_history import life_line
from seo_slam.types import REJECTED

SMALL, LARGE, WHOLE = [10, 10, 30, 30], [100, 80, 200, 160], [0, 0, 320, 240]


def watch(recorder, timestamp_s, ids=(), boxes=(), frame=None, **more):
    frame = frame or painted_frame(timestamp_s, boxes)
    recorder.observe(frame, step(frame, ids, boxes, **more))


def decode(crop):
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(crop.jpeg, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def test_a_crop_shows_the_object_in_its_colours_inside_the_stated_box():
    recorder = ReportRecorder()
    frame = painted_frame(1.0, [LARGE])
    frame.rgb[80:160, 100:200] = (250, 20, 60)
    watch(recorder, 1.0, [7], [LARGE], frame=frame)
    crop = recorder.crop(7)
    picture = decode(crop)
    assert (crop.height_px, crop.width_px) == picture.shape[:2]
    left, top, right, bottom = (np.array(crop.box_share) * ([crop.width_px, crop.height_px] * 2)).astype(int)
    inside = picture[top + 3 : bottom - 3, left + 3 : right - 3]
    above = picture[: top - 2]
    assert np.abs(np.median(inside, axis=(0, 1)) - [250, 20, 60]).max() < 12
    assert np.abs(np.median(above, axis=(0, 1)) - [250, 20, 60]).max() > 60


def test_pictures_are_at_most_160_pixels_long():
    recorder = ReportRecorder()
    watch(recorder, 1.0, [1, 2], [WHOLE, SMALL])
    assert max(recorder.crop(1).width_px, recorder.crop(1).height_px) == 160
    assert recorder.crop(2).width_px < 60  # small ones are not blown up


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        ({"scores": [0.9]}, {"scores": [0.3]}),
        ({"truncated": [0]}, {"truncated": [2]}),
        ({"boxes": [LARGE]}, {"boxes": [SMALL]}),
    ],
)
@pytest.mark.parametrize("better_first", [True, False])
def test_the_best_view_stays_whichever_came_first(better, worse, better_first):
    recorder = ReportRecorder()
    views = [(10.0, better), (20.0, worse)] if better_first else [(10.0, worse), (20.0, better)]
    for timestamp_s, view in views:
        watch(recorder, timestamp_s, [1], **{"boxes": [LARGE], **view})
    assert recorder.crop(1).timestamp_s == (10.0 if better_first else 20.0)


def test_a_view_that_is_hardly_better_is_not_worth_the_time():
    recorder = ReportRecorder(margin=1.2)
    watch(recorder, 1.0, [1], [LARGE], scores=[0.50])
    watch(recorder, 2.0, [1], [LARGE], scores=[0.55])
    assert recorder.crop(1).timestamp_s == 1.0


def test_value_falls_with_every_cut_side_and_never_reaches_one():
    values = [crop_value(1.0, sides, 320 * 240, 320 * 240) for sides in range(5)]
    assert values == sorted(values, reverse=True)
    assert 0 < values[-1] < values[0] < 1


def test_rejected_observations_leave_no_trace():
    recorder = ReportRecorder()
    watch(recorder, 1.0, [REJECTED, 4], [LARGE, SMALL])
    assert recorder.crop(REJECTED) is None
    assert recorder.label_history(REJECTED) == ()
    assert recorder.crop(4) is not None


def test_frames_between_keyframes_are_passed_over():
    recorder = ReportRecorder()
    frame = painted_frame(1.0, [])
    recorder.observe(frame, StepResult(0, 1.0, np.eye(4), "ok"))
    assert recorder.crop(0) is None


def test_labels_are_kept_as_runs_and_a_long_absence_starts_a_new_one():
    recorder = ReportRecorder()
    for timestamp_s, label in [(0.0, "cup"), (0.5, "cup"), (1.0, "mug"), (1.5, None), (9.0, None)]:
        watch(recorder, timestamp_s, [1], [LARGE], labels=[label])
    runs = [(r.first_s, r.last_s, r.label, r.count) for r in recorder.label_history(1)]
    assert runs == [(0.0, 0.5, "cup", 2), (1.0, 1.0, "mug", 1), (1.5, 1.5, None, 1), (9.0, 9.0, None, 1)]


def test_a_label_that_flickers_for_hours_stays_bounded_and_loses_no_sighting():
    recorder = ReportRecorder()
    frame = painted_frame(0.0, [SMALL])
    for k in range(3000):
        result = step(frame, [1], [SMALL], ["cup" if k % 2 else "mug"])
        recorder.observe(frame, result)
    runs = recorder.label_history(1)
    assert len(runs) <= 256
    assert sum(run.count for run in runs) == 3000


def test_a_merge_hands_over_history_and_the_better_picture():
    recorder = ReportRecorder()
    watch(recorder, 1.0, [1, 2], [SMALL, LARGE], labels=["cup", "mug"])
    watch(recorder, 2.0, [1], [SMALL], labels=["cup"], events=[MapEvent("merged", 2, other_id=1)])
    assert recorder.crop(1).timestamp_s == 1.0
    assert recorder.crop(1).width_px > 60
    assert sorted((run.label, run.count) for run in recorder.label_history(1)) == [("cup", 2), ("mug", 1)]
    assert recorder.crop(2) == recorder.crop(1)  # who asks by the old id gets the survivor


def test_observations_of_a_merged_id_and_chains_of_merges_reach_the_survivor():
    recorder = ReportRecorder()
    watch(recorder, 1.0, [1, 2, 3], [SMALL, SMALL, SMALL])
    watch(recorder, 2.0, events=[MapEvent("merged", 3, other_id=2), MapEvent("merged", 2, other_id=1)])
    watch(recorder, 3.0, [3], [LARGE])
    assert sum(run.count for run in recorder.label_history(1)) == 4
    assert recorder.crop(1).timestamp_s == 3.0


def test_a_removed_landmark_that_was_never_stable_gives_its_memory_back():
    recorder = ReportRecorder()
    watch(recorder, 1.0, [1], [LARGE], events=[MapEvent("created", 1)])
    assert recorder.crop_bytes > 0
    watch(recorder, 2.0, events=[MapEvent("removed", 1)])
    assert recorder.crop_bytes == 0
    assert (recorder.crop(1), recorder.gone, recorder.life(1)) == (None, (), ())


def kinds(recorder, landmark_id):
    return [(item.timestamp_s, item.event.kind) for item in recorder.life(landmark_id)]


def test_a_removed_thing_keeps_its_picture_and_its_life():
    recorder = ReportRecorder()
    watch(recorder, 1.0, [1, 2], [LARGE, SMALL], events=[MapEvent("created", 1), MapEvent("created", 2)])
    for stamp_s, kind in ((2.0, "stable"), (3.0, "confirmed"), (4.0, "lost"), (5.0, "found"), (6.0, "lost"), (7.0, "removed")):
        watch(recorder, stamp_s, events=[MapEvent(kind, 1, "cup")])
    assert recorder.gone == (1,)
    assert recorder.crop(1) is not None
    assert [run.count for run in recorder.label_history(1)] == [1]
    assert kinds(recorder, 1) == [(1.0, "created"), (2.0, "stable"), (4.0, "lost"), (5.0, "found"), (6.0, "lost"), (7.0, "removed")]
    watch(recorder, 8.0, events=[MapEvent("found", 1, "cup")])  # a removal that was undone
    assert recorder.gone == ()


def test_a_merge_joins_lives():
    recorder = ReportRecorder()
    watch(recorder, 1.0, [1, 2], [LARGE, SMALL], events=[MapEvent("created", 1), MapEvent("created", 2)])
    watch(recorder, 2.0, events=[MapEvent("stable", 2)])
    watch(recorder, 3.0, events=[MapEvent("merged", 2, other_id=1)])
    watch(recorder, 4.0, events=[MapEvent("removed", 1)])
    assert kinds(recorder, 1) == [(1.0, "created"), (1.0, "created"), (2.0, "stable"), (3.0, "merged"), (4.0, "removed")]
    assert recorder.gone == (1,)


def test_a_thing_that_moved_has_what_was_seen_of_it_at_its_new_place():
    recorder = ReportRecorder()
    watch(recorder, 1.0, [1], [SMALL], labels=["cup"], events=[MapEvent("created", 1)])
    watch(recorder, 2.0, events=[MapEvent("stable", 1)])
    watch(recorder, 3.0, [2], [LARGE], labels=["mug"], events=[MapEvent("created", 2)])
    watch(recorder, 4.0, events=[MapEvent("lost", 1)])
    watch(recorder, 5.0, events=[MapEvent("removed", 1)])
    assert recorder.gone == (1,)
    watch(recorder, 6.0, [2], [SMALL], labels=["mug"], events=[MapEvent("stable", 2), MapEvent("moved", 1, "cup: from a to b", other_id=2)])
    watch(recorder, 7.0, [1], [SMALL], labels=["cup"])
    assert recorder.gone == ()
    assert recorder.crop(1).timestamp_s == 3.0
    assert recorder.crop(2) == recorder.crop(1)
    assert [(run.label, run.count) for run in recorder.label_history(1)] == [("cup", 1), ("mug", 1), ("mug", 1), ("cup", 1)]
    assert kinds(recorder, 1) == [
        *[(1.0, "created"), (2.0, "stable"), (3.0, "created"), (4.0, "lost"), (5.0, "removed"), (6.0, "stable"), (6.0, "moved")],
    ]
    assert '<span class="moved" title="cup: from a to b, #2 until then">moved 6.0 s</span>' in life_line(recorder.life(1), 0.0)


def test_lives_are_bounded_and_pictures_of_what_is_gone_go_first():
    recorder = ReportRecorder(crop_budget_bytes=20_000)
    watch(recorder, 0.0, [0, 1], [LARGE, LARGE], events=[MapEvent("stable", 0)])
    for k in range(200):
        watch(recorder, 1.0 + k, [0], [LARGE], events=[MapEvent("lost" if k % 2 else "found", 0)])
    assert len(recorder.life(0)) == 64
    assert recorder.life(0)[-1].timestamp_s == 200.0
    watch(recorder, 300.0, events=[MapEvent("removed", 0)])
    k = 1
    while recorder.crop(0) is not None:  # it goes, though it was seen 200 times and the others once
        k += 1
        watch(recorder, 300.0 + k, [k], [LARGE])
        assert k < 100
    assert recorder.crop(k) is not None


def test_pictures_stay_within_the_budget_and_the_least_seen_go_first():
    recorder = ReportRecorder(crop_budget_bytes=20_000)
    for k in range(5):
        watch(recorder, k * 1.0, [0], [LARGE])
    for k in range(1, 80):
        watch(recorder, 10.0 + k, [k], [LARGE])
        held = [recorder.crop(i) for i in range(k + 1)]
        assert recorder.crop_bytes == sum(len(c.jpeg) for c in held if c) <= 20_000
    assert recorder.crop(0) is not None


def test_events_are_counted_all_and_kept_lately():
    recorder = ReportRecorder(max_events=3)
    for k in range(5):
        watch(recorder, float(k), events=[MapEvent("created", k)])
    assert recorder.event_counts == {"created": 5}
    assert [e.event.landmark_id for e in recorder.events] == [2, 3, 4]


def test_a_box_at_the_border_is_cut_inside_the_image():
    recorder = ReportRecorder()
    watch(recorder, 1.0, [1], [[CAMERA.width - 12.5, CAMERA.height - 9.5, CAMERA.width, CAMERA.height]], truncated=[2])
    picture = decode(recorder.crop(1))
    assert picture.shape[0] < 30
    assert picture.shape[1] < 30
