"""Taking back what agents changed in a saved map."""

import json
import sqlite3
from dataclasses import replace

import numpy as np
import pytest

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.errors import MapError, MapFormatError
from seo_slam.map import Map
from seo_slam.map_document import landmark_fields
from seo_slam.records import Amendment, MapEvent
from seo_slam.testing.store import make_edit, make_landmark, make_record, require_same_landmark
from seo_slam.testing.worlds import tiny_frames
from seo_slam.undo import read_edits, undo_edit, undone_by
from tiny_run import pipeline

BOOT = {"label": "green hiking boot", "category": "shoe", "labels": {"shoe": 0.8, "cup": 0.2}}


class Desk:
    """A saved map of landmarks 0 to 3, 0.5 m apart, and what agents did to it afterwards."""

    def __init__(self, folder):
        self.folder = folder
        self.now = {i: make_landmark(i, (0.5 * i, 0.1, 1 / 3)) for i in range(4)}
        self.store = SqliteStore(folder / "map.db")
        self.store.set_meta("gravity", "poses")
        self.store.set_meta("embedder", "hashed")
        self.keyframe = 0
        created = tuple(MapEvent("created", i) for i in self.now)
        self.store.commit(make_record(0, tuple(self.now), tuple(self.now.values()), (), created))

    def change(self, edit, rows=(), removed=(), events=()):
        self.store.amend(Amendment(self.keyframe, tuple(rows), tuple(removed), tuple(events), (edit,)))
        self.now.update({row.id: row for row in rows})
        for landmark_id in removed:
            del self.now[landmark_id]

    def relabel(self, landmark_id, **words):
        was = self.now[landmark_id]
        named = replace(was, version=was.version + 1, **(words or BOOT))
        edit = make_edit("relabel", landmark_id, before=(was,), detail=f"{was.label} -> {named.label}", keyframe_id=self.keyframe)
        self.change(edit, [named], (), [MapEvent("relabelled", landmark_id, edit.detail, "Painter")])

    def remove(self, landmark_id):
        was = self.now[landmark_id]
        edit = make_edit("remove", landmark_id, before=(was,), detail=was.label, keyframe_id=self.keyframe)
        self.change(edit, (), [landmark_id], [MapEvent("removed", landmark_id, was.label, "Painter")])

    def merge(self, drop_id, keep_id):
        drop, keep = self.now[drop_id], self.now[keep_id]
        both = replace(
            keep,
            position_m=0.5 * (drop.position_m + keep.position_m),
            observations=drop.observations + keep.observations,
            version=keep.version + 1,
        )
        edit = make_edit("merge", drop_id, keep_id, before=(keep, drop), detail=drop.label, keyframe_id=self.keyframe)
        self.change(edit, [both], [drop_id], [MapEvent("merged", drop_id, drop.label, "Painter", keep_id)])

    def see(self, landmark_id, times=3, events=(), removed=()):
        """A keyframe later: seen so often again, half a centimetre to the side."""
        self.keyframe += 1
        was = self.now[landmark_id]
        moved = replace(was, observations=was.observations + times, position_m=was.position_m + 0.005, last_seen_s=was.last_seen_s + 9)
        self.now[landmark_id] = moved
        self.store.commit(make_record(self.keyframe, (landmark_id,), (moved,), removed, tuple(events)))
        for gone in removed:
            del self.now[gone]

    def save(self):
        self.store.close()
        Map(self.now.values(), "poses", "hashed", 4).save(self.folder)
        return self.folder


@pytest.fixture
def desk(tmp_path):
    made = Desk(tmp_path)
    yield made
    made.store.close()


def rows_of(path):
    loaded = Map.load(path)
    return {row.id: row for row in (*loaded.landmarks, *loaded.tentative)}


def require_agreement(folder):
    """map.json and map.db tell the same of every landmark, to what map.json rounds."""
    written, kept = rows_of(folder / "map.json"), rows_of(folder / "map.db")
    assert [landmark_fields(row) for row in written.values()] == [landmark_fields(row) for row in kept.values()]
    assert Map.load(folder / "map.json").next_id == Map.load(folder / "map.db").next_id


