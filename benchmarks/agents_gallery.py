"""Draws the pictures of docs/agents-gallery.md: what each agent's model gets to see, from a simulated room and from a real recording.

python benchmarks/agents_gallery.py --meshes DIR --tum DIR --weights FILE [--out docs/images]

The pictures are those that would be sent; one that is too large for a page is compressed again. The question that goes with each is printed
as one JSON object.
"""

import argparse
import asyncio
import contextlib
import dataclasses
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from run_options import frozen_level

from seo_slam.agents.chat_agent import ChatAgent
from seo_slam.agents.description import DescriptionAgent
from seo_slam.agents.groups import near_pairs, nearby_group
from seo_slam.agents.merging import MergingAgent
from seo_slam.agents.verification import VerificationAgent
from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.config import Config
from seo_slam.datasets.open import open_dataset
from seo_slam.errors import ChatReplyError
from seo_slam.interfaces import Agent, AgentView, ChatReply, ChatRequest
from seo_slam.pipeline import Pipeline
from seo_slam.records import AgentRole
from seo_slam.simulation.rooms import SimulatedRoom
from seo_slam.types import Frame

MOST_BYTES = 150_000


class Watcher(Agent):
    """Keeps every view, and proposes nothing."""

    role: AgentRole = "any"

    def __init__(self) -> None:
        self.views: list[AgentView] = []

    def propose(self, view: AgentView) -> tuple[()]:
        """Keep it."""
        self.views.append(view)
        return ()


class Overheard:
    """A chat model that keeps what it is asked, and says nothing."""

    name = "nobody"

    def __init__(self) -> None:
        self.requests: list[ChatRequest] = []

    async def complete(self, request: ChatRequest) -> ChatReply:
        """Keep the question."""
        self.requests.append(request)
        raise ChatReplyError("nothing to say")


def main() -> None:
    """Run both recordings and write the pictures."""
    given = _arguments()
    room = SimulatedRoom("MD1", 0, frozen_level(), given.meshes, 200, 320, 240)
    parts = {"detector": room.detector, "odometry": RecordedOdometry(room.odometry)}
    told = {"room": gallery("room", views_of(room, Config(), parts), given.out)}
    config = Config.from_dict({"detector": {"name": "yolox", "options": {"weights": str(given.weights), "score": 0.3}}}, "gallery")
    recording = open_dataset("auto", given.tum)
    parts = {"odometry": RecordedOdometry(recording.trajectory)}
    told["tum"] = gallery("tum", views_of(recording, config, parts), given.out)
    print(json.dumps(told, indent=1, ensure_ascii=False))


def views_of(frames: Iterable[Frame], config: Config, parts: dict[str, Any]) -> list[AgentView]:
    """Return what agents are shown during a run, views with at least one box."""
    watcher = Watcher()
    with Pipeline(config.updated({"runner": {"view_period_s": 0.0}}, "gallery"), agents=[watcher], **parts) as pipeline:
        for frame in frames:
            pipeline.step(frame)
    return [view for view in watcher.views if view.boxes_px]


def gallery(name: str, views: list[AgentView], folder: Path) -> dict[str, Any]:
    """Write the pictures of one recording; returns the questions."""
    told = {}
    for kind, agent, best in (
        ("verification", VerificationAgent, _for_verification),
        ("description", DescriptionAgent, _for_description),
        ("merging", MergingAgent, _for_merging),
    ):
        view = max((shown for view in views for shown in best(view)), key=lambda scored: scored[0], default=None)
        if view is None:
            raise SystemExit(f"{name}: nothing to show for {kind}")
        told[kind] = _write(f"agents_{name}_{kind}", agent, view[1], folder)
    return told


def _for_verification(view: AgentView) -> Iterable[tuple[float, AgentView]]:
    sides = _sides(view)
    ids = sorted(sides, key=lambda i: -sides[i])[:4]
    yield (len(ids), min(sides[i] for i in ids)), _asked(view, ids)


def _for_description(view: AgentView) -> Iterable[tuple[float, AgentView]]:
    for landmark_id, side in _sides(view).items():
        yield -abs(side - 0.1 * view.frame.camera.width), _asked(view, [landmark_id])  # neither easy nor hopeless


def _for_merging(view: AgentView) -> Iterable[tuple[float, AgentView]]:
    for first, _ in near_pairs(list(view.boxes_px), view):
        ids = nearby_group(first, list(view.boxes_px), view, 8)
        yield (len(ids), len(near_pairs(ids, view))), _asked(view, ids)


def _sides(view: AgentView) -> dict[int, float]:
    return {i: float((box[2:] - box[:2]).max()) for i, box in view.boxes_px.items()}


def _asked(view: AgentView, ids: Iterable[int]) -> AgentView:
    return dataclasses.replace(view, asked=tuple(ids), known_labels=("red running shoe", "green bottle"))


def _write(name: str, agent: Callable[..., ChatAgent], view: AgentView, folder: Path) -> dict[str, Any]:
    chat = Overheard()
    with contextlib.suppress(ChatReplyError):
        asyncio.run(agent(chat).propose(view))
    request = chat.requests[0]
    for number, image in enumerate(request.images, start=1):
        (folder / f"{name}_{number}.jpg").write_bytes(_for_a_page(image))
    return {"question": request.text, "timestamp_s": view.frame.timestamp_s, "bytes": [len(image) for image in request.images]}


def _for_a_page(jpeg: bytes) -> bytes:
    quality = 90
    pixels = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    while len(jpeg) > MOST_BYTES:
        quality -= 5
        jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    return jpeg


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", required=True, metavar="DIR", help="folder of meshes")
    parser.add_argument("--tum", required=True, metavar="DIR", help="TUM fr1/xyz")
    parser.add_argument("--weights", required=True, metavar="FILE", type=Path, help="YOLOX-nano, ONNX")
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("docs/images"))
    return parser.parse_args()


if __name__ == "__main__":
    main()
