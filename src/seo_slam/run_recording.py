"""From a recording to a folder with a map, a trajectory and a report: what ``seo-slam run`` does, for library users."""

import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any

from seo_slam.backends.recorded_detector import DetectionRecorder
from seo_slam.errors import DatasetError
from seo_slam.pipeline import Pipeline
from seo_slam.records import StepResult
from seo_slam.report.crops import ReportRecorder
from seo_slam.report.html import write_report
from seo_slam.run_files import describe_run, write_result
from seo_slam.run_result import RunResult
from seo_slam.types import Frame


@dataclass(frozen=True, slots=True, eq=False)
class FinishedRun:
    """A run and what was written of it.

    Attributes:
        result: map, trajectory, counts.
        run: the content of run.json.
        complete: False if it was interrupted (Ctrl-C); the folder is valid for what was seen until then.
    """

    result: RunResult
    run: Mapping[str, Any]
    complete: bool


def run_recording(
    frames: Iterable[Frame],
    pipeline: Pipeline,
    folder: Path,
    *,
    dataset: str,
    config: Mapping[str, Any] | None = None,
    record_detections: str | Path | None = None,
    warnings: Iterable[str] = (),
    on_step: Callable[[StepResult], None] | None = None,
) -> FinishedRun:
    """Run a pipeline over frames and write the result folder; Ctrl-C, or an image that cannot be read, ends it early.

    The folder is valid then for what was seen until that frame.

    Args:
        frames: the recording.
        pipeline: composed; its store should write ``map.db`` into ``folder``. It is closed at the end.
        folder: from ``run_files.prepare_folder``.
        dataset: what is read, for people.
        config: settings to note in run.json; the pipeline's by default.
        record_detections: a JSON lines file to write all detections to.
        warnings: what is odd about the input, to stand among the result's warnings, each once.
        on_step: called after each frame, once its keyframe is committed.

    Raises:
        DatasetError: a frame could not be read; what was seen before it has been written.
    """
    seen = ReportRecorder()
    complete = True
    unreadable: DatasetError | None = None
    detections = DetectionRecorder(record_detections) if record_detections is not None else None
    with _interrupts_held() as interrupted, pipeline:
        try:
            for frame in _timed(frames, pipeline):
                step = pipeline.step(frame)
                if step.is_keyframe:
                    with pipeline.clock.stage("report"):
                        seen.observe(frame, step)
                if detections is not None and step.detections is not None:
                    detections.record(frame, step.detections)
                if on_step is not None:
                    on_step(step)
                if interrupted.is_set():
                    complete = False
                    break
        except KeyboardInterrupt:
            complete = False
        except DatasetError as error:
            complete, unreadable = False, error
        finally:
            if detections is not None:
                detections.close()
        with pipeline.clock.stage("drain"):  # every frame is mapped: the run is complete even if the waiting is interrupted
            seen.observe_edits(pipeline.drain(stop=interrupted) if complete else pipeline.poll())
        result = pipeline.result()
        result = replace(result, warnings={**dict.fromkeys(warnings, 1), **result.warnings})
        settings = pipeline.config.model_dump(mode="json") if config is None else config
        run = describe_run(result, dataset=dataset, config=settings, complete=complete)
        write_result(folder, result, run)
        write_report(folder / "report.html", map=result.map, trajectory=result.trajectory, recorder=seen, run=run)
    if unreadable is not None:
        raise unreadable
    return FinishedRun(result, run, complete)


@contextmanager
def _interrupts_held() -> Iterator[threading.Event]:
    """Keep Ctrl-C from cutting a frame, or a file, in two: the first one sets the event, a second one ends the run at once.

    Does nothing outside the main thread, or where the program has a handler of its own.
    """
    event = threading.Event()

    def hold(number: int, where: FrameType | None) -> None:
        if event.is_set():
            signal.default_int_handler(number, where)
        event.set()

    ours = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours:
        signal.signal(signal.SIGINT, hold)
    try:
        yield event
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _timed(frames: Iterable[Frame], pipeline: Pipeline) -> Iterator[Frame]:
    """Yield frames and count the seconds that reading each took."""
    source = iter(frames)
    while True:
        started = time.perf_counter()
        frame = next(source, None)
        if frame is None:
            return
        pipeline.clock.add("read", time.perf_counter() - started)
        yield frame