def words(row):
    return row.label, row.category, dict(row.labels)


def test_a_label_is_taken_back_and_what_was_seen_since_stays(desk):
    desk.relabel(1)
    desk.see(1)
    folder = desk.save()
    record = undo_edit(folder, 1)
    require_agreement(folder)
    row = rows_of(folder)[1]
    assert words(row) == ("cup", "", {"cup": 0.75, "bowl": 0.25})
    assert (row.observations, row.version) == (7, 3)
    assert row.position_m == pytest.approx([0.505, 0.105, 1 / 3 + 0.005])
    assert row.embedding.tolist() == make_landmark(1).embedding.tolist()
    assert (record.kind, record.landmark_id, record.other_id, record.agent) == ("undo", 1, 1, "user")
    assert record.detail == "edit 1, relabel of landmark 1: cup -> green hiking boot"
    assert words(record.before[0]) == tuple(BOOT.values())


def test_a_removed_landmark_comes_back_under_its_id(desk):
    was = desk.now[2]
    desk.remove(2)
    desk.see(1)
    folder = desk.save()
    assert 2 not in rows_of(folder)
    undo_edit(folder, 1)
    require_agreement(folder)
    require_same_landmark(rows_of(folder / "map.db")[2], replace(was, version=2))
    with SqliteStore(folder / "map.db", read_only=True) as store:
        assert [line[1:] for line in store.history(2)][-1] == ("undone", "edit 1, remove of landmark 2: cup", "user")
        assert store.near(was.position_m, 0.01) == (2,)


@pytest.mark.parametrize(
    ("again", "is_said"),
    [
        ({}, True),
        ({"label": "red cup", "category": "cup"}, True),
        ({"label": "bowl"}, False),
        ({"away_m": 0.05}, False),  # the extent is 0.08 m
        ({"state": "tentative"}, False),
    ],
)
def test_a_removed_thing_that_was_mapped_again_is_named(desk, again, is_said):
    was = desk.now[2]
    desk.remove(2)
    x, y, z = was.position_m
    row = make_landmark(9, (x + again.get("away_m", 0.03), y, z))
    desk.now[9] = replace(row, **{key: value for key, value in again.items() if key != "away_m"})
    desk.see(9)
    folder = desk.save()
    said = "; warning: landmark 9 is at that place under the same name; it may be the same thing, mapped again since"
    record = undo_edit(folder, 1)
    assert record.detail == "edit 1, remove of landmark 2: cup" + (said if is_said else "")
    assert read_edits(folder)[-1].detail == record.detail
    assert {2, 9} <= set(rows_of(folder))
    require_agreement(folder)


def test_merged_landmarks_are_two_again(desk):
    keep, drop = desk.now[1], desk.now[3]
    desk.merge(3, 1)
    folder = desk.save()
    undo_edit(folder, 1)
    require_agreement(folder)
    kept = rows_of(folder / "map.db")
    require_same_landmark(kept[3], replace(drop, version=2))
    require_same_landmark(kept[1], replace(keep, version=3))


def test_what_was_seen_since_a_merge_counts_for_the_one_that_stayed(desk):
    keep = desk.now[1]
    desk.merge(3, 1)
    desk.see(1, times=5)
    folder = desk.save()
    undo_edit(folder, 1)
    row = rows_of(folder)[1]
    assert (row.observations, row.last_seen_s) == (keep.observations + 5, keep.last_seen_s + 9)
    assert row.position_m == pytest.approx(keep.position_m)
    assert rows_of(folder)[3].observations == 4


def with_clouds(desk):
    """Two merged landmarks a metre apart and one that nothing happened to, with the points of their surfaces; as a run leaves them."""
    places = {i: row.position_m for i, row in desk.now.items()}
    near = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.08, 0.0, 0.0]])  # the box ends at 0.04 m
    between = (places[1] + places[3]) / 2.0
    desk.merge(3, 1)
    desk.now[1] = replace(desk.now[1], cloud_world=np.vstack([places[1] + near, places[3] - near, between]))
    desk.now[0] = replace(desk.now[0], cloud_world=places[0] + 5.0 * near)
    return {1: places[1] + near, 3: places[3] - near, 0: places[0] + 5.0 * near}


