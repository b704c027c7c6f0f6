"""What of edits goes into the store, with keyframes and between them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_map import AT, SmallMap

from seo_slam.backends.memory_store import MemoryStore
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.keeping import LONGEST_TEXT, Keeper
from seo_slam.mapping.edits import apply_edit
from seo_slam.records import MapEvent, Merge, Relabel, Remove
from seo_slam.testing.store import make_edit
from seo_slam.types import Estimate, Observations


class Words:
    def embed_text(self, texts):
        return np.eye(8)[: len(texts)]


class KeptDesk:
    """Two things in a small map, and a keeper that has committed keyframe 0."""

    def __init__(self, store):
        self.desk = SmallMap()
        self.desk.see({None: (AT, "cup")})
        self.desk.see({0: (AT, "cup"), None: (AT + np.array([0.0, 0.0, 0.05]), "mug")})
        self.store = store
        self.keeper = Keeper(SimpleNamespace(store=store, smoother=self.desk.smoother), self.desk.objects)
        self.keep(0)

    def keep(self, keyframe_id, events=(), edits=()):
        estimate = Estimate(self.desk.T, lambda ids: np.eye(6 + 3 * len(ids)))
        self.keeper.keep(keyframe_id, 0.5 * keyframe_id, estimate, None, Observations.empty(8), np.zeros(0, dtype=np.int64), events, edits)

    def apply(self, edit):
        return apply_edit(edit, self.desk.objects, self.desk.smoother, Words())

    def version(self, landmark_id):
        return self.desk.objects[landmark_id].version


@pytest.fixture(params=["memory", "sqlite"])
def kept(request, tmp_path):
    with MemoryStore() if request.param == "memory" else SqliteStore(tmp_path / "map.db") as store:
        yield KeptDesk(store)


def test_an_edit_between_keyframes_is_in_the_store_at_once(kept):
    event = kept.apply(Relabel(0, kept.version(0), "green hiking boot", category="shoe"))
    kept.keeper.amend(0, [event], [make_edit(landmark_id=0)])
    assert [(row.label, row.category) for row in kept.store.landmarks()] == [("green hiking boot", "shoe"), ("mug", "")]
    assert [edit.detail for edit in kept.store.edits()] == ["cup -> chipped white mug"]
    assert kept.store.history(0)[-1][1] == "relabelled"


def test_what_an_edit_took_out_of_the_map_leaves_the_store(kept):
    merged = kept.apply(Merge(0, kept.version(0), 1, kept.version(1)))
    kept.keeper.amend(0, [merged], [make_edit("merge", 1, 0)])
    assert [row.id for row in kept.store.landmarks()] == [0]
    kept.keep(1, [kept.apply(Remove(0, kept.version(0)))], [make_edit("remove", 0, keyframe_id=1)])
    assert kept.store.landmarks() == ()
    assert [edit.kind for edit in kept.store.edits()] == ["merge", "remove"]
    assert [edit.kind for edit in kept.store.keyframe(1).edits] == ["remove"]


def test_nothing_is_remembered_of_what_left_the_map(kept):
    kept.keeper.amend(0, [kept.apply(Merge(0, kept.version(0), 1, kept.version(1)))], ())
    assert [list(known) for known in (kept.keeper._kept_at, kept.keeper._covariance_of)] == [[0], [0]]
    kept.keep(1, [kept.apply(Remove(0, kept.version(0)))])
    assert [list(known) for known in (kept.keeper._kept_at, kept.keeper._covariance_of)] == [[], []]


def test_nothing_that_an_agent_says_keeps_a_keyframe_from_being_kept(kept):
    hostile = replace(
        make_edit(landmark_id=2**70, other_id=-(2**90), outcome="refused", detail="x" * 10_000_000),
        agent="half \ud800 a pair",
        model="\x00\x1b[31m",
        prompt_hash="'); DROP TABLE edit; --",
    )
    kept.keep(1, (), [hostile, replace(hostile, landmark_id="all of them")])
    kept.keeper.amend(1, (), [hostile])
    assert kept.store.keyframe_ids().tolist() == [0, 1]
    for edit in kept.store.edits():
        assert (edit.landmark_id, edit.other_id, len(edit.detail)) == (-1, -1, LONGEST_TEXT)
        assert (edit.agent, edit.model, edit.prompt_hash) == ("half \\ud800 a pair", "\x00\x1b[31m", "'); DROP TABLE edit; --")
    assert kept.store.next_id() == 2


@pytest.mark.parametrize("source", ["\ud800", object()], ids=["half a surrogate pair", "no text"])
def test_nothing_that_an_event_holds_keeps_a_keyframe_from_being_kept(kept, source):
    odd = MapEvent("confirmed", 0, "x" * 10_000_000, source)
    kept.keep(1, [odd])
    kept.keeper.amend(1, [odd], ())
    assert kept.store.keyframe_ids().tolist() == [0, 1]
    written = [(detail, source) for _, kind, detail, source in kept.store.history(0) if kind == "confirmed"]
    assert [len(detail) for detail, _ in written] == [LONGEST_TEXT] * 2
    assert all(text == str(source).encode("utf-8", "backslashreplace").decode() for _, text in written)
