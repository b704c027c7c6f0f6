"""``seo-slam query``."""

import json
from dataclasses import replace

import pytest

from seo_slam.map import Map
from seo_slam.records import FeatureRecipe
from seo_slam.testing.store import make_landmark


@pytest.fixture
def result(tmp_path):
    rows = [make_landmark(0, (0.5, 0.0, 1.0)), replace(make_landmark(1), label="laptop\x1b[31m", labels={"laptop\x1b[31m": 1.0})]
    Map([*rows, make_landmark(2, state="tentative")], "poses", "hashed").save(tmp_path)
    return tmp_path


def test_hits_are_printed_best_first(run, result):
    status, out, err = run("query", result, "cup")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert len(lines) == 3
    assert lines[0].split()[:3] == ["score", "id", "label"]
    assert lines[1].split()[1:6] == ["0", "cup", "0.50", "0.00", "1.00"]


def test_a_label_cannot_steer_the_terminal(run, result):
    _, out, _ = run("query", result, "laptop", "-k", "1")
    assert "laptop?[31m" in out
    assert "\x1b" not in out


def test_json_is_for_programs(run, result):
    status, out, _ = run("query", result, "cup", "-k", "1", "--json")
    answer = json.loads(out)
    assert status == 0
    assert (answer["query"], answer["embedder"], answer["gravity"]) == ("cup", "hashed", "poses")
    [hit] = answer["hits"]
    assert (hit["id"], hit["label"], hit["position_m"]) == (0, "cup", [0.5, 0.0, 1.0])
    assert 0.5 < hit["score"] <= 1.0


def test_an_empty_map_says_so(run, tmp_path):
    Map(embedder="hashed").save(tmp_path)
    assert run("query", tmp_path, "cup") == (0, "The map holds no stable landmark that has a label.\n", "")
    status, out, _ = run("query", tmp_path, "cup", "--json")
    assert (status, json.loads(out)["hits"]) == (0, [])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("query", "{result}/nothing", "cup"), "nothing: no such map file"),
        (("query", "{result}", ""), "query: got an empty text"),
        (("query", "{result}", "cup", "-k", "0"), "-k"),
    ],
)
def test_mistakes_end_with_one_clear_line(run, result, words, message):
    status, out, err = run(*(word.replace("{result}", str(result)) for word in words))
    assert (status, out) == (2, "")
    assert message in err
    assert "Traceback" not in err


def test_scores_of_features_with_pictures_are_explained(run, tmp_path):
    Map([make_landmark(0)], "poses", "hashed", features=FeatureRecipe(0.7, 0.3, "Clip:small")).save(tmp_path)
    _, out, _ = run("query", tmp_path, "cup")
    assert out.splitlines()[-1] == "Features are of 0.7 pictures (Clip:small) and 0.3 words: a thing's own word scores less than 1."
