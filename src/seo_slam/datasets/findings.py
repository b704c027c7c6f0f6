"""What ``check_recording`` reports: findings, each with what to fix, and the figures behind them."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

Level = Literal["ok", "warning", "error"]


class Finding(BaseModel):
    """One thing that was looked at.

    Attributes:
        level: "ok", "warning" (a run works, the map may suffer) or "error" (a run will refuse, or the map will be wrong).
        topic: layout, camera, images, stamps, depth, alignment, poses.
        what: what was found.
        fix: what to do about it; "" where nothing needs doing.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    level: Level
    topic: str
    what: str
    fix: str = ""


class RecordingReport(BaseModel):
    """What a recording is, and whether it is sane.

    Attributes:
        path: its folder.
        kind: "tum", "folder", or "unknown".
        findings: in the order of looking.
        facts: figures by name, units in the name: frames, duration_s, rate_hz, median_depth_m, …
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    path: str
    kind: str
    findings: tuple[Finding, ...]
    facts: dict[str, float | int | str | None]

    @property
    def level(self) -> Level:
        """The worst level found."""
        levels = {finding.level for finding in self.findings}
        return "error" if "error" in levels else "warning" if "warning" in levels else "ok"


def ok(topic: str, what: str) -> Finding:
    """A finding that needs nothing."""
    return Finding(level="ok", topic=topic, what=what)


def warning(topic: str, what: str, fix: str) -> Finding:
    """A finding that a run survives."""
    return Finding(level="warning", topic=topic, what=what, fix=fix)


def error(topic: str, what: str, fix: str) -> Finding:
    """A finding that spoils a run."""
    return Finding(level="error", topic=topic, what=what, fix=fix)
