"""What a whole run made."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from seo_slam.map import Map
from seo_slam.records import MapEvent, Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """What a run made.

    Attributes:
        map: the things.
        trajectory: a pose for every frame, as estimated at the end.
        frames, keyframes: how many.
        lost_frames: frames whose motion odometry could not measure.
        detections, observations: how many were made, and how many of them could be placed in 3D.
        warnings: message -> how often; those that differ in numbers only are one, told as that of the largest numbers.
        seconds: stage -> (number, p50, p95, max, total) of its seconds.
        events: (keyframe_id, event) in order.
        agents: how often agents were asked, with what result, and what became of their edits; empty without agents.
    """

    map: Map
    trajectory: Trajectory
    frames: int
    keyframes: int
    lost_frames: int
    detections: int
    observations: int
    warnings: Mapping[str, int]
    seconds: Mapping[str, Mapping[str, float]]
    events: tuple[tuple[int, MapEvent], ...]
    agents: Mapping[str, Any] = field(default_factory=dict)
