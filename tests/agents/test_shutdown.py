"""Sixty-four questions hang; closing ends them within a second, and leaves neither a thread nor a socket."""

import asyncio
import gc
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import nullcontext
from pathlib import Path

import pytest
import wall_of_pictures as wall

from seo_slam.agents.description import DescriptionAgent
from seo_slam.agents.loop_thread import THREAD_NAME
from seo_slam.backends.openai_chat import OpenAIChat
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.map import Map
from seo_slam.run_recording import run_recording
from seo_slam.testing import ChatServer, Hang, scripted

HANGING = 64
FRAMES = 7
SOON_S = 60.0
BOUND_S = 1.0


class Stopped(Exception):  # noqa: N818  # stands for whatever ends a run
    """Raised by a test in the middle of a run."""


def ours():
    return [thread for thread in threading.enumerate() if thread.name == THREAD_NAME]


def sockets():
    """How many sockets this process holds."""
    links = [f"/proc/self/fd/{name}" for name in os.listdir("/proc/self/fd")]
    return sum("socket:" in _target(link) for link in links)


def _target(link):
    try:
        return os.readlink(link)
    except OSError:  # the descriptor of the listing itself
        return ""


@pytest.fixture
def hanging():
    """A server that never answers; afterwards nothing of ours is left."""
    before = threading.enumerate()
    with ChatServer(scripted(), faults=Hang()) as server:
        yield server
    gc.collect()
    left = [thread for thread in threading.enumerate() if thread not in before]
    for thread in left:  # one that looked up a name is told to end when the loop closes, and ends a moment later
        thread.join(SOON_S)
    assert [thread for thread in left if thread.is_alive()] == []


def describing(server, **options):
    chosen = {"reply_format": "json_schema", "timeout_s": 600.0, "deadline_s": 600.0, **options}
    return DescriptionAgent(OpenAIChat("m", server.base_url, **chosen))


def pipeline_over(server, mode="background", **options):
    return wall.pipeline(8, 8, [describing(server, **options)], mode=mode)


def drive(running, server, wanted=HANGING):
    """Map until so many questions hang."""
    for frame in wall.frames(FRAMES):
        running.step(frame)
    deadline = time.monotonic() + SOON_S
    while server.in_flight < wanted and time.monotonic() < deadline:
        time.sleep(0.01)
    assert server.in_flight == wanted


def closed_in_time(close):
    started = time.monotonic()
    close()
    took_s = time.monotonic() - started
    assert ours() == []
    assert took_s < BOUND_S, f"closing took {took_s:.2f} s"
    return took_s


def test_close(hanging, record_property):
    running = pipeline_over(hanging)
    before = sockets()
    drive(running, hanging)
    assert sockets() >= before + HANGING
    record_property("seconds", closed_in_time(running.close))
    running.close()  # again
    result = running.result()
    assert len(result.map.landmarks) == HANGING
    assert result.agents["agents"][0]["asked"] == HANGING
    assert result.agents["agents"][0]["answered"] == 0


def test_sockets_are_closed(hanging):
    running = pipeline_over(hanging)
    before = sockets()
    drive(running, hanging)
    running.close()
    deadline = time.monotonic() + SOON_S
    while sockets() > before and time.monotonic() < deadline:  # the server closes its own ends when it notices
        time.sleep(0.02)
    assert sockets() <= before
    assert hanging.in_flight == 0


def map_and_end(server, began, ends):
    with pipeline_over(server) as running:
        drive(running, server)
        began.append(time.monotonic())
        if ends is not None:
            raise ends


@pytest.mark.parametrize("ends", [None, Stopped, KeyboardInterrupt])
def test_with_however_the_block_ends(hanging, ends):
    began = []
    with pytest.raises(ends) if ends else nullcontext():
        map_and_end(hanging, began, ends)
    assert time.monotonic() - began[0] < BOUND_S
    assert ours() == []


def test_inside_a_running_event_loop(hanging):
    async def inside():
        with pipeline_over(hanging) as running:
            drive(running, hanging)
            await asyncio.sleep(0)
            return closed_in_time(running.close)

    asyncio.run(inside())
    assert ours() == []


