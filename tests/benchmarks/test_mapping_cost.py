"""The benchmark of the map's cost: what it counts, and that a tape is what was seen."""

import json

import frame_tape
import mapping_cost
import numpy as np
import pytest
import replay_tape
from crowded_hall import around, crowded_hall, hall
from frame_tape import FrameTape

from seo_slam.config import Config
from seo_slam.records import MapEvent

TINY = [
    *("--worlds", "hall", "--tables", "2", "--laps", "2", "--lap-frames", "8", "--hall-size", "128x96", "--level", "0.3"),
    *(
        "--set",
        "embedder.name=hashed",
        "--set",
        "status.observations=2",
        "--least-objects",
        "10",
        "--least-in-view",
        "3",
        "--most-in-view",
        "10",
    ),
]


@pytest.fixture(scope="module")
def tapes(tmp_path_factory):
    return tmp_path_factory.mktemp("tapes")


@pytest.fixture(scope="module")
def printed(tapes):
    """What is printed of two variants, replayed in this process, and the runs behind it."""
    with pytest.MonkeyPatch.context() as patch:
        lines = []
        patch.setattr("builtins.print", lambda *words, **_: lines.append(" ".join(map(str, words))))
        patch.setattr(mapping_cost, "replayed", replay_tape.replay)  # a process of its own would load the libraries again
        patch.setattr(replay_tape, "forget_peak", lambda: None)
        out = tapes / "all.json"
        words = [*TINY, "--variants", "full; no stability check", "--tapes", str(tapes / "kept"), "--out", str(out)]
        assert mapping_cost.main(words) == 0
    return json.loads(lines[-1]), json.loads(out.read_text())["runs"]["hall"]


def test_update_memory_and_efficiency_are_of_the_runs(printed):
    result, runs = printed
    assert list(result["efficiency"]["hall"]) == list(runs) == ["full", "no stability check"]
    cost, rows = result["update_cost"], runs["full"]["keyframes"]
    counted = [row for row in rows if row["objects"] >= 10 and row["in_view"] >= 3]
    assert 0 < len(counted) == cost["keyframes_counted"] < cost["keyframes"] == len(rows)
    sums = [sum(row["stages"][stage] for stage in ("associate", "smooth", "map", "life")) for row in counted]
    assert cost["update_ms"]["median"] == pytest.approx(np.median(sums), abs=1e-3)
    assert cost["update_ms"]["max"] == pytest.approx(max(sums), abs=1e-3)
    at_aim = [row for row in counted if row["in_view"] <= 10]
    assert 0 < len(at_aim) == result["update_cost_at_aim"]["keyframes_counted"] < len(counted)
    assert result["update_cost_at_aim"]["objects_in_view"]["max"] <= 10
    laps = result["memory_growth"]["laps"]
    assert [lap["lap"] for lap in laps] == [1, 2]
    assert laps[0]["keyframes"] < laps[1]["keyframes"] == len(rows)
    assert laps[1]["points"] > 0
    assert result["memory_growth"]["last_to_first_lap"]["points"] == pytest.approx(laps[1]["points"] / laps[0]["points"], abs=1e-4)
    row = result["efficiency"]["hall"]["full"]
    assert (row["frames"], row["landmarks"]) == (16, runs["full"]["landmarks"])
    assert row["memory_mb"]["peak"] >= row["memory_mb"]["mean"] > 0


def test_objects_are_counted_by_what_happened_to_the_map(printed):
    for run in printed[1].values():
        assert run["objects"] == run["landmarks"] + run["tentative"] == run["laps"][-1]["objects"] > 0
    kinds = ["created", "created", "split", "merged", "removed", "stable"]
    assert replay_tape.change_of_number([MapEvent(kind, 1, "cup") for kind in kinds]) == 1


def test_a_tape_plays_what_was_seen(printed, tapes):
    tape = FrameTape.open(tapes / "kept" / "hall")
    walk = crowded_hall(0, 0.3, 2, 2, (128, 96), 8)
    assert tape.lap_ends == (7, 15)
    assert np.array_equal(tape.path.T_world_camera, walk.trajectory.T_world_camera)
    assert tape.camera == walk.camera
    played = list(tape.play())
    looked_at = {row["index"] for row in printed[1]["full"]["keyframes"]}
    assert len(played) == len(walk)
    for frame, found in played:
        assert (len(found) > 0) == (frame.index in looked_at)
    frame, found = played[0]
    assert np.array_equal(frame.rgb, walk.frame(0).rgb)
    assert np.array_equal(frame.depth_m, walk.frame(0).depth_m)
    assert found.masks.any(axis=(1, 2)).all()
    assert np.allclose(np.linalg.norm(found.embeddings, axis=1), 1)
    assert set(walk.detector.detect(frame).labels) & set(found.labels)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--seed", "1"], "seed 0 (wanted 1)"),
        (["--level", "0.5"], "level 0.3 (wanted 0.5)"),
        (["--hall-size", "160x120"], "size_px [128, 96] (wanted [160, 120])"),
        (["--laps", "3"], "laps 2 (wanted 3)"),
        (["--set", "keyframes.distance_m=0.7"], "keyframes {"),
    ],
)
def test_a_tape_of_something_else_is_refused(printed, tapes, words, told, capsys):
    with pytest.raises(SystemExit):
        mapping_cost.main([*TINY, *words, "--variants", "full", "--tapes", str(tapes / "kept")])
    said = capsys.readouterr().err
    assert f"hall: was made with {told}" in said
    assert "take another folder" in said


