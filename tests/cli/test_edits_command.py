"""``seo-slam edits``."""

import json
from dataclasses import replace

import pytest

from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.map import Map
from seo_slam.testing.store import make_edit, make_landmark, make_record


@pytest.fixture
def result(tmp_path):
    named = replace(make_landmark(1, version=2), label="chipped white mug", category="cup")
    hostile = "<script>'); DROP TABLE edit; --\x1b]0;owned\x07\n" + "x" * 5000
    edits = (
        make_edit(before=(make_landmark(1),)),
        replace(make_edit("remove", 2, outcome="refused", detail=hostile, keyframe_id=3), agent="Sweeper\x1b[2J", model="", prompt_hash=""),
        make_edit("merge", 3, 2, outcome="noted", detail="a second view is to say so, too"),
    )
    with SqliteStore(tmp_path / "map.db") as store:
        store.commit(make_record(0, landmarks=(named, make_landmark(2), make_landmark(3)), edits=edits))
    Map([named, make_landmark(2), make_landmark(3)], "poses", "hashed").save(tmp_path)
    return tmp_path


def test_the_table_says_who_did_what_with_which_prompt(run, result):
    status, out, err = run("edits", result)
    assert (status, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].split("  ")[0] == "edit"
    assert lines[1].split() == [
        "1", "1305031102.68", "relabel", "1", "applied", "Painter", "brush-2b", "5f2a9c01", "0", "cup", "->", "chipped", "white", "mug",
    ]  # fmt: skip
    assert "3 -> 2" in lines[3]
    assert len(lines) == 4


def test_hostile_words_do_not_steer_the_terminal(run, result):
    _, out, _ = run("edits", result)
    assert all(line.isprintable() for line in out.splitlines())
    assert "Sweeper?[2J" in out
    assert max(len(line) for line in out.splitlines()) < 240
    _, out, _ = run("edits", result, "--json")
    assert out.isascii()
    assert all(c.isprintable() or c == "\n" for c in out)


@pytest.mark.parametrize(
    ("options", "numbers"),
    [
        ([], [1, 2, 3]),
        (["--agent", "Painter"], [1, 3]),
        (["--landmark", "2"], [2, 3]),
        (["--outcome", "applied"], [1]),
        (["--agent", "Painter", "--outcome", "noted"], [3]),
        (["--agent", "nobody"], []),
    ],
)
def test_json_of_those_asked_for(run, result, options, numbers):
    status, out, _ = run("edits", result, "--json", *options)
    assert status == 0
    assert [edit["number"] for edit in json.loads(out)["edits"]] == numbers


def test_json_has_every_field_and_what_was_before(run, result):
    first = json.loads(run("edits", result / "map.json", "--json")[1])["edits"][0]
    before = first.pop("before")
    assert [(row["id"], row["label"]) for row in before] == [(1, "cup")]
    assert first == {
        "number": 1,
        "kind": "relabel",
        "landmark_id": 1,
        "other_id": None,
        "outcome": "applied",
        "undone_by": None,
        "detail": "cup -> chipped white mug",
        "agent": "Painter",
        "model": "brush-2b",
        "prompt_hash": "5f2a9c01",
        "view_keyframe_id": 0,
        "view_s": pytest.approx(1305031102.175304),
        "keyframe_id": 0,
        "timestamp_s": 1305031102.675304,
    }


def test_an_edit_is_undone_and_the_list_says_so(run, result):
    status, out, err = run("edits", result, "--undo", "1")
    assert (status, err) == (0, "")
    assert out == "Undone: edit 1, relabel of landmark 1: cup -> chipped white mug. This is edit 4.\n"
    assert Map.load(result).landmark(1).label == "cup"
    _, out, _ = run("edits", result)
    assert "undone by 4" in out.splitlines()[1]
    assert out.splitlines()[4].split()[2] == "undo"
    status, out, err = run("edits", result, "--undo", "1")
    assert (status, out) == (2, "")
    assert err == "error: edit 1 was undone already, by edit 4\n"


def test_an_undo_says_that_the_report_is_older(run, result):
    (result / "report.html").write_text("<html>")
    _, out, _ = run("edits", result / "map.db", "--undo", "1")
    assert out.endswith("This is edit 4. report.html is as the run left it, and still shows the map before the undo.\n")


def test_undo_as_json(run, result):
    out = json.loads(run("edits", result, "--undo", "1", "--json")[1])
    assert [(edit["number"], edit["kind"], edit["other_id"]) for edit in out["edits"]] == [(4, "undo", 1)]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--undo", "2"], "changed nothing in the map"),
        (["--undo", "9"], "no edit 9; edits 1 to 3 are kept"),
        (["--undo", "1", "--agent", "Painter"], "the number says which edit"),
        (["--outcome", "aplied"], "wanted applied, noted, stale or refused"),
    ],
)
def test_mistakes_are_one_line(run, result, words, said):
    status, out, err = run("edits", result, *words)
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1


def test_a_map_without_edits_and_a_folder_without_store(run, result, tmp_path):
    assert run("edits", result, "--agent", "nobody")[1] == "None of the 3 edits is like that.\n"
    with SqliteStore(tmp_path / "none" / "map.db") as store:
        store.commit(make_record(0))
    assert run("edits", tmp_path / "none")[1] == "No edits.\n"
    status, _, err = run("edits", tmp_path / "nowhere")
    assert status == 2
    assert "holds no map.db" in err
