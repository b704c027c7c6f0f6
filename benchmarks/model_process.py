"""Simulated models behind HTTP, in a process of their own: what they do to think takes nothing from the robot's process."""

import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

from long_walk import looked_at, walk_of
from simulated_runs import Job

from seo_slam.config import Config
from seo_slam.simulation.chat_answers import ACCURACY, SimulatedChat
from seo_slam.testing.chat_limits import Seen
from seo_slam.testing.chat_server import ChatServer

START_S = 600.0
"""All frames are drawn before the first question."""


class ModelProcess:
    """Starts and ends chat servers there. All of them are answered by one simulated model that has seen the walk."""

    def __init__(self, connection: Connection) -> None:
        """Talk to the process over a pipe."""
        self._connection = connection

    def serve(self, **options: Any) -> str:
        """Start a ``ChatServer`` with these options; return its ``base_url``."""
        return str(self._asked(("serve", options)))

    def end(self, base_url: str) -> tuple[Seen, ...]:
        """End a server; return its log."""
        seen: tuple[Seen, ...] = self._asked(("end", base_url))
        return seen

    def _asked(self, message: tuple[str, Any]) -> Any:
        self._connection.send(message)
        return self._connection.recv()


@contextmanager
def model_process(job: Job, frames: int, config: Config) -> Iterator[ModelProcess]:
    """Run the simulated model of a job for the keyframes of a walk of so many frames.

    Raises:
        RuntimeError: the process did not come up.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, job, frames, config), name="simulated models", daemon=True)
    process.start()
    there.close()
    try:
        if not here.poll(START_S) or here.recv() != "ready":
            raise RuntimeError("the process of the simulated models did not come up")
        yield ModelProcess(here)
        here.send(("stop", None))
    finally:
        process.join(5.0)
        process.kill()
        process.join()


def _serve(connection: Connection, job: Job, frames: int, config: Config) -> None:
    walk = walk_of(job, frames)
    given = ACCURACY if job.models.accuracy is None else job.models.accuracy
    model = SimulatedChat(given, sticky=job.models.sticky, seed=job.seed, look_alikes=walk.look_alikes)
    walk.show_only(model, looked_at(walk, config))
    connection.send("ready")
    servers: dict[str, ChatServer] = {}
    while True:
        what, given_with_it = connection.recv()
        if what == "stop":
            break
        if what == "serve":
            server = ChatServer(model, **given_with_it).start()
            servers[server.base_url] = server
            connection.send(server.base_url)
        else:
            server = servers.pop(given_with_it)
            server.close()
            connection.send(server.requests)
