"""seo-slam eval segmentation: what it prints, what it gives a program, and what it says of bad arguments."""

import json
from dataclasses import replace

import numpy as np
import pytest

from seo_slam.datasets.labelled_cloud import read_labelled_cloud
from seo_slam.evaluation.labelled_points import LabelledCloud
from seo_slam.map import Map
from seo_slam.map_clouds import CLOUDS_FILE, write_clouds
from seo_slam.simulation.truth_cloud import write_labelled_cloud
from seo_slam.types import Landmark

NAMES = ("chair", "table", "wall")
PLACES_M = {"chair": 0.0, "table": 5.0, "wall": 10.0}


def cloud_of(name):
    """(20, 3) points on a line."""
    return np.column_stack([PLACES_M[name] + 0.1 * np.arange(20), np.zeros(20), np.ones(20)])


def landmark(number, label, state="stable"):
    return Landmark(
        id=number,
        label=label,
        labels={label: 1.0},
        position_m=np.zeros(3),
        covariance_m2=np.eye(3) * 1e-4,
        size_m=np.full(3, 0.1),
        embedding=np.zeros(0),
        observations=9,
        first_seen_s=0.0,
        last_seen_s=1.0,
        state=state,
    )


@pytest.fixture
def scene(tmp_path):
    """A chair and a table before a wall; the map has the chair, and calls the table a chair, too."""
    class_ids = np.repeat(np.arange(3), 20)
    truth = LabelledCloud(np.concatenate([cloud_of(name) for name in NAMES]), 7 + class_ids, class_ids, NAMES)
    write_labelled_cloud(tmp_path / "truth.ply", truth)
    Map([landmark(0, "chair"), landmark(1, "chair"), landmark(5, "wall", "tentative")], embedder="hashed").save(tmp_path / "map")
    write_clouds(tmp_path / "map" / CLOUDS_FILE, {0: cloud_of("chair"), 1: cloud_of("table")})
    return tmp_path


def test_scores_of_a_worked_example(run, scene):
    status, out, err = run("eval", "segmentation", scene / "map", "--truth", scene / "truth.ply", "--protocol", "all", "--json")
    assert (status, err) == (0, "")
    content = json.loads(out)
    assert list(content["results"]) == ["segmentation/dualmap", "segmentation/hovsg", "segmentation/conceptgraphs"]
    for result in content["results"].values():
        assert (result["miou"], result["fmiou"], result["macc"]) == (0.25, 0.25, 0.5)  # chair 20 / 40, table 0
        assert (result["predicted"], result["objects"], result["odr"], result["rightly_called"]) == (2, 2, 1.0, 1)
        assert (result["embedder"], result["dropped_classes"]) == ("hashed", ["wall"])
    assert content["objects"][1] == {"landmark": 1, "label": "chair", "points": 20, "called": ["chair"] * 3}
    assert {"map", "truth", "versions", "features"} <= content.keys()


def test_the_text_says_the_same(run, scene):
    status, out, _ = run("eval", "segmentation", scene / "map", "--truth", scene / "truth.ply")
    assert status == 0
    assert "protocol segmentation/dualmap: 5 nearest, mean over union classes, dropped wall; embedder hashed" in out
    assert "mIoU 0.2500  FmIoU 0.2500  mAcc 0.5000  ODR 1.000" in out
    assert "2 things found, 0 duplicates" in out
    assert "hovsg" not in out


def test_truth_of_a_recording_knows_what_was_in_view(run, scene):
    folder = scene / "recording"
    folder.mkdir()
    write_labelled_cloud(folder / "truth_cloud.ply", read_labelled_cloud(scene / "truth.ply"))
    objects = [
        {"id": 7, "label": "chair", "center": [0, 0, 1], "visible_keyframes": 12},
        {"id": 8, "label": "table", "center": [5, 0, 1], "visible_keyframes": 4},
    ]
    (folder / "truth.json").write_text(json.dumps({"objects": objects}))
    status, out, _ = run("eval", "segmentation", scene / "map", "--truth", folder, "--json")
    assert status == 0
    result = json.loads(out)["results"]["segmentation/dualmap"]
    assert (result["visible"], result["objects"], result["odr"], result["odr_objects"]) == (1, 2, 2.0, 1.0)


def test_labelled_points_come_back_as_they_were_written(scene):
    cloud = read_labelled_cloud(scene / "truth.ply")
    assert cloud.class_names == NAMES
    assert cloud.instances == {7: 0, 8: 1, 9: 2}
    assert np.abs(cloud.p_world[20:40] - cloud_of("table")).max() < 1e-6


def test_bad_arguments_are_told_in_one_line(run, scene):
    truth = scene / "truth.ply"
    assert run("eval", "segmentation", scene / "map", "--truth", truth, "--protocol", "sun")[::2] == (
        2,
        "error: protocol: got 'sun', wanted conceptgraphs, dualmap, hovsg or all\n",
    )
    status, _, err = run("eval", "segmentation", scene / "map", "--truth", scene)
    assert (status, "holds no truth_cloud.ply; `seo-slam simulate NAME --truth-cloud` writes one" in err) == (2, True)
    (scene / "map" / CLOUDS_FILE).unlink()
    status, _, err = run("eval", "segmentation", scene / "map", "--truth", truth)
    assert (status, "no landmark has a cloud; wanted a map made with clouds" in err) == (2, True)
    write_clouds(scene / "map" / CLOUDS_FILE, {0: cloud_of("chair")})
    status, _, err = run("eval", "segmentation", scene / "map", "--truth", truth)
    assert (status, "1 of 2 landmarks, not 1, has a cloud" in err) == (2, True)


def test_a_map_without_an_embedder_needs_one_to_be_named(run, scene):
    loaded = Map.load(scene / "map")
    Map([replace(row) for row in loaded.landmarks]).save(scene / "map")
    status, _, err = run("eval", "segmentation", scene / "map", "--truth", scene / "truth.ply")
    assert (status, "give --embedder NAME" in err) == (2, True)
    assert run("eval", "segmentation", scene / "map", "--truth", scene / "truth.ply", "--embedder", "hashed")[0] == 0


def test_simulate_writes_true_points_if_asked(run, tmp_path):
    folder = tmp_path / "desk"
    words = ["simulate", "desk", "--out", folder, "--frames", "3", "--size", "64x48", "--truth-cloud"]
    assert run(*words)[0] == 0
    cloud = read_labelled_cloud(folder / "truth_cloud.ply")
    assert "floor" in cloud.class_names
    assert len(cloud.instances) > 5
