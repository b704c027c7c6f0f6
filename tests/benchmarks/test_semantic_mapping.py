import json

import pytest
import semantic_mapping

TINY = ["--rooms", "SM1", "--seeds", "0", "--frames", "30", "--size", "160x120", "--level", "0.5", "--jobs", "1"]
HASHED = ["--set", "embedder.name=hashed"]


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("semantic_mapping")


@pytest.fixture(scope="module")
def printed(out):
    """What is printed of one room, one seed and all variants; its files lie in ``out``."""
    with pytest.MonkeyPatch.context() as patch:
        lines = []
        patch.setattr("builtins.print", lambda *words, **_: lines.append(" ".join(map(str, words))))
        assert semantic_mapping.main([*TINY, *HASHED, "--out", str(out)]) == 0
    return json.loads(lines[-1])


def test_one_json_object_with_what_the_protocol_asks_for(printed):
    assert printed["protocol"] == "landmarks/1"
    assert (printed["rooms"], printed["seeds"], printed["level"], printed["frames"]) == (["SM1"], [0], 0.5, 30)
    assert (printed["radius_m"], printed["label_rule"], printed["embedder"]) == (0.2, "exact", ["hashed"])
    assert printed["failures"] == []
    assert "numpy" in printed["versions"]
    assert list(printed["variants"]) == ["RG", "RG+D", "RG+D+L"]
    for variant in printed["variants"].values():
        for figures in (variant, variant["per_room"]["SM1"]):
            assert {"f1", "precision", "recall", "false_positives", "duplicates", "ghosts", "landmarks", "f1_visible"} <= set(figures)
            assert set(figures["f1"]) == {"mean", "std"}
            assert figures["false_positives"]["mean"] == sum(figures[kind]["mean"] for kind in ("duplicates", "ghosts", "false"))
        assert set(variant["f1_by_radius"]) == {"0.1", "0.2", "0.3", "0.5"}
        assert sum(row["objects"] for row in variant["per_class"]) == variant["objects"]["mean"]


def test_variants_are_compared_with_the_first_and_with_the_ceilings(printed):
    variants, compared = printed["variants"], printed["comparison"]
    assert compared["base"] == "RG"
    difference = variants["RG+D+L"]["f1"]["mean"] - variants["RG"]["f1"]["mean"]
    assert compared["SM1"]["RG+D+L"]["f1_difference"] == pytest.approx(difference, abs=1e-4)
    assert compared["mean"] == compared["SM1"]
    ceilings = printed["ceilings"]
    assert ceilings["of"] == "RG+D+L"
    assert variants["RG+D+L"]["f1"]["mean"] <= ceilings["geometry"]["f1"]["mean"] <= ceilings["oracle"]["f1"]["mean"]


def test_the_files_say_the_same(printed, out):
    assert json.loads((out / "semantic_mapping.json").read_text()) == printed
    rows = [json.loads(line) for line in (out / "runs.jsonl").read_text().splitlines()]
    assert [(row["room"], row["seed"], row["variant"]) for row in rows] == [("SM1", 0, name) for name in printed["variants"]]
    for row in rows:
        assert len(row["matched_list"]) == row["matched"]
        assert len(row["extra_list"]) == row["false_positives"]
        assert len(row["missing_list"]) == row["objects"] - row["matched"]
    table = (out / "semantic_mapping.md").read_text()
    assert all(f"| SM1 | {printed['variants'][name]['objects']['mean']:g} | {name} |" in table for name in printed["variants"])
    assert "ceiling of RG+D+L" in table
    assert list((out / "renders").rglob("*.npz"))


def test_a_room_that_fails_is_told_and_the_rest_goes_on(monkeypatch, capsys):
    def run_job(job):
        raise ValueError(f"no room for seed {job.seed}")

    monkeypatch.setattr(semantic_mapping, "run_job", run_job)
    assert semantic_mapping.main(TINY) == 1
    printed, told = capsys.readouterr()
    (failure,) = json.loads(printed)["failures"]
    assert (failure["room"], failure["seed"], failure["error"]) == ("SM1", 0, "ValueError: no room for seed 0")
    assert "failed: SM1 seed 0" in told


def test_spread_is_over_runs():
    rows = [{"x": 1.0}, {"x": 2.0}, {"x": 3.0}]
    assert semantic_mapping.figures(rows, ["x"]) == {"x": {"mean": 2.0, "std": 1.0}}
    assert semantic_mapping.figures(rows[:1], ["x"]) == {"x": {"mean": 1.0, "std": 0.0}}
