"""How long each stage of a frame takes."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np


class StageClock:
    """Seconds a stage, a frame at a time."""

    def __init__(self) -> None:
        """Start with nothing measured."""
        self._all: dict[str, list[float]] = {}
        self._frame: dict[str, float] = {}

    def start_frame(self) -> None:
        """Forget the seconds of the frame before."""
        self._frame = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what runs inside."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.add(name, time.perf_counter() - started)

    def add(self, name: str, seconds: float) -> None:
        """Count seconds that were measured elsewhere."""
        self._frame[name] = self._frame.get(name, 0.0) + seconds
        self._all.setdefault(name, []).append(seconds)

    def end_frame(self) -> dict[str, float]:
        """Return stage -> seconds of this frame."""
        return dict(self._frame)

    def summary(self) -> dict[str, dict[str, float]]:
        """Return stage -> number, p50, p95, max and total of its seconds."""
        out = {}
        for name, seconds in self._all.items():
            values = np.array(seconds)
            out[name] = {
                "number": len(values),
                "p50": float(np.median(values)),
                "p95": float(np.percentile(values, 95)),
                "max": float(values.max()),
                "total": float(values.sum()),
            }
        return out
