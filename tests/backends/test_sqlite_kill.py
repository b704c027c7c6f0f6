"""``kill -9`` at random moments: no keyframe that was told committed is lost, and none is there in part."""

import sqlite3
import subprocess
import sys
import time

import numpy as np
import pytest

from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.map import Map

_WRITER = """
import sys
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.records import MapEvent
from seo_slam.testing.store import make_landmark, make_record

print("ready", flush=True)
with SqliteStore(sys.argv[1]) as store:
    k = 0 if not len(store.keyframe_ids()) else int(store.keyframe_ids()[-1]) + 1
    while True:
        landmarks = tuple(make_landmark((k + i) % 12, (float(k), float(i), 0.0), version=k) for i in range(3))
        events = (MapEvent("created", k % 12), MapEvent("confirmed", k % 12))
        store.commit(make_record(k, (0, 1, 2, 3), landmarks, ((k + 5) % 12,), events))
        print(k, flush=True)
        k += 1
"""

_KILLS = 20
_RUNS_CONTINUED = 4


def run_and_kill(path, delay_s, after_first=False, script=_WRITER):
    """Ids that the writer told before it was killed, ``delay_s`` after it was up or after its first commit."""
    command = [sys.executable, "-c", script, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0) as process:
        assert process.stdout.readline() == b"ready\n", process.stderr.read().decode()
        first = process.stdout.readline() if after_first else b""
        time.sleep(delay_s)
        process.kill()
        rest, faults = process.communicate(timeout=30)
    assert faults == b""
    return [int(line) for line in (first + rest).split(b"\n")[:-1]]


@pytest.mark.parametrize("group", range(_KILLS // _RUNS_CONTINUED))
def test_nothing_told_committed_is_lost(tmp_path, group):
    rng = np.random.default_rng(group)
    path = tmp_path / "map.db"
    told = []
    for run in range(_RUNS_CONTINUED):  # each continues the file that the kill before left behind, or did not come to make
        told += run_and_kill(path, float(rng.uniform(0.0, 0.15)), after_first=run > 0)
        if told:
            require_whole(path, told)
    assert len(told) >= _RUNS_CONTINUED - 1


def require_whole(path, told):
    db = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
    assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    db.close()
    with SqliteStore(path, read_only=True) as store:
        kept = store.keyframe_ids().tolist()
        assert set(told) <= set(kept)
        assert kept == list(range(len(kept)))
        assert len(kept) <= len(told) + _RUNS_CONTINUED  # one at most a run was committed and not yet told
        for k in {*kept[:2], *kept[-3:], kept[len(kept) // 2]}:
            record = store.keyframe(k)
            assert (len(record.observations), len(record.landmarks), len(record.events)) == (4, 3, 2)
            assert record.removed_ids == ((k + 5) % 12,)
        newest = kept[-1]
        assert {(newest + i) % 12 for i in range(3)} <= {row.id for row in store.landmarks()}
        assert store.near(np.array([newest, 0.0, 0.0]), 0.0) == (newest % 12,)
    assert len(Map.load(path)) == len(Map.load(path.parent)) > 0


def test_partial_keyframes_would_be_seen(tmp_path):
    path = tmp_path / "map.db"
    told = run_and_kill(path, 0.05, after_first=True)
    db = sqlite3.connect(path)
    with db:
        db.execute("DELETE FROM observation WHERE keyframe_id = (SELECT max(id) FROM keyframe) AND row = 0")
    db.close()
    with pytest.raises(AssertionError):
        require_whole(path, told)


_AMENDER = """
import sys
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.records import Amendment, MapEvent
from seo_slam.testing.store import make_edit, make_landmark, make_record

print("ready", flush=True)
with SqliteStore(sys.argv[1]) as store:
    store.commit(make_record(0, (1,), (make_landmark(1), make_landmark(2))))
    n = 0
    while True:
        row = make_landmark(1, (float(n), 0.0, 0.0), version=n)
        gone, back = ((2,), (row,)) if n % 2 == 0 else ((), (row, make_landmark(2)))
        edit = make_edit(before=(make_landmark(1, version=n - 1),), detail=str(n))
        store.amend(Amendment(0, back, gone, (MapEvent("relabelled", 1, str(n)),), (edit,)))
        print(n, flush=True)
        n += 1
"""


@pytest.mark.parametrize("delay_s", [0.0, 0.03, 0.11])
def test_an_amendment_is_there_wholly_or_not_at_all(tmp_path, delay_s):
    path = tmp_path / "map.db"
    told = run_and_kill(path, delay_s, after_first=True, script=_AMENDER)
    with SqliteStore(path) as store:
        edits = store.edits()
        assert [edit.detail for edit in edits] == [str(n) for n in range(len(edits))]
        assert len(told) <= len(edits) <= len(told) + 1
        newest = len(edits) - 1
        assert [row.version for row in store.landmarks() if row.id == 1] == [newest]
        assert (2 in {row.id for row in store.landmarks()}) == (newest % 2 == 1)
        assert len(store.history(1)) == len(edits)
        assert [len(edit.before) for edit in edits] == [1] * len(edits)
