"""Truth files of several hands, and what is said of bad ones."""

import json

import numpy as np
import pytest

from seo_slam.errors import DatasetError
from seo_slam.evaluation.truth import read_synonyms, read_truth, truth_from

GOOD = {"id": "c", "label": "cup", "center": [0, 0, 1]}


def write(folder, content):
    path = folder / "truth.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_the_real_desk(shared):
    truth = read_truth(shared / "data/tum_fr1_xyz/objects_gt.json")
    assert len(truth.objects) == 13
    monitor = {item.id: item for item in truth.objects}["monitor"]
    # "center" is that of the visible surface; the middle of the box is the other centre.
    np.testing.assert_allclose(monitor.centers_m, [[0.4967, 0.8148, 1.1019], [0.499, 0.839, 1.0805]])
    assert monitor.half_extent_m == pytest.approx(0.015)
    assert monitor.labels == ("monitor",)


def test_all_keys_and_unknown_ones(tmp_path):
    item = {
        "id": 7,
        "label": "mug",
        "accepted_labels": ["cup", "mug"],
        "center": [0, 0, 1],
        "surface_center": [0, 0.1, 1],
        "aabb_min": [-0.2, -0.3, 0],
        "aabb_max": [0.2, 0.3, 2],
        "visible_keyframes": 12,
        "colour": "red",
    }
    timeline = [
        {"timestamp_s": 3.0, "event": "removed", "id": "vase", "center": [4, 0, 0], "label": "vase"},
        {"timestamp_s": 4.0, "event": "moved", "id": 7, "center": [0, 0, 1], "previous_center": [5, 0, 1]},
        {"timestamp_s": 5.0, "event": "added", "id": "x"},
    ]
    truth = read_truth(write(tmp_path, {"objects": [item], "timeline": timeline, "made_by": "hand"}))
    (found,) = truth.objects
    assert (found.id, found.labels, found.half_extent_m, found.visible_keyframes) == ("7", ("mug", "cup"), 0.2, 12)
    np.testing.assert_allclose(found.centers_m, [[0, 0, 1], [0, 0.1, 1], [0, 0, 1]])
    assert [(place.id, place.labels, place.center_m.tolist()) for place in truth.places] == [
        ("vase", ("vase",), [4, 0, 0]),
        ("7", ("mug", "cup"), [5, 0, 1]),
        ("7", ("mug", "cup"), [0, 0, 1]),
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"objects": [', r"truth\.json: not JSON: .*line 1"),
        ([], r"wanted a JSON object with the key 'objects', got a list"),
        ({"things": []}, r"got the keys \['things'\]"),
        ({"objects": []}, "'objects' is empty"),
        ({"objects": [GOOD, {**GOOD, "id": "d", "center": [0, 1]}]}, r"objects\[1\] \('d'\) center"),
        ({"objects": [{**GOOD, "center": [0, 0, "far"]}]}, r"objects\[0\] \('c'\) center.2: .*'far'"),
        ('{"objects": [{"id": "c", "label": "cup", "center": [0, 0, NaN]}]}', r"objects\[0\] \('c'\) center.2: .*finite"),
        ({"objects": [{"id": "c", "center": [0, 0, 0]}]}, r"objects\[0\] \('c'\): has neither 'label' nor 'accepted_labels'"),
        ({"objects": [{"id": "c", "label": "cup"}]}, r"objects\[0\] \('c'\): has no place"),
        ({"objects": [{"label": "cup", "center": [0, 0, 0]}]}, r"objects\[0\] id: Field required"),
        ({"objects": [{**GOOD, "aabb_min": [0, 0, 0]}]}, "only one of 'aabb_min' and 'aabb_max'"),
        ({"objects": [{**GOOD, "aabb_min": [0, 0, 2], "aabb_max": [1, 1, 1]}]}, "is not below 'aabb_max'"),
        ({"objects": [GOOD, GOOD]}, "two objects have the id 'c'"),
        ({"objects": [GOOD], "timeline": [{"event": "moved", "id": "c"}]}, r"timeline\[0\] \('c'\) timestamp_s: Field required"),
    ],
)
def test_bad_truth_names_file_object_and_key(tmp_path, content, message):
    path = write(tmp_path, content)
    with pytest.raises(DatasetError, match=message) as caught:
        read_truth(path)
    assert str(path) in str(caught.value)


def test_missing_truth(tmp_path):
    with pytest.raises(DatasetError, match="no such file"):
        read_truth(tmp_path / "none.json")


def test_synonyms(tmp_path):
    assert read_synonyms(write(tmp_path, [["tv", "monitor"], ["cup", "mug"]])) == [["tv", "monitor"], ["cup", "mug"]]
    for bad, message in (({"tv": "monitor"}, "list of lists of words"), ([["tv", "monitor"], ["cup"]], r"group 1 is \[\"cup\"\]")):
        with pytest.raises(DatasetError, match=message):
            read_synonyms(write(tmp_path, bad))


def test_a_truth_in_memory_is_the_same_as_its_file(tmp_path):
    content = {"objects": [GOOD], "timeline": [{"timestamp_s": 1.0, "event": "removed", "id": "v", "center": [1, 0, 0], "label": "vase"}]}
    here, filed = truth_from(content), read_truth(write(tmp_path, content))
    assert [(item.id, item.labels) for item in here.objects] == [(item.id, item.labels) for item in filed.objects] == [("c", ("cup",))]
    assert [place.labels for place in here.places] == [("vase",)]
    with pytest.raises(DatasetError, match=r"^my room: objects\[0\] \('c'\) center"):
        truth_from({"objects": [{**GOOD, "center": [0, 0]}]}, "my room")
    with pytest.raises(DatasetError, match=r"^truth: .*got a list"):
        truth_from([])


def test_boxes_of_objects_and_of_what_is_gone():
    item = {**GOOD, "aabb_min": [-0.2, -0.3, 0], "aabb_max": [0.2, 0.3, 2]}
    gone = {"timestamp_s": 1.0, "event": "removed", "id": "v", "center": [3, 0, 0], "aabb_min": [2.8, -0.5, 0], "aabb_max": [3.2, 0.5, 1]}
    left = {"timestamp_s": 2.0, "event": "moved", "id": "c", "center": [0, 0, 1], "previous_center": [5, 0, 1]}
    truth = truth_from({"objects": [item], "timeline": [gone, left]})
    np.testing.assert_allclose(truth.objects[0].box_m, [[-0.2, -0.3, 0], [0.2, 0.3, 2]])
    assert [place.half_extent_m for place in truth.places] == pytest.approx([0.2, 0.2, 0.2])
    np.testing.assert_allclose([place.size_m for place in truth.places], [[0.4, 1, 1], [0.4, 0.6, 2], [0.4, 0.6, 2]])
    assert truth_from({"objects": [GOOD]}).objects[0].box_m is None