def require_clouds(folder, clouds):
    rows = rows_of(folder)
    for landmark_id in rows:
        expected = clouds.get(landmark_id, np.zeros((0, 3)))
        np.testing.assert_allclose(rows[landmark_id].cloud_world, expected, atol=1e-6)


def test_merged_landmarks_get_the_points_in_their_own_boxes_back(desk):
    clouds = with_clouds(desk)
    folder = desk.save()
    undo_edit(folder, 1)
    require_agreement(folder)
    require_clouds(folder, clouds)


def test_a_renamed_landmark_keeps_all_its_points_and_a_removed_one_has_none(desk):
    desk.relabel(1)
    desk.remove(2)
    cloud_world = desk.now[1].position_m + np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    desk.now[1] = replace(desk.now[1], cloud_world=cloud_world)
    folder = desk.save()
    undo_edit(folder, 2)
    undo_edit(folder, 1)
    require_clouds(folder, {1: cloud_world})


@pytest.mark.parametrize("file", ["map", "map_clouds"])
def test_points_are_parted_too_when_asking_again_after_a_kill(desk, monkeypatch, file):
    clouds = with_clouds(desk)
    folder = desk.save()

    def killed(path, data):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(f"seo_slam.{file}.write_atomically", killed)
        with pytest.raises(KeyboardInterrupt):
            undo_edit(folder, 1)
    for _ in range(2):
        with pytest.raises(MapError, match="undone already, by edit 2"):
            undo_edit(folder, 1)
        require_agreement(folder)
        require_clouds(folder, clouds)


def test_untouched_landmarks_keep_the_finer_figures_of_map_json(desk):
    desk.relabel(1)
    desk.now[0] = replace(desk.now[0], position_m=desk.now[0].position_m + 0.009)  # as a run leaves them: map.db may lag
    desk.now[1] = replace(desk.now[1], position_m=desk.now[1].position_m + 0.008)
    folder = desk.save()
    before = (folder / "map.json").read_text().splitlines()
    undo_edit(folder, 1)
    after = (folder / "map.json").read_text().splitlines()
    assert [line for line in before if '"id": 1,' not in line] == [line for line in after if '"id": 1,' not in line]
    assert rows_of(folder / "map.db")[1].position_m == pytest.approx(rows_of(folder)[1].position_m, abs=1e-9)


def test_the_abstract_map_stays(desk):
    desk.relabel(1)
    folder = desk.save()
    Map.load(folder).with_abstract(AbstractMap((), embedder="minilm")).save(folder)
    undo_edit(folder, 1)
    assert Map.load(folder).abstract.embedder == "minilm"


def test_an_undo_is_an_edit_itself_and_is_not_undone(desk):
    desk.relabel(1)
    desk.remove(2)
    folder = desk.save()
    undo_edit(folder, 1)
    undo_edit(folder, 2)
    edits = read_edits(folder)
    assert [(edit.kind, edit.other_id) for edit in edits] == [("relabel", None), ("remove", None), ("undo", 1), ("undo", 2)]
    assert undone_by(edits) == {1: 3, 2: 4}
    with pytest.raises(MapError, match="edit 1 was undone already, by edit 3"):
        undo_edit(folder, 1)
    with pytest.raises(MapError, match="edit 3 is itself an undo, of edit 1"):
        undo_edit(folder, 3)


def test_a_later_edit_stands_in_the_way_until_it_is_undone(desk):
    first = desk.now[1]
    desk.relabel(1)
    desk.relabel(0)
    desk.relabel(1, label="left green boot")
    desk.merge(3, 1)
    folder = desk.save()
    before = (folder / "map.db").read_bytes(), (folder / "map.json").read_bytes()
    with pytest.raises(MapError, match="edit 1 cannot be undone while edit 3 stands, the relabel of landmark 1 after it; undo 3 first"):
        undo_edit(folder, 1)
    with pytest.raises(MapError, match=r"edit 3 .* while edit 4 stands, the merge of landmark 3 into 1"):
        undo_edit(folder, 3)
    assert before == ((folder / "map.db").read_bytes(), (folder / "map.json").read_bytes())
    for number in (4, 3, 1):
        undo_edit(folder, number)
        require_agreement(folder)
    assert words(rows_of(folder)[1]) == words(first)
    assert rows_of(folder)[0].label == "green hiking boot"


