"""seo-slam eval: what it prints, what it gives a program, and what it says of bad arguments."""

import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from typer.testing import CliRunner

from seo_slam.cli.app import app
from seo_slam.datasets.trajectory_files import read_trajectory, write_trajectory
from seo_slam.errors import ConfigError, DatasetError, EvaluationError, MapFormatError
from seo_slam.geometry import exp, inverse
from seo_slam.map import Map
from seo_slam.records import Trajectory
from seo_slam.types import Landmark

T_TRUTH_MAP = exp([0.0, 0.0, 1.0, 3.0, -2.0, 0.5])


def run(*arguments):
    return CliRunner().invoke(app, ["eval", *map(str, arguments)], catch_exceptions=False)


def landmark(number, label, position, state="stable"):
    return Landmark(
        id=number,
        label=label,
        labels={label: 1.0},
        position_m=np.array(position, dtype=float),
        covariance_m2=np.eye(3) * 1e-4,
        size_m=np.array([0.1, 0.1, 0.1]),
        embedding=np.zeros(0),
        observations=5,
        first_seen_s=0.0,
        last_seen_s=1.0,
        state=state,
    )


@pytest.fixture
def scene(tmp_path):
    """A truth of three objects, a map of them in its own world, and two trajectories that align the two worlds."""
    centers = {"cup-1": [0.0, 0.0, 1.0], "book-1": [1.0, 0.0, 1.0], "tv-1": [0.0, 1.0, 1.0]}
    objects = [{"id": name, "label": name[:-2], "center": center} for name, center in centers.items()]
    (tmp_path / "truth.json").write_text(json.dumps({"objects": objects}))
    (tmp_path / "words.json").write_text('[["cup", "mug"]]')
    there = [("mug", (0.0, 0.05, 1.0)), ("book", (1.0, 0.0, 1.0)), ("tv\x1b[2J", (0.5, 0.5, 1.0))]
    rows = [landmark(i, label, (inverse(T_TRUTH_MAP) @ [*point, 1.0])[:3]) for i, (label, point) in enumerate(there)]
    Map([*rows, landmark(9, "tv", (0, 1, 1), "tentative")]).save(tmp_path / "map")
    t = np.arange(30) / 10.0
    truth = Trajectory(t, np.array([exp([0, 0, 0.1 * s, np.cos(s), np.sin(s), 0.3 * s]) for s in t]))
    write_trajectory(tmp_path / "groundtruth.txt", truth)
    write_trajectory(tmp_path / "estimate.txt", Trajectory(t, inverse(T_TRUTH_MAP) @ truth.T_world_camera))
    return tmp_path


def aligned(scene, *arguments):
    files = (scene / "estimate.txt", scene / "groundtruth.txt")
    return run("landmarks", scene / "map", scene / "truth.json", "--align", *files, *arguments)


def test_landmarks_table_states_protocol_radius_rule_and_g(scene):
    result = aligned(scene, "--labels", f"synonyms:{scene / 'words.json'}")
    assert result.exit_code == 0
    words = ("landmarks/1", "radius 0.2 m", f"labels synonyms:{scene / 'words.json'}", "G = 3 objects", "3 stable", "1 tentative or lost")
    for text in (
        *words,
        "precision 0.667  recall 0.667  F1 0.667  false positives 1: duplicates 0, ghosts 0, false 1",
        "cup-1 (cup) = landmark 0 (mug), 0.050 m",
    ):
        assert text in result.output
    assert "tv?[2J" in result.output
    assert "\x1b" not in result.output


def test_landmarks_json(scene):
    content = json.loads(aligned(scene, "--labels", "exact", "--radius", "0.3", "--json").output)
    assert (content["protocol"], content["label_rule"], content["radius_m"], content["G"]) == ("landmarks/1", "exact", 0.3, 3)
    assert (content["matched"], content["false_positives"], content["tentative_left_out"]) == (1, 2, 1)
    assert [pair["object_id"] for pair in content["matched_list"]] == ["book-1"]
    assert [gone["object_id"] for gone in content["missing_list"]] == ["cup-1", "tv-1"]
    assert content["alignment"]["rmse_m"] < 1e-6
    np.testing.assert_allclose(content["alignment"]["T_truth_estimate"], T_TRUTH_MAP, atol=1e-6)


