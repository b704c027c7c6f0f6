"""``kill -9`` at 20 random moments of a real run: every ``map.db`` opens and holds each keyframe that was told."""

import sqlite3
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.map import Map

KILLS = 20
AT_ONCE = 2
LONGEST_S = 1.5


def killed(recording, detections_file, out, delay_s):
    """Run, kill ``delay_s`` after the first keyframe was told, and return the keyframes told."""
    arguments = ["run", "tum", recording, "--out", out, "--detector", "recorded", "--detections", detections_file]
    arguments += ["--set", "embedder.name=hashed", "--set", "keyframes.period_s=0.1", "--print-keyframes"]
    command = [sys.executable, "-c", "from seo_slam.cli.app import main; main()", *(str(a) for a in arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0) as process:
        first = process.stdout.readline()
        time.sleep(delay_s)
        process.kill()
        rest, faults = process.communicate(timeout=60)
    assert faults == b""
    lines = (first + rest).decode().split("\n")[:-1]  # the last line may be cut
    return [int(line.removeprefix("keyframe ")) for line in lines]


@pytest.fixture(scope="module")
def runs(shared, detections_file, tmp_path_factory):
    """20 killed runs, each in a folder of its own: folder and keyframes told."""
    rng = np.random.default_rng(0)
    folders = [tmp_path_factory.mktemp("killed") / "out" for _ in range(KILLS)]
    delays = rng.uniform(0.0, LONGEST_S, KILLS)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        told = pool.map(lambda one: killed(shared / "data/tum_fr1_xyz", detections_file, *one), zip(folders, delays, strict=True))
        return list(zip(folders, told, strict=True))


def test_every_map_opens_and_holds_what_was_told(runs):
    for folder, told in runs:
        db = sqlite3.connect(f"file:{folder / 'map.db'}?mode=ro", uri=True)
        assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        db.close()
        with SqliteStore(folder / "map.db", read_only=True) as store:
            kept = store.keyframe_ids().tolist()
            assert told == list(range(len(told)))
            assert kept == list(range(len(kept)))
            assert len(told) <= len(kept) <= len(told) + 1  # one at most was committed and not told yet
            for keyframe_id in {0, kept[len(kept) // 2], kept[-1]}:
                record = store.keyframe(keyframe_id)
                assert len(record.observations) == len(record.landmark_ids)


def test_every_map_loads_as_it_was(runs):
    for folder, told in runs:
        found = Map.load(folder)  # of the folder: there is no map.json
        assert not (folder / "map.json").exists()
        assert len(found.landmarks) + len(found.tentative) > 0
        assert found.gravity == "poses"
        if 8 < len(told) <= 20:  # the detections end at frame 60; what is not detected any more is lost
            assert {"keyboard", "tv"} <= {row.category or row.label for row in found.landmarks}


def test_the_kills_came_at_different_moments(runs):
    assert len({len(told) for _, told in runs}) >= 5
