"""The navigation benchmark: maps are kept, every drive is a row, a drive that raises too, and bad words are refused at once."""

import json
from dataclasses import replace

import pytest

import navigation
from seo_slam.driving.run_trial import DriveOptions
from seo_slam.driving.trials import Trial
from seo_slam.map import Map
from seo_slam.settings.navigation import NavigationSettings

TINY = [
    *("--homes", "10", "--level", "0", "--mapper", "true", "--embedder", "hashed", "--size", "64x48"),
    *("--every", "12", "--rate", "2", "--frames", "12", "--jobs", "1", "--trials", "1"),
]


def test_one_run(tmp_path, capsys):
    folders = ["--maps", str(tmp_path / "maps"), "--out", str(tmp_path / "out"), "--pictures", str(tmp_path / "pictures")]
    words = [*TINY, *folders, "--kinds", "static,cross_anchor", "--strategies", "updated,random"]
    assert navigation.main(words) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "out" / "navigation.json").read_text())
    assert printed["protocol"] == "navigation/1"
    assert (printed["level"], printed["radius_m"], printed["mapper"]) == (0.0, 1.0, "true")
    assert printed["seeds"] == {"trials": 0, "apartment 10": 10}
    assert [(row["kind"], row["strategy"], row["trials"]) for row in printed["table"]] == [
        ("static", "updated", 1),
        ("cross_anchor", "updated", 1),
        ("cross_anchor", "random", 1),
    ]
    rows = [json.loads(line) for line in (tmp_path / "out" / "navigation.jsonl").read_text().splitlines()]
    assert len(rows) == 3
    assert rows[1]["trial"] == rows[2]["trial"]
    assert all(Trial.from_dict(row["trial"]).name for row in rows)
    assert len(list((tmp_path / "pictures").glob("*.svg"))) == 3
    assert len(list((tmp_path / "maps").glob("apartment-10-*/map.json"))) == 1
    assert len(printed["not_successful"]) == sum(not row["success"] for row in rows)
    (tmp_path / "out" / "drives" / "apartment-10-static-00-updated.json").unlink()
    assert navigation.main([*words, "--resume"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["table"] == printed["table"]


def test_a_drive_that_is_there_is_not_driven_again(tmp_path, capsys, monkeypatch):
    words = [*TINY, "--maps", str(tmp_path), "--out", str(tmp_path), "--kinds", "static"]
    assert navigation.main(words) == 0
    printed = json.loads(capsys.readouterr().out)
    monkeypatch.delattr(navigation, "run_trial")
    assert navigation.main([*words, "--resume"]) == 0
    assert json.loads(capsys.readouterr().out)["table"] == printed["table"]


@pytest.fixture
def kept_job(tmp_path, monkeypatch):
    """A job whose row is kept, with a map of nothing, and the jobs that are driven; driving is only said to be done."""
    monkeypatch.setattr(navigation, "driven", lambda job: driven.append(job) or {"reason": f"drive {len(driven)}"})
    driven = []
    trial = Trial("static", 0, "cup", (1,), (0.0, 0.5), 0.1)
    of = navigation.HomeJob("apartment", 10, 0.0, None, (64, 48), None, "true", "hashed", str(tmp_path / "maps"), 12, 0, (("static", 1),))
    Map().save(of.folder)
    path = tmp_path / "row.json"
    job = navigation.TrialJob(of, trial, NavigationSettings(), DriveOptions(), None, str(path), resume=True)
    navigation.drive(job)
    return job, path, driven


@pytest.mark.parametrize(
    "changes",
    [
        {"settings": NavigationSettings(attempts=7)},
        {"options": DriveOptions(rate_hz=3.0)},
        {"trial": Trial("static", 0, "cup", (2,), (0, 0), 0)},
    ],
)
def test_a_row_of_other_settings_is_not_taken(kept_job, changes):
    job, path, _ = kept_job
    assert navigation.drive(job)["reason"] == "drive 1"
    row = navigation.drive(replace(job, **changes))
    assert row["reason"] == "drive 2"
    assert json.loads(path.read_text()) == row
    assert navigation.drive(job)["reason"] == "drive 3"


def test_a_row_of_another_home_or_map_is_not_taken(kept_job, monkeypatch):
    job, _, driven = kept_job
    other = replace(job.of, level=0.5)
    Map().save(other.folder)
    navigation.drive(replace(job, of=other))
    assert len(driven) == 2
    navigation.drive(job)
    Map(next_id=5).save(job.of.folder)
    navigation._map_hash.cache_clear()  # another process
    navigation.drive(job)
    assert len(driven) == 4


@pytest.mark.parametrize("text", ["{", "[]", '{"reason": "of before there was such a field"}', None])
def test_a_row_that_is_broken_or_of_another_format_is_not_taken(kept_job, text):
    job, path, _ = kept_job
    row = json.loads(path.read_text())
    path.write_text(text or json.dumps({**row, "made_with": {**row["made_with"], "format": 0}}))
    assert navigation.drive(job)["reason"] == "drive 2"


def test_how_many_trials_and_where_maps_are_kept_change_no_drive(kept_job, tmp_path):
    job, _, _ = kept_job
    elsewhere = replace(job.of, maps=str(tmp_path / "elsewhere"), cache=str(tmp_path), counts=())
    Map().save(elsewhere.folder)
    assert navigation.drive(replace(job, of=elsewhere))["reason"] == "drive 1"


def test_a_drive_that_raises_is_a_row(tmp_path, capsys, monkeypatch):
    def broken(*args, **kwargs):
        raise KeyError("a planner under test")

    monkeypatch.setattr(navigation, "run_trial", broken)
    assert navigation.main([*TINY, "--maps", str(tmp_path), "--kinds", "static"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["table"][0]["failures"] == {"failed": 1}
    assert "a planner under test" in printed["not_successful"][0]["error"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--kinds", "dynamic"], "--kinds"),
        (["--homes", "castle"], "castle"),
        (["--mapper", "lidar"], "--mapper"),
        (["--strategies", "best"], "--strategies"),
        (["--jobs", "0"], "--jobs"),
        (["--frames", "0"], "--frames"),
        (["--size", "big"], "size"),
        (["--level", "-1"], "level"),
    ],
)
def test_bad_words_are_refused(words, told, capsys):
    with pytest.raises(SystemExit) as ended:
        navigation.main([*TINY, *words])
    assert ended.value.code == 2
    assert told in capsys.readouterr().err


def test_the_paper_counts():
    counts = {kind: sum(navigation._count(kind, position) for position in range(3)) for kind in navigation.COUNTS}
    assert counts == {"static": 78, "in_anchor": 54, "cross_anchor": 53}