def test_every_g_and_every_class_are_in_the_table(scene):
    truth = json.loads((scene / "truth.json").read_text())
    for item, seen in zip(truth["objects"], (9, 2, 9), strict=True):
        item["visible_keyframes"] = seen
    truth["timeline"] = [{"timestamp_s": 1, "event": "removed", "id": "vase-1", "label": "vase", "center": [0.5, 0.5, 1]}]
    (scene / "truth.json").write_text(json.dumps(truth))
    lines = [" ".join(line.split()) for line in aligned(scene, "--truth-count", "4").output.splitlines()]
    assert "all objects 3 3 1 0.333 0.333 0.333" in lines
    assert "in view for 5 keyframes 2 2 0 0.000 0.000 0.000" in lines
    assert "as given 4 3 1 0.333 0.250 0.286" in lines
    assert "radius matched precision recall F1 F1, in view" in lines
    assert "0.2 1 0.333 0.333 0.333 0.000" in lines
    assert "class objects matched missing duplicates ghosts false" in lines
    assert "book 1 1 0 0 0 0" in lines
    assert "(no class of the truth) 0 0 0 0 0 2" in lines
    content = json.loads(aligned(scene, "--truth-count", "4", "--json").output)
    assert (content["given"]["objects"], content["visible"]["objects"], content["visible"]["landmarks"]) == (4, 2, 2)
    assert content["per_class"][0] == {
        **{"label": "book", "objects": 1, "matched": 1, "missing": 0, "duplicates": 0, "ghosts": 0, "false": 0, "landmarks": 1}
    }
    with pytest.raises(EvaluationError, match="truth_count: got 1"):
        aligned(scene, "--labels", "geometry", "--truth-count", "1")


def test_pictures_of_truth_and_map(scene):
    write_trajectory(scene / "map/trajectory.txt", read_trajectory(scene / "estimate.txt"))
    result = aligned(scene, "--report", scene / "map/evaluation.html", "--svg", scene / "e.svg")
    assert result.exit_code == 0
    assert str(scene / "e.svg") in result.output
    page = (scene / "map/evaluation.html").read_text()
    assert "map against truth.json" in page
    assert "\x1b" not in page
    svg = ET.parse(scene / "e.svg").getroot()
    path = next(node for node in svg.iter() if node.get("class") == "path")
    assert len(path.get("points").split()) == 30
    # The path lies in the true world, as the landmarks do: both are moved by the alignment.
    assert any("book-1" in (node.text or "") for node in svg.iter("{http://www.w3.org/2000/svg}title"))
    with pytest.raises(ConfigError, match=r"--svg .*cannot be written"):
        aligned(scene, "--svg", scene / "nowhere/e.svg")


def test_without_alignment_the_worlds_differ(scene):
    content = json.loads(run("landmarks", scene / "map", scene / "truth.json", "--labels", "geometry", "--json").output)
    assert (content["matched"], content["alignment"]) == (0, None)
    assert json.loads(aligned(scene, "--labels", "geometry", "--json").output)["matched"] == 2


def test_trajectory(scene):
    result = run("trajectory", scene / "estimate.txt", scene / "groundtruth.txt", "--rpe-step", "1")
    assert result.exit_code == 0
    for text in ("ape/1", "within 20 ms", "compared 30 of 30", "rmse    0.000000 m", "rpe/1: over 1 s, 20 steps"):
        assert text in result.output
    assert "nearly a line" not in result.output


def test_trajectory_json_of_a_published_estimate(shared):
    folder = shared / "data/trajectories"
    content = json.loads(run("trajectory", folder / "fr2_desk_ORB.txt", folder / "fr2_desk_groundtruth.txt", "--json").output)
    assert (content["protocol"], content["compared"], content["estimates"]) == ("ape/1", 2225, 2893)
    assert content["rmse_m"] == pytest.approx(0.008114, abs=6e-7)


def test_a_path_that_is_nearly_a_line_is_pointed_out(tmp_path):
    t = np.arange(30) / 10.0
    poses = np.tile(np.eye(4), (30, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = t, 0.01 * np.sin(5 * t)
    write_trajectory(tmp_path / "t.txt", Trajectory(t, poses))
    assert "nearly a line" in run("trajectory", tmp_path / "t.txt", tmp_path / "t.txt").output


@pytest.mark.parametrize("rule", ["exactly", "synonyms", "synonyms:", "geometry:x"])
def test_unknown_label_rule(scene, rule):
    with pytest.raises(ConfigError, match="wanted exact, synonyms:FILE or geometry"):
        run("landmarks", scene / "map", scene / "truth.json", "--labels", rule)


def test_missing_files_are_named(scene):
    with pytest.raises(DatasetError, match=r"none\.json: no such file"):
        run("landmarks", scene / "map", scene / "none.json")
    with pytest.raises(MapFormatError, match="nowhere"):
        run("landmarks", scene / "nowhere", scene / "truth.json")
    with pytest.raises(DatasetError, match=r"none\.txt"):
        run("trajectory", scene / "none.txt", scene / "groundtruth.txt")
