"""Contract of an ``Agent``."""

import inspect
from collections.abc import Awaitable, Sequence
from typing import Any

import numpy as np

from seo_slam.agents.loop_thread import LoopThread
from seo_slam.errors import AgentError
from seo_slam.interfaces import Agent, AgentView
from seo_slam.records import Confirm, Doubt, Edit, Merge, Relabel, Remove
from seo_slam.testing.clauses import require
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_boxes, tiny_frames, tiny_landmarks
from seo_slam.types import Landmarks


def check_agent(agent: Agent) -> None:
    """Check that an agent proposes edits only of what it was shown, in the versions it was shown. It may abstain or raise ``AgentError``.

    Raises:
        AssertionError: says which clause failed.
    """
    require(isinstance(agent, Agent), agent, "is not a subclass of seo_slam.interfaces.Agent")
    require(isinstance(agent.name, str) and bool(agent.name), agent, f"name is {agent.name!r}, wanted text")
    landmarks = tiny_landmarks()
    _check_edits(agent, landmarks)
    none = landmarks[np.zeros(0, dtype=np.int64)]
    require(len(_propose(agent, none)) == 0, agent, "proposed edits though the view has no landmarks")


def _propose(agent: Agent, landmarks: Landmarks) -> Sequence[Edit]:
    frame = tiny_frames(1)[0]
    image = frame.rgb.copy()
    try:
        edits: Any = agent.propose(AgentView(frame, T_WORLD_FIRST, landmarks, tiny_boxes(landmarks)))
        if inspect.isawaitable(edits):
            edits = _awaited(edits)
    except AgentError:
        return ()
    require(isinstance(edits, Sequence), agent, f"propose returned {type(edits).__name__}, wanted a sequence of edits; empty to abstain")
    require(np.array_equal(image, frame.rgb), agent, "propose changed the image; draw on a copy")
    return list(edits)


def _awaited(edits: Awaitable[Any]) -> Any:
    thread = LoopThread()
    try:
        return thread.wait_for(edits)
    finally:
        thread.stop()


def _check_edits(agent: Agent, landmarks: Landmarks) -> None:
    versions = dict(zip(landmarks.ids.tolist(), landmarks.versions.tolist(), strict=True))
    for edit in _propose(agent, landmarks):
        require(isinstance(edit, Confirm | Doubt | Relabel | Remove | Merge), agent, f"proposed a {type(edit).__name__}, which is no edit")
        named = (
            ((edit.keep_id, edit.keep_version), (edit.drop_id, edit.drop_version))
            if isinstance(edit, Merge)
            else ((edit.landmark_id, edit.version),)
        )
        for landmark_id, version in named:
            require(landmark_id in versions, agent, f"{edit} names landmark {landmark_id}, which is not in the view")
            require(
                version == versions[landmark_id],
                agent,
                f"{edit} names version {version} of landmark {landmark_id}; the view shows {versions[landmark_id]}",
            )
        if isinstance(edit, Merge):
            require(edit.keep_id != edit.drop_id, agent, f"{edit} merges a landmark with itself")
        if isinstance(edit, Relabel):
            require(isinstance(edit.label, str) and bool(edit.label.strip()), agent, f"{edit} has no label")