def test_when_draining_takes_too_long(hanging):
    with pipeline_over(hanging) as running:
        drive(running, hanging)
        assert running.drain(0.05) == ()
        result = running.result()
        assert result.warnings == {"agents: no answer to 64 questions within 0.05 s of the last frame": 1}
        closed_in_time(running.close)
    assert len(result.map.landmarks) == HANGING


def test_an_event_ends_the_draining(hanging):
    with pipeline_over(hanging) as running:
        drive(running, hanging)
        stop = threading.Event()
        threading.Timer(0.1, stop.set).start()
        assert running.drain(600.0, stop) == ()
        assert running.result().warnings == {}
        closed_in_time(running.close)


def test_ctrl_c_ends_the_waiting_for_last_answers_and_the_result_is_whole(hanging, tmp_path):
    """All frames are mapped; the first Ctrl-C ends what is only waiting."""
    running = wall.pipeline(8, 8, [describing(hanging)], mode="background", store=SqliteStore(tmp_path / "map.db"), drain_s=600.0)
    helper = threading.Thread(target=interrupt_when_asked, args=(hanging, HANGING))
    helper.start()
    finished = run_recording(wall.frames(FRAMES), running, tmp_path, dataset="wall")
    helper.join()
    assert finished.complete
    assert len(Map.load(tmp_path).landmarks) == HANGING
    assert (tmp_path / "report.html").is_file()
    assert ours() == []


def interrupt_when_asked(server, questions):
    """Press Ctrl-C when so many questions hang, and a while has gone by."""
    deadline = time.monotonic() + SOON_S
    while server.in_flight < questions and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.5)
    os.kill(os.getpid(), signal.SIGINT)


def test_while_everybody_waits_for_the_probe(hanging):
    with pipeline_over(hanging, reply_format="auto") as running:
        drive(running, hanging, wanted=1)
        closed_in_time(running.close)


def test_while_everybody_waits_for_a_rate_limit(hanging):
    with pipeline_over(hanging, requests_per_minute=1) as running:
        drive(running, hanging, wanted=1)
        closed_in_time(running.close)


def test_with_a_name_that_is_looked_up(hanging):
    """Looking up a host's name takes a thread of the event loop's."""
    port = hanging.base_url.rpartition(":")[2]
    agent = DescriptionAgent(OpenAIChat("m", f"http://localhost:{port}", reply_format="json_schema", timeout_s=600.0, deadline_s=600.0))
    with wall.pipeline(8, 8, [agent], mode="background") as running:
        drive(running, hanging)
        closed_in_time(running.close)


def test_an_interrupt_ends_a_run_that_waits_for_an_answer(hanging):
    """Ctrl-C while the main thread waits: keyframes wait for their agents in this mode."""
    helper = threading.Thread(target=interrupt_when_asked, args=(hanging, 1))
    helper.start()
    with pytest.raises(KeyboardInterrupt), pipeline_over(hanging, mode="inline") as running:
        list(running.stream(wall.frames(FRAMES)))
    helper.join()
    assert ours() == []


PROGRAM = """
import sys
sys.path[:0] = {path!r}
import wall_of_pictures as wall
from seo_slam.agents.description import DescriptionAgent
from seo_slam.backends.openai_chat import OpenAIChat
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.map import Map
from seo_slam.run_recording import run_recording
agent = DescriptionAgent(OpenAIChat("m", {url!r}, reply_format="json_schema", timeout_s=600.0, deadline_s=600.0))
with wall.pipeline(8, 8, [agent], mode="background") as running:
    for frame in wall.frames({frames}):
        running.step(frame)
    print("mapped", flush=True)
    sys.stdin.readline()
    print(running.drain(600.0))
"""


def test_ctrl_c_ends_a_process_with_all_questions_out(hanging):
    here = Path(__file__).parent
    program = PROGRAM.format(path=[str(here), str(here.parent)], url=hanging.base_url, frames=FRAMES)
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == b"mapped\n"
        deadline = time.monotonic() + SOON_S
        while hanging.in_flight < HANGING and time.monotonic() < deadline:
            time.sleep(0.01)
        assert hanging.in_flight == HANGING
        process.stdin.write(b"drain\n")
        process.stdin.flush()
        time.sleep(0.3)  # it waits for answers now
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=SOON_S)
    assert b"KeyboardInterrupt" in error
    assert process.returncode == -signal.SIGINT
    assert b"never" not in error  # no coroutine was never awaited, no task exception never retrieved
