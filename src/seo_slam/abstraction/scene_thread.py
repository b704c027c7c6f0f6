"""The scene cloud beside the robot's loop: in a slow thread of its own (DualMap III-A4)."""

import logging
import os
import queue
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.abstraction.scene_cloud import SceneCloud, checked_pose, far_apart, way_cell
from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray
from seo_slam.settings.planning import LayoutSettings

_LOG = logging.getLogger(__name__)

THREAD_NAME = "seo_slam scene cloud"

_NICER = 10  # than the robot's loop
_CLOSING_S = 1.0
_LOOK_EVERY_S = 0.1  # whether it is to end


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    """A frame to look at, and where the camera was since the one before."""

    depth_m: NDArray[np.float32]
    camera: Camera
    T_world_camera: FloatArray
    key: int | None
    way: tuple[FloatArray, ...]


class SceneCloudThread:
    """A ``SceneCloud`` whose points are worked out in the background; with the mode "inline" at once, with the same result each time.

    ``add`` never waits: while the queue is full, frames are passed over and counted, and the next one is tried. What goes wrong in the
    thread is a warning (``take_warnings``); the frame is lost and nothing else. To be called from one thread, but for ``layout``.

    Attributes:
        passed_over: frames that should have been looked at while the queue was full.
    """

    def __init__(self, settings: LayoutSettings | None = None, cloud: SceneCloud | None = None) -> None:
        """Start the thread, unless the mode is "inline".

        Args:
            settings: of the cloud and of the thread.
            cloud: one of your own.
        """
        self.settings = settings or LayoutSettings()
        self.passed_over = 0
        self._cloud = SceneCloud(self.settings) if cloud is None else cloud
        self._at_cloud = threading.Lock()
        self._warnings: queue.Queue[str] = queue.Queue()
        self._jobs: queue.Queue[_Job] = queue.Queue(self.settings.queue)
        self._closing = threading.Event()
        self._looked_at: FloatArray | None = None
        self._way: dict[tuple[int, int], FloatArray] = {}  # since that look, by cell: a robot that stands still adds nothing
        self._thread: threading.Thread | None = None
        if self.settings.mode == "background":
            self._thread = threading.Thread(target=self._run, name=THREAD_NAME, daemon=True)
            self._thread.start()

    def add(self, depth_m: NDArray[np.float32], camera: Camera, T_world_camera: FloatArray, key: int | None = None) -> bool:
        """Hand in a frame; arguments and errors as of ``SceneCloud.add``. The image must not be written to afterwards.

        Returns:
            inline: whether it was kept. background: whether it moved enough to be looked at, and waits for that.
        """
        T = checked_pose(depth_m, camera, T_world_camera)
        if self._thread is None:
            with self._at_cloud:
                return self._cloud.add(depth_m, camera, T, key)
        if self._closing.is_set():
            return False
        if self._looked_at is None or far_apart(self._looked_at, T, self.settings):
            try:
                self._jobs.put_nowait(_Job(depth_m, camera, T, key, tuple(self._way.values())))
            except queue.Full:
                self.passed_over += 1
            else:
                self._looked_at, self._way = T, {}
                return True
        self._way.setdefault(way_cell(T), T)
        return False

    def drain(self, timeout_s: float | None = None) -> bool:
        """Wait until nothing waits any more; False if that took too long."""
        with self._jobs.all_tasks_done:
            return self._jobs.all_tasks_done.wait_for(lambda: not self._jobs.unfinished_tasks, timeout_s)

    def layout(self, poses: Mapping[int, FloatArray] | None = None, timeout_s: float = 10.0) -> Layout:
        """Return the layout of all frames handed in so far; see ``SceneCloud.layout``. Also after ``close``.

        Frames that still wait after ``timeout_s`` are not in it. What is left out of it is a warning.
        """
        self.drain(timeout_s)
        with self._at_cloud:
            for T in tuple(self._way.values()):
                self._cloud.note_way(T)
            return self._cloud.layout(poses, self._warnings.put)

    def take_warnings(self) -> tuple[str, ...]:
        """Return what went wrong since the last call, and forget it."""
        found = []
        with suppress(queue.Empty):
            while True:
                found.append(self._warnings.get_nowait())
        return tuple(found)

    def close(self, timeout_s: float = _CLOSING_S) -> bool:
        """End the thread; what still waits is dropped. True if it has ended in time. May be called twice."""
        self._closing.set()
        with suppress(queue.Empty):
            while True:
                self._jobs.get_nowait()
                self._jobs.task_done()
        if self._thread is None:
            return True
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _run(self) -> None:
        if sys.platform == "linux":  # where a priority can be that of one thread
            with suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICER)
        while not self._closing.is_set():
            try:
                job = self._jobs.get(timeout=_LOOK_EVERY_S)
            except queue.Empty:
                continue
            try:
                self._look_at(job)
            except Exception as error:  # noqa: BLE001  # whatever it is, the robot goes on
                _LOG.exception("scene cloud: a frame is lost")
                self._warnings.put(f"scene cloud: a frame is lost ({type(error).__name__}: {error})")
            finally:
                self._jobs.task_done()

    def _look_at(self, job: _Job) -> None:
        with self._at_cloud:
            for T in job.way:
                self._cloud.note_way(T)
            self._cloud.add(job.depth_m, job.camera, job.T_world_camera, job.key)
