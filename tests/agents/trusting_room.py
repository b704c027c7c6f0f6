"""A tiny room whose map agents may mend: a cup and a book that are right, a vase that is a jug, and a box found as two halves.

Twelve frames, six keyframes, a fraction of a second; the pipeline and the agents are the real ones.
"""

import asyncio
import time
from dataclasses import dataclass
from functools import cache

import numpy as np

import tiny_run
from seo_slam.agents.description import DescriptionAgent
from seo_slam.agents.merging import MergingAgent
from seo_slam.agents.verification import VerificationAgent
from seo_slam.backends.openai_chat import OpenAIChat
from seo_slam.geometry import inverse, transform_points
from seo_slam.pipeline import RunResult
from seo_slam.records import StepResult
from seo_slam.testing import ChatServer, scripted
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_trajectory
from seo_slam.types import Detections

FRAMES = 12
PATIENT = {"timeout_s": 10.0, "deadline_s": 15.0, "reply_format": "json_schema"}
"""Options of the chat models: patience enough for a busy machine."""

# low and high corner of what is detected, in the first camera's frame; the two last lie on one block and are never found at once
PLACES = {
    "cup": ((-0.5, -0.2, 1.4), (-0.1, 0.3, 1.4)),
    "vase": ((-0.35, -0.65, 2.0), (-0.05, -0.35, 2.0)),
    "book": ((0.2, -0.3, 1.6), (0.5, 0.1, 1.6)),
    "carton": ((0.3, -0.3, 1.6), (0.6, 0.1, 1.6)),
}
TURNS = {"book": 0, "carton": 1}


@cache
def frames():
    return tuple(tiny_run.frames(FRAMES))


class RoomDetector:
    """Returns the box of each place as projected from the true pose, clipped to the image; of the box, one half at a time."""

    def __init__(self):
        self.poses = tiny_trajectory(FRAMES)

    def detect(self, frame):
        boxes, labels = [], []
        for label, ((x0, y0, z), (x1, y1, _)) in PLACES.items():
            if label in TURNS and (frame.index // 2) % 2 != TURNS[label]:
                continue
            corners = np.array([[x, y, z] for x in (x0, x1) for y in (y0, y1)])
            uv = frame.camera.project(transform_points(inverse(self.poses[frame.index]) @ T_WORLD_FIRST, corners))
            box = np.clip(np.concatenate([uv.min(axis=0), uv.max(axis=0)]), 0, [frame.camera.width, frame.camera.height] * 2)
            if (box[2:] - box[:2] > 8).all():
                boxes.append(box)
                labels.append(label)
        return Detections(np.array(boxes).reshape(-1, 4), tuple(labels), np.full(len(labels), 0.9))


class ShortNights:
    """A clock that goes on by as long as somebody sleeps, so that nobody has to wait."""

    def __init__(self):
        self.slept_s = 0.0

    def now(self):
        return time.monotonic() + self.slept_s

    async def sleep(self, seconds):
        self.slept_s += seconds
        await asyncio.sleep(0)


ROLES = {"verification": VerificationAgent, "description": DescriptionAgent, "merging": MergingAgent}


def agents(base_url, options=(), hasty=None):
    """The three, each asking a model of its own; the one of the role ``hasty`` has no patience with it."""
    nights = ShortNights()
    chosen = {**PATIENT, "clock": nights.now, "sleep": nights.sleep, **dict(options)}
    soon = {"timeout_s": 0.15, "deadline_s": 0.2}
    return [agent(OpenAIChat(f"{role} model", base_url, **{**chosen, **(soon if role == hasty else {})})) for role, agent in ROLES.items()]


CUP, VASE, BOOK, CARTON = range(4)
"""Ids of the four, in the order they are found."""


def _verify(question):
    said = [{"box": box.number, "object": box.label, "score": 0.0 if box.label == "vase" else 1.0} for box in question.boxes]
    return {"verdicts": said}


def _describe(question):
    label = question.boxes[0].label
    category = "jug" if label in ("vase", "green jug") else label
    return {"matched_label": "N/A", "generated_label": "green jug" if category == "jug" else label, "category": category}


def _merge(question):
    number = {box.label: box.number for box in question.boxes}
    both = {"book", "carton"} <= number.keys()
    return {"duplicates": [{"boxes": [number["book"], number["carton"]], "best": number["book"]}] if both else []}


RIGHT_ANSWERS = scripted(verification=_verify, description=_describe, merging=_merge)
"""What a model says that sees everything as it is."""

CALM = scripted()
"""What changes nothing."""


@dataclass(frozen=True)
class Ran:
    result: RunResult
    steps: list[StepResult]
    server: ChatServer


def pipeline(mode="inline", parts=(), **settings):
    """A pipeline over ``frames()``; without agents unless given some."""
    config = {"runner": {"view_period_s": 0.0, "mode": mode}, **settings}
    return tiny_run.pipeline(FRAMES, config, **{"detector": RoomDetector(), **dict(parts)})


def plain_run():
    with pipeline() as running:
        list(running.stream(frames()))
        return running.result()


def run_with(answers, faults=(), mode="inline", shown=None, options=(), hasty=None, parts=(), settings=(), **server):
    """Map the room with agents that ask a chat server; ``shown`` are other frames, ``options`` those of the chat models."""
    with (
        ChatServer(answers, faults=faults, **server) as serving,
        pipeline(mode, {**dict(parts), "agents": agents(serving.base_url, options, hasty)}, **dict(settings)) as running,
    ):
        steps = []
        for step in running.stream(frames() if shown is None else shown):
            steps.append(step)
            if mode == "background":
                running.drain(60.0)  # or the tiny run would be over before the first answer
        running.drain(60.0)
        return Ran(running.result(), steps, serving)