def test_two_merges_into_one_at_the_same_keyframe_are_undone_newest_first(desk):
    desk.merge(3, 1)
    desk.merge(2, 1)
    folder = desk.save()
    with pytest.raises(MapError, match="edit 2 stands"):
        undo_edit(folder, 1)
    undo_edit(folder, 2)
    undo_edit(folder, 1)
    require_agreement(folder)
    assert sorted(rows_of(folder)) == [0, 1, 2, 3]
    assert [row.observations for row in rows_of(folder).values()] == [4] * 4


@pytest.mark.parametrize("kind", ["relabel", "merge"])
def test_a_landmark_that_left_the_map_stands_in_the_way(desk, kind):
    desk.relabel(1) if kind == "relabel" else desk.merge(3, 1)
    desk.see(0, events=[MapEvent("merged", 1, "cup", other_id=0)], removed=(1,))
    folder = desk.save()
    with pytest.raises(MapError, match="landmark 1 left the map since: merged into 0 at keyframe 1, by pipeline"):
        undo_edit(folder, 1)


def test_a_merge_that_went_on_is_not_undone(desk):
    desk.merge(3, 1)
    desk.see(1, events=[MapEvent("merged", 2, "cup", other_id=1)], removed=(2,))
    folder = desk.save()
    with pytest.raises(MapError, match="landmark 2 was merged into 1, too, at keyframe 1"):
        undo_edit(folder, 1)


def test_a_merged_landmark_that_moved_is_not_split(desk):
    desk.merge(3, 1)
    desk.see(1, events=[MapEvent("moved", 1, "1.2 m", other_id=9)])
    folder = desk.save()
    with pytest.raises(MapError, match="landmark 1 moved since, at keyframe 1"):
        undo_edit(folder, 1)


def test_what_cannot_be_undone_is_said(desk):
    desk.change(make_edit("confirm", 1, detail="cup"))
    desk.change(make_edit("remove", 2, outcome="refused", detail="one voice only"))
    desk.change(make_edit("relabel", 1))  # without what was before
    folder = desk.save()
    before = (folder / "map.db").read_bytes()
    for number, said in (
        (0, "no edit 0; edits 1 to 3 are kept"),
        (4, "no edit 4"),
        (-1, "no edit -1"),
        (1, r"edit 1 \(confirm of landmark 1, applied\) changed nothing"),
        (2, r"edit 2 \(remove of landmark 2, refused\) changed nothing"),
        (3, "what was before it was not kept"),
    ):
        with pytest.raises(MapError, match=said):
            undo_edit(folder, number)
    assert (folder / "map.db").read_bytes() == before


def test_a_map_without_edits_and_a_folder_without_store(desk, tmp_path):
    folder = desk.save()
    with pytest.raises(MapError, match="no edit 1; no edit is kept"):
        undo_edit(folder, 1)
    alone = tmp_path / "alone"
    Map([make_landmark(1)]).save(alone)
    for call in (read_edits, lambda where: undo_edit(where, 1)):
        with pytest.raises(MapError, match=r"holds no map\.db, where edits are kept"):
            call(alone)
        with pytest.raises(MapError, match=r"holds no map\.db"):
            call(tmp_path / "nowhere")
    assert list(alone.iterdir()) == [alone / "map.json"]


def test_a_map_json_that_is_damaged_is_said_before_anything_changes(desk):
    desk.relabel(1)
    folder = desk.save()
    (folder / "map.json").write_text("{")
    with pytest.raises(MapFormatError, match=r"map\.json"):
        undo_edit(folder, 1)
    assert len(read_edits(folder)) == 1


