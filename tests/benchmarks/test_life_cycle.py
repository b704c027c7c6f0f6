import json

import life_cycle


def test_one_json_object_with_every_failure_and_its_files(tmp_path, capsys):
    words = ["--rooms", "SM1", "--seeds", "0", "--frames", "40", "--size", "128x96", "--level", "0", "--jobs", "1", "--out", str(tmp_path)]
    assert life_cycle.main([*words, "--variants", "RG,RG+D+L", "--set", "embedder.name=hashed"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["protocol"] == "life_cycle/1"
    assert {"definitions", "rooms", "seeds", "level", "frames", "versions", "failures"} <= set(printed)
    assert list(printed["variants"]) == ["RG", "RG+D+L"]
    for variant in printed["variants"].values():
        for found in (variant, variant["per_room"]["SM1"]):
            ghosts, moved = found["ghosts"], found["moved"]
            assert ghosts["cases"] + ghosts["undecided"] + ghosts["not_mapped"] == 5  # two things go, three move
            assert moved["cases"] + moved["not_mapped"] + moved["not_seen_again"] == 3
            assert {"share_gone", "taken_over", "median_seconds_until_gone"} <= set(ghosts)
            assert {"share_kept", "took_another_id"} <= set(moved)
            assert set(found["hidden"]) == set(found["stayed"]) == {"cases", "removed", "share_removed", "lost", "share_lost"}
    ghosts = printed["variants"]["RG"]["ghosts"]
    assert ghosts["cases"] > 0
    assert ghosts["gone"] < ghosts["cases"]  # it never removes
    told = printed["variants"]["RG"]["failed_cases"]["ghosts"]
    assert len(told) == ghosts["cases"] - ghosts["gone"]
    assert all(case["room"] == "SM1" and case["standing"] for case in told)
    assert json.loads((tmp_path / "life_cycle.json").read_text()) == printed
    rows = [json.loads(line) for line in (tmp_path / "life_cycle.jsonl").read_text().splitlines()]
    assert sum(row["kind"] == "ghosts" for row in rows) == 10