def test_a_tape_that_does_not_say_what_it_is_is_refused(printed, tapes, tmp_path, capsys):
    (tmp_path / "hall").mkdir()
    (tmp_path / "hall" / "path.npz").write_bytes((tapes / "kept" / "hall" / "path.npz").read_bytes())
    for text, told in (("{}", "does not say what it was made with"), ("{", "is no tape")):
        (tmp_path / "hall" / "tape.json").write_text(text)
        with pytest.raises(SystemExit):
            mapping_cost.main([*TINY, "--variants", "full", "--tapes", str(tmp_path)])
        assert told in capsys.readouterr().err


def test_a_tape_of_the_same_is_taken(printed, tapes):
    worlds, variants = mapping_cost.chosen(given := mapping_cost.options().parse_args([*TINY, "--variants", "full; no split"]))
    assert mapping_cost.is_recorded(mapping_cost.tape_of(tapes / "kept", "hall", "full"))
    mapping_cost.require_fitting(worlds, variants, given, tapes / "kept")


def test_things_of_the_hall_stand_apart_on_its_tables():
    world = hall(seed=1, tables=3)
    tables = [thing for thing in world.things if thing.kind == "anchor"]
    carried = [thing for thing in world.things if thing.kind == "volatile"]
    assert len(tables) == 3
    assert len(carried) >= 24
    for thing in carried:
        low, high = thing.bounds_world
        under = [
            table for table in tables if (table.bounds_world[0][:2] <= low[:2]).all() and (table.bounds_world[1][:2] >= high[:2]).all()
        ]
        assert len(under) == 1
        assert low[2] == pytest.approx(under[0].bounds_world[1][2], abs=3e-3)
    boxes = np.array([thing.bounds_world for thing in carried])
    apart = (boxes[:, None, 0] >= boxes[None, :, 1]) | (boxes[:, None, 1] <= boxes[None, :, 0])
    assert (apart.any(axis=2) | np.eye(len(carried), dtype=bool)).all()


def test_a_lap_is_closed_and_even():
    lap = around(3.0, 90)
    eyes = lap.T_world_camera[:, :3, 3]
    steps_m = np.linalg.norm(np.roll(eyes, -1, axis=0) - eyes, axis=1)
    assert np.ptp(steps_m) < 0.02 * steps_m.mean()
    ahead = lap.T_world_camera[:, :3, 2]
    assert ((ahead[:, :2] * np.roll(ahead[:, :2], -1, axis=0)).sum(axis=1) > 0.85).all()


def test_every_variant_is_a_preset_with_settings_that_exist():
    _, variants = mapping_cost.chosen(mapping_cost.options().parse_args(["--worlds", "hall"]))
    assert list(variants) == list(mapping_cost.VARIANTS)
    preset = Config.preset("dualmap")
    assert variants["full"] == preset
    assert all(config != preset for name, config in variants.items() if name != "full")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--worlds", "moon"], "--worlds: got 'moon', wanted some of hall, SM1"),
        (["--variants", "fuller"], "--variants: got 'fuller', wanted some of full"),
        (["--worlds", "house"], "the house needs --meshes DIR"),
        (["--laps", "0"], "wanted 1, 1, 2 at least"),
        (["--hall-size", "8"], "--size: got '8', wanted like 320x240"),
    ],
)
def test_bad_arguments_end_with_usage_and_reason(words, message, capsys):
    with pytest.raises(SystemExit) as ended:
        mapping_cost.main([*TINY, *words])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_a_run_that_fails_says_why(tmp_path):
    with pytest.raises(RuntimeError, match="No such file"):
        mapping_cost.replayed(tmp_path, Config.preset("dualmap"))


def test_peak_memory_begins_anew():
    taken = np.ones(60 * 2**20 // 8)
    with_it = replay_tape.peak_resident_mb()
    del taken
    replay_tape.forget_peak()
    assert replay_tape.peak_resident_mb() < with_it
    assert frame_tape.TapeDetector().found.labels == ()
