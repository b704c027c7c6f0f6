import json

import numpy as np
import pytest
from agent_rows import Model, Passed, Played, Row, Stage, figures_of, play, use_of_limits
from agent_throughput import flight_rows, job_from, limit_rows, main, options, same_work, table_rows
from long_walk import LongWalk, looked_at, turning
from step_times import LEFT_OUT, Pace, Stepped, compared

from seo_slam.config import Config
from seo_slam.errors import SeoSlamError
from seo_slam.simulation.chat_answers import SimulatedChat
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.testing.chat_limits import Seen
from seo_slam.testing.chat_server import ChatServer

BASE = Config.from_dict({"embedder": {"name": "hashed"}, "agents": []})


class Here:
    """The simulated model in this process: what ``ModelProcess`` does, without a process."""

    def __init__(self, model):
        self.model = model
        self.servers = {}

    def serve(self, **options):
        server = ChatServer(self.model, **options).start()
        self.servers[server.base_url] = server
        return server.base_url

    def end(self, base_url):
        server = self.servers.pop(base_url)
        server.close()
        return server.requests


@pytest.fixture(scope="module")
def stage():
    walk = LongWalk(SimulatedDesk(seed=3, frames=10, width=96, height=72, level=0.3), 24)
    wanted = looked_at(walk, BASE)
    model = SimulatedChat(seed=3, look_alikes=walk.look_alikes)
    walk.show_only(model, wanted)
    return Stage(walk, walk.frames(wanted), Here(model), BASE, 0.1, patience_s=30.0)


def given(*words):
    return options().parse_args(words)


def seen(number, time_s, status=200, tokens=100):
    return Seen(number, time_s, "heavy", "verification", tokens, 0, status, 0.1)


def played(row, log, wall_s=60.0, done=((30.0, 10), (60.0, 40)), landmarks=40, edits=()):
    agents = {
        "landmarks_done": landmarks,
        "superseded": 1,
        "dropped": 0,
        "agents": [{"failed": 0}],
        "edits": list(edits),
        "age_s": {"p50": 2.0, "max": 5.0},
    }
    return Played(row, Passed(wall_s, 0.5, tuple(done)), agents, {"heavy": tuple(log)}, {"heavy": wall_s}, 7, 3)


def row(requests=None, tokens=None, in_flight=8):
    model = Model("heavy", 1.0, requests, tokens)
    return Row("row", model, model, in_flight)


def test_a_walk_turns_at_its_ends():
    assert turning(4, 11).tolist() == [0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2]


def test_a_long_walk_shows_the_same_pictures_at_new_times(stage):
    walk = stage.walk
    assert len(walk) == 24
    assert (np.diff(walk.trajectory.timestamps_s) > 0).all()
    np.testing.assert_array_equal(walk.trajectory.T_world_camera[2], walk.trajectory.T_world_camera[16])  # there, back, there again
    assert walk.rendered(2) is walk.rendered(16)


def test_a_row_is_played_over_sockets_and_counted(stage):
    model = Model("heavy", 0.05)
    one = play(stage, Row("async", model, model, 4))
    figures = figures_of([one], stage.scale)
    assert figures["questions"]["verification"] > 0
    assert figures["landmarks"] > 0
    assert figures["failed"] == 0
    assert sum(figures["questions"].values()) <= len(one.logs["heavy"])
    assert figures["verdicts"]["number"] > 0
    assert one.passed.seconds_to(1) is not None
    assert not stage.models.servers


def test_two_models_have_a_server_each(stage):
    light, heavy = Model("light", 0.02), Model("heavy", 0.05)
    one = play(stage, Row("two", light, heavy, 4))
    roles = {name: {request.role for request in log} for name, log in one.logs.items()}
    assert roles["light"] == {"verification"}
    assert "verification" not in roles["heavy"]
    assert roles["heavy"]


def test_figures_are_in_the_seconds_of_the_walk():
    edits = [{"outcome": "stale", "number": 1}, {"outcome": "noted", "number": 3}]
    figures = figures_of([played(row(), [seen(1, 0.0), seen(2, 1.0, status=429)], edits=edits)], 0.5)
    assert figures["landmarks_per_wall_s"] == pytest.approx(40 / 60, abs=1e-3)
    assert figures["landmarks_per_180_s"] == 60.0
    assert figures["seconds_per_landmark"] == 3.0
    assert figures["refused_429"] == 1
    assert figures["questions"] == {"verification": 1, "description": 0, "merging": 0}
    assert figures["verdicts"]["share_stale"] == 0.25
    assert figures["loop_behind_s"] == 1.0


