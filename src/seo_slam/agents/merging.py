"""The merging agent (SEO-SLAM III-D3): which landmarks are one thing?"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from seo_slam.agents.asking import demand
from seo_slam.agents.chat_agent import ChatAgent, asked_ids, only_answers, shown_label, version_of
from seo_slam.agents.compose import MERGING_CROPS, merging_images, row_of
from seo_slam.agents.label_text import MOST_CATEGORY_WORDS, label_from
from seo_slam.agents.replies import Duplicates, Merging
from seo_slam.errors import ConfigError
from seo_slam.interfaces import AgentView, ChatModel
from seo_slam.records import AgentRole, Edit, Merge
from seo_slam.types import Landmarks


class MergingAgent(ChatAgent):
    """Shows a model the scene, crops and positions of up to eight landmarks: which are duplicates, and which of them to keep.

    The paper's prompt leaves apart what is 0.10 m or more apart. But two estimates of one thing, from two sides, err by up to half of
    its size, and a chair would stay two. So the 0.10 m (``separate_beyond_m``) come on top of half of the larger one's extent. The model
    is told the largest distance so allowed among those it is asked about, and every pair that it names is held to its own.
    """

    role: AgentRole = "merging"
    most_landmarks: int = MERGING_CROPS
    prompt_name: ClassVar[str] = "merging"

    def __init__(
        self, chat: ChatModel | str | Mapping[str, Any], temperature: float = 0.7, max_tokens: int = 250, separate_beyond_m: float = 0.1
    ) -> None:
        """Know the model and how to ask it.

        Args:
            chat: a chat model, its name, or name and options.
            temperature: of the reply.
            max_tokens: of the reply.
            separate_beyond_m: two landmarks are two things if they are farther apart than this and half the extent of the larger one.

        Raises:
            ConfigError, UnknownBackendError, MissingBackendError: as ``ChatAgent``.
        """
        super().__init__(chat, temperature, max_tokens)
        if not (math.isfinite(separate_beyond_m) and separate_beyond_m >= 0.0):
            raise ConfigError(f"agent {self.name!r}: separate_beyond_m is {separate_beyond_m}, wanted metres, at least 0")
        self._separate_beyond_m = float(separate_beyond_m)

    async def propose(self, view: AgentView) -> Sequence[Edit]:
        """Return merges of duplicates into the best of them.

        Raises:
            ChatRequestError, ChatReplyError, BudgetExceeded: no reply could be had, or none of any use.
        """
        ids = asked_ids(view, self.most_landmarks)
        composed = merging_images(view, ids) if len(ids) > 1 else None
        if composed is None or len(composed.ids) < 2:
            return ()
        rows = [row_of(view, i) for i in composed.ids]
        slack_m = slack_of_pairs_m(view.landmarks, rows, self._separate_beyond_m)
        if slack_m.max() < 0.0:
            return ()  # no two are near enough to be one
        facts = {"landmarks": _entries(view, composed.ids), "separate_beyond_m": self._largest_limit_m(view.landmarks, rows, slack_m)}
        reply = await demand(self.chat, self.request("Find duplicates among the numbered boxes.", facts, composed.images), Merging)
        once = only_answers([box for group in reply.duplicates for box in set(group.boxes)], len(composed.ids))
        pairs = [pair for group in reply.duplicates for pair in _pairs(group, once) if slack_m[pair[0] - 1, pair[1] - 1] >= 0.0]
        return tuple(
            Merge(keep, version_of(view, keep), drop, version_of(view, drop), self.name)
            for keep, drop in ((composed.ids[best - 1], composed.ids[other - 1]) for best, other in pairs)
        )

    def _largest_limit_m(self, landmarks: Landmarks, rows: Sequence[int], slack_m: np.ndarray[Any, np.dtype[np.float64]]) -> float:
        """What the model is told, rounded up to centimetres."""
        apart_m = np.linalg.norm(landmarks.p_world[rows][:, None] - landmarks.p_world[rows][None], axis=2)
        limits_m = (apart_m + slack_m)[slack_m >= 0.0]
        return math.ceil(100.0 * float(limits_m.max(initial=self._separate_beyond_m)) - 1e-9) / 100.0


def slack_of_pairs_m(landmarks: Landmarks, rows: Sequence[int], separate_beyond_m: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return (N, N): by how much two of N rows are nearer than two things must be; below 0: they are two; -infinity on the diagonal."""
    p_world, reach_m = landmarks.p_world[rows], 0.5 * landmarks.size_m[rows].max(axis=1)
    apart_m = np.linalg.norm(p_world[:, None] - p_world[None], axis=2)
    slack = np.maximum(reach_m[:, None], reach_m[None]) + separate_beyond_m - apart_m
    np.fill_diagonal(slack, -np.inf)
    return np.asarray(slack, dtype=np.float64)


def _entries(view: AgentView, ids: Sequence[int]) -> list[dict[str, Any]]:
    entries = []
    for number, landmark_id in enumerate(ids, start=1):
        row = row_of(view, landmark_id)
        label = shown_label(view, landmark_id)
        category = label_from(view.landmarks.category_of(row), MOST_CATEGORY_WORDS) or label
        position_m = [round(float(x), 3) for x in view.landmarks.p_world[row]]
        entries.append({"box": number, "label": label, "category": category, "position_m": position_m})
    return entries


def _pairs(group: Duplicates, once: set[int]) -> list[tuple[int, int]]:
    """``(best, other)`` of a group; none if a box of it is unknown or in another group too, or the best is not of it."""
    boxes = list(dict.fromkeys(group.boxes))
    if group.best not in boxes or not set(boxes) <= once:
        return []
    return [(group.best, box) for box in boxes if box != group.best]
