import json

import calibrate_level
import pytest
from calibrate_level import MOST_EVALUATIONS, TARGET_F1, TOLERANCE, search


@pytest.mark.parametrize("slope", [0.15, 0.3, 0.6])
@pytest.mark.parametrize("first", [0.1, 0.5, 1.0])
def test_the_level_is_found_in_few_evaluations(first, slope):
    tried = search(lambda level: 0.8 - slope * level, first)
    assert len(tried) <= MOST_EVALUATIONS
    assert min(abs(f1 - TARGET_F1) for _, f1 in tried) <= TOLERANCE
    assert len({level for level, _ in tried}) == len(tried)


def test_the_search_ends_where_no_level_fits():
    assert len(search(lambda level: 0.9, 0.5)) == MOST_EVALUATIONS
    assert len(search(lambda level: 0.3, 0.02)) <= MOST_EVALUATIONS


def run(tmp_path, *words):
    return calibrate_level.main(["--rooms", "SM1,SM2", "--seeds", "0-1", "--file", str(tmp_path / "level.json"), *words])


def test_the_level_is_written_with_every_evaluation_and_not_replaced_unasked(tmp_path, monkeypatch, capsys):
    def evaluate(jobs, processes, title):
        return [{"room": job.room, "f1": 0.8 - 0.3 * job.level + 0.01 * job.seed} for job in jobs], []

    monkeypatch.setattr(calibrate_level, "evaluate", evaluate)
    assert run(tmp_path) == 0
    written = json.loads((tmp_path / "level.json").read_text())
    assert json.loads(capsys.readouterr().out) == written
    assert abs(written["rg_mean_f1"] - TARGET_F1) <= TOLERANCE
    assert written["level"] in [row["level"] for row in written["evaluations"]]
    assert {"date", "commit", "rooms", "seeds", "frames", "versions"} <= set(written)
    assert set(written["evaluations"][0]["per_room"]) == {"SM1", "SM2"}
    with pytest.raises(SystemExit):
        run(tmp_path)
    assert "--again" in capsys.readouterr().err
    assert run(tmp_path, "--again") == 0


def test_no_level_is_written_where_runs_failed_or_none_fits(tmp_path, monkeypatch, capsys):
    failure = calibrate_level.Failure("SM1", 0, None, "ValueError: x", "Traceback: x")
    monkeypatch.setattr(calibrate_level, "evaluate", lambda *_: ([{"room": "SM1", "f1": 0.635}], [failure]))
    assert run(tmp_path) == 1
    monkeypatch.setattr(calibrate_level, "evaluate", lambda jobs, *_: ([{"room": job.room, "f1": 0.9} for job in jobs], []))
    assert run(tmp_path) == 1
    assert "no level found" in capsys.readouterr().err
    assert not (tmp_path / "level.json").exists()


def test_only_rg_with_all_knobs_at_their_level_counts(tmp_path, capsys):
    for words in (["--variants", "RG+D"], ["--knob", "detector.miss=0"], ["--level", "0"]):
        with pytest.raises(SystemExit):
            run(tmp_path, *words)
    assert "no other variant" in capsys.readouterr().err