def test_limits_are_judged_by_the_log_of_the_server():
    steady = [seen(k + 1, 0.5 * k) for k in range(120)]  # two a second for a minute
    use = use_of_limits(played(row(requests=120), steady), 1.0)
    assert use["requests"]["ratio"] == pytest.approx(1.0)
    assert use["requests"]["never_over"]
    assert "tokens" not in use
    slow = use_of_limits(played(row(tokens=24_000), steady), 1.0)
    assert slow["tokens"]["ratio"] == pytest.approx(0.5)
    burst = use_of_limits(played(row(requests=100), steady), 1.0)
    assert not burst["requests"]["never_over"]
    assert use_of_limits(played(row(requests=100), []), 1.0)["requests"]["ratio"] is None


def test_the_same_work_is_timed_on_both_sides():
    slow, fast = played(row(in_flight=1), [], done=((30.0, 5), (60.0, 10)), landmarks=10), played(row(), [])
    assert same_work(slow, fast, 0.5) == {"landmarks": 10, "sync_s": 120.0, "async_s": 60.0, "ratio": 2.0}
    assert Passed(60.0, 0.0, ((30.0, 10), (60.0, 40))).seconds_to(25) == 45.0
    assert Passed(60.0, 0.0, ((30.0, 10),)).seconds_to(11) is None


def test_step_times_are_compared_frame_by_frame():
    def steps(ms):
        return [Stepped(1e-3 * (10.0 if k % 2 else ms), bool(k % 2 == 0), {"agents": 1e-3}) for k in range(4 * LEFT_OUT)]

    found = compared({"on": steps(22.0), "off": steps(20.0)}, {"on": {}}, Pace(4 * LEFT_OUT, 6.0, 1.0, 8))
    assert found["keyframes"]["ratio"]["p50"] == pytest.approx(1.1)
    assert not found["keyframes"]["holds"]
    assert found["frames"] == 3 * LEFT_OUT
    assert found["keyframes_counted"] == 3 * LEFT_OUT // 2
    same = compared({"on": steps(20.0), "off": steps(20.0)}, {"on": {}}, Pace(4 * LEFT_OUT, 6.0, 1.0, 8))
    assert same["all_frames"]["holds"]
    assert same["agents_stage_ms"]["p50"] == 1.0


def test_rows_are_those_of_the_table():
    rows = table_rows(given("--latency", "3", "--light-latency", "1", "--in-flight", "5"))
    assert [len(one.models) for one in rows.values()] == [1, 2, 2]
    assert [one.in_flight for one in rows.values()] == [1, 1, 5]
    assert {model.requests for one in rows.values() for model in one.models} == {500}
    assert all(model.requests is None and model.tokens is None for one in flight_rows(given()).values() for model in one.models)
    by_requests, by_tokens = limit_rows(given("--bound-rpm", "90", "--bound-tpm", "7000")).values()
    assert (by_requests.others.requests, by_tokens.others.tokens) == (90, 7000)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--parts", "rows,speed"], "'speed', wanted some of rows"),
        (["--window", "0"], "--window: got 0"),
        (["--bound-tpm", "-1"], "--bound-tpm: got -1"),
        (["--room", "XL9"], "XL9"),
        (["--room", "SM1,LG1"], "wanted one room"),
        (["--meshes", "no/such/folder"], "no/such/folder"),
    ],
)
def test_a_wrong_option_is_told_before_anything_is_drawn(words, message):
    with pytest.raises(SeoSlamError, match=message):
        job_from(given(*words), "cache")


def test_the_command_line_ends_with_usage_on_a_wrong_option(capsys):
    with pytest.raises(SystemExit):
        main(["--parts", "speed"])
    assert "'speed'" in capsys.readouterr().err


def test_options_are_stated_as_json():
    job = job_from(given("--seed", "4", "--level", "0.5", "--parts", "rows, steps"), "cache")
    assert (job.seed, job.level, job.changes, job.cache) == (4, 0.5, False, "cache")
    json.dumps(Model("heavy", 1.0).as_dict())
