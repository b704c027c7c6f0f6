"""Labelled clouds of users: instance and label a point, words beside them."""

import json

import numpy as np
import pytest

from seo_slam.datasets.labelled_cloud import read_labelled_cloud
from seo_slam.errors import DatasetError, EvaluationError
from seo_slam.evaluation.labelled_points import UNLABELLED

ROWS = ("0 0 1 4 7", "0 1 1 4 7", "2 0 1 5 3", "2 0 2 -1 -100")


def written(path, rows=ROWS, names=("instance", "label"), kind="int"):
    properties = "".join(f"property float {axis}\n" for axis in "xyz") + "".join(f"property {kind} {name}\n" for name in names)
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n{properties}end_header\n" + "\n".join(rows) + "\n")
    return path


def test_points_instances_and_words(tmp_path):
    path = written(tmp_path / "room.ply")
    (tmp_path / "room.json").write_text(json.dumps({"3": "table", "7": "chair", "9": "lamp"}))
    truth = read_labelled_cloud(path)
    np.testing.assert_array_equal(truth.p_world, [[0, 0, 1], [0, 1, 1], [2, 0, 1], [2, 0, 2]])
    assert truth.instance_ids.tolist() == [4, 4, 5, UNLABELLED]
    assert [truth.class_names[c] if c != UNLABELLED else None for c in truth.class_ids] == ["chair", "chair", "table", None]
    assert {i: truth.class_names[c] for i, c in truth.instances.items()} == {4: "chair", 5: "table"}


def test_a_list_of_words_and_two_numbers_of_one_word(tmp_path):
    path = written(tmp_path / "room.ply", rows=("0 0 0 1 0", "0 0 1 2 2", "0 0 2 3 1"))
    (tmp_path / "room.json").write_text(json.dumps(["chair", "table", " chair"]))
    truth = read_labelled_cloud(path)
    assert truth.class_names == ("chair", "table")
    assert truth.class_ids.tolist() == [0, 0, 1]


def test_without_words_classes_have_their_numbers(tmp_path):
    truth = read_labelled_cloud(written(tmp_path / "room.ply"))
    assert truth.class_names == ("class 3", "class 7")


@pytest.mark.parametrize("names", [("object_id", "class_id"), ("instance_id", "semantic")])
def test_other_names_of_the_properties(tmp_path, names):
    assert read_labelled_cloud(written(tmp_path / "room.ply", names=names)).instance_ids.tolist() == [4, 4, 5, UNLABELLED]


def test_whole_numbers_may_be_written_as_floats(tmp_path):
    assert read_labelled_cloud(written(tmp_path / "room.ply", kind="float")).class_ids.tolist() == [1, 1, 0, UNLABELLED]
    with pytest.raises(DatasetError, match=r"'label' of point 1 is 7.5, wanted a whole number"):
        read_labelled_cloud(written(tmp_path / "room.ply", rows=("0 0 0 1 7", "0 0 0 1 7.5"), kind="float"))
    with pytest.raises(DatasetError, match="wanted a whole number"):
        read_labelled_cloud(written(tmp_path / "room.ply", rows=("0 0 0 1 nan",), kind="float"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ('{"7": "chair"}', "label 3 has no word"),
        ('{"7": "chair", "3": 5}', "label 3 has 5"),
        ('{"7": "chair",', "room.json:1: not JSON"),
        ('"chair"', "got str"),
    ],
)
def test_words_that_do_not_fit(tmp_path, words, message):
    path = written(tmp_path / "room.ply")
    (tmp_path / "room.json").write_text(words)
    with pytest.raises(DatasetError, match=message):
        read_labelled_cloud(path)


def test_properties_that_are_missing(tmp_path):
    with pytest.raises(DatasetError, match=r"no 'label' \(nor class, class_id, semantic\); they have x, y, z, instance"):
        read_labelled_cloud(written(tmp_path / "room.ply", rows=("0 0 0 1",), names=("instance",)))
    with pytest.raises(DatasetError, match="no 'instance'"):
        read_labelled_cloud(written(tmp_path / "room.ply", rows=("0 0 0 1",), names=("label",)))
    path = written(tmp_path / "room.ply")
    path.write_text(path.read_text().replace("float z", "float depth"))
    with pytest.raises(DatasetError, match="no z"):
        read_labelled_cloud(path)
    with pytest.raises(EvaluationError, match="no points"):
        read_labelled_cloud(written(tmp_path / "room.ply", rows=()))