def test_a_run_that_still_writes_is_left_alone(desk):
    desk.relabel(1)
    with pytest.raises(MapError, match="is in use; a run that is still writing it"):
        undo_edit(desk.folder, 1)
    assert len(desk.store.edits()) == 1


def test_a_killed_run_has_only_its_store(desk):
    desk.relabel(1)
    desk.store.close()
    undo_edit(desk.folder, 1)
    assert not (desk.folder / "map.json").exists()
    assert rows_of(desk.folder)[1].label == "cup"


def test_killed_between_the_two_files_it_is_finished_by_asking_again(desk, monkeypatch):
    desk.relabel(1)
    folder = desk.save()

    def killed(path, data):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("seo_slam.map.write_atomically", killed)
        with pytest.raises(KeyboardInterrupt):
            undo_edit(folder, 1)
    assert rows_of(folder / "map.json")[1].label == "green hiking boot"
    assert rows_of(folder / "map.db")[1].label == "cup"
    with pytest.raises(MapError, match="undone already, by edit 2"):
        undo_edit(folder, 1)
    require_agreement(folder)
    assert rows_of(folder / "map.json")[1].label == "cup"


def test_a_disk_that_is_full_changes_nothing(desk, monkeypatch):
    desk.relabel(1)
    folder = desk.save()
    before = (folder / "map.json").read_bytes()

    def full(store, amendment):
        raise MapError("disk full")

    monkeypatch.setattr(SqliteStore, "amend", full)
    with pytest.raises(MapError, match="disk full"):
        undo_edit(folder, 1)
    assert (folder / "map.json").read_bytes() == before
    assert len(read_edits(folder)) == 1


def test_hostile_labels_come_back_letter_by_letter(desk):
    nasty = "<b>'); DROP TABLE landmark; --</b>\x00\x1b[2J\u202e"
    desk.relabel(1, label=nasty, labels={nasty: 1.0})
    desk.relabel(1, label="shoe", labels={"shoe": 1.0})
    folder = desk.save()
    undo_edit(folder, 2)
    require_agreement(folder)
    assert rows_of(folder)[1].label == nasty


def test_the_paths_of_both_files_name_the_map_too(desk):
    desk.relabel(1)
    desk.relabel(0)
    folder = desk.save()
    assert len(read_edits(folder / "map.json")) == len(read_edits(folder / "map.db")) == 2
    undo_edit(folder / "map.json", 1)
    undo_edit(folder / "map.db", 2)
    require_agreement(folder)
    assert {row.label for row in rows_of(folder).values()} == {"cup"}


def result_of(**parts):
    with pipeline(count=12, **parts) as made:
        for frame in tiny_frames(12):
            made.step(frame)
        return made.result()


def test_a_run_goes_on_with_the_map_and_its_store(tmp_path):
    first = result_of(store=SqliteStore(tmp_path / "map.db"))
    cup, book = first.map.landmarks
    named = replace(cup, version=cup.version + 1, **BOOT)
    with SqliteStore(tmp_path / "map.db") as store:
        newest, known = int(store.keyframe_ids()[-1]), len(store.edits())
        edits = (make_edit(landmark_id=cup.id, before=(cup,)), make_edit("remove", book.id, before=(book,)))
        store.amend(Amendment(newest, (named,), (book.id,), (), edits))
    Map([named], first.map.gravity, first.map.embedder, first.map.next_id).save(tmp_path)
    undo_edit(tmp_path, known + 1)
    undo_edit(tmp_path, known + 2)
    require_agreement(tmp_path)
    old = Map.load(tmp_path)
    assert [row.label for row in old.landmarks] == [cup.label, book.label]
    again = result_of(map=old)
    assert [(row.id, row.label) for row in again.map.landmarks] == [(cup.id, cup.label), (book.id, book.label)]


def test_the_table_keeps_what_was_before_as_json(desk):
    desk.relabel(1)
    with sqlite3.connect(desk.folder / "map.db") as db:
        ((before,),) = db.execute("SELECT landmarks_before FROM edit").fetchall()
    db.close()
    (row,) = json.loads(before)
    assert (row["id"], row["label"], row["position_m"]) == (1, "cup", [0.5, 0.1, 1 / 3])
