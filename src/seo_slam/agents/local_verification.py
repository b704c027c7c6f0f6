"""Is anything there? The verification agent that asks no model: it looks at depth and colour around each landmark."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seo_slam.agents.local_looks import LooksAtOne, look_at, place_of, side_of, version_of
from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Agent, AgentRole, AgentView
from seo_slam.records import Confirm, Edit, Remove

LOOKS_A_SIDE = 4
"""More looks from one side would say the same again."""

SURELY_NOTHING = 3.5
"""Log likelihood ratio from which a landmark is proposed to be removed; the map weighs its sightings against it."""

SURELY_THERE = -2.0
"""… and from which it is confirmed."""

WAS_THERE = -3.5
"""Once it was as low as this, there was a thing."""

ELSEWHERE_M = 0.3
"""A landmark this far from where it was looked at has moved: what was seen was another place."""


SAME_PLACE_M = 0.1
"""What comes up this near to where a landmark left the map is at the same place."""


class LocalVerification(Agent):
    """Finds landmarks of which nothing stands out, neither in depth nor in colour: posters, boxes and bags that detectors see in bare walls.

    A landmark's own surface points lie on a plane that goes on around its box, and no colour in the box is new: then there is nothing.
    It is proposed for removal when that holds over several looks, and confirmed when something stands out. A thing that stood out once is
    never proposed for removal: if it is gone, the map's life cycle finds out from free space, and knows it again elsewhere.
    """

    role: AgentRole = "verification"

    def __init__(self, depth_noise_at_1m_m: float = 0.0019, looks_a_view: int = 4, most_remembered: int = 5000) -> None:
        """Take how noisy depth is.

        Args:
            depth_noise_at_1m_m: standard deviation of depth at 1 m; it grows with depth squared (a Kinect's).
            looks_a_view: landmarks looked at in a view, those seen least from its side first: what bounds its time.
            most_remembered: landmarks whose looks are kept; beyond them the oldest are forgotten.

        Raises:
            ConfigError: one of them is not above 0.
        """
        if not depth_noise_at_1m_m > 0 or looks_a_view < 1 or most_remembered < 1:
            got = f"{depth_noise_at_1m_m}, {looks_a_view}, {most_remembered}"
            raise ConfigError(f"local_verification: depth_noise_at_1m_m, looks_a_view and most_remembered must be above 0, got {got}")
        self._noise = depth_noise_at_1m_m
        self._looks_a_view = looks_a_view
        self._most_remembered = most_remembered
        self._looks: dict[int, LooksAtOne] = {}
        self._confirmed: dict[int, int] = {}  # landmark -> version

    @property
    def name(self) -> str:
        """Written beside every edit."""
        return "local verification"

    def propose(self, view: AgentView) -> Sequence[Edit]:
        """Return ``Remove`` for what is nothing, ``Confirm`` for what is something; nothing where it cannot tell or has said it before."""
        due = []
        for landmark_id in view.asked or tuple(view.boxes_px):
            looks, side = self._looks_at(landmark_id, view), side_of(landmark_id, view)
            if looks.tried.get(side, 0) < LOOKS_A_SIDE:
                due.append((looks.tried.get(side, 0), sum(looks.tried.values()), landmark_id, side))
        edits: list[Edit] = []
        for _, _, landmark_id, side in sorted(due)[: self._looks_a_view]:
            edit = self._judge(landmark_id, side, view)
            if edit is not None:
                edits.append(edit)
        while len(self._looks) > self._most_remembered:
            oldest = next(iter(self._looks))
            del self._looks[oldest]
            self._confirmed.pop(oldest, None)
        return edits

    def _judge(self, landmark_id: int, side: int, view: AgentView) -> Edit | None:
        looks, version = self._looks[landmark_id], version_of(landmark_id, view)
        looks.tried[side] = looks.tried.get(side, 0) + 1
        look = look_at(landmark_id, view, self._noise)
        if look is None:
            cannot_tell = not looks.by_side and looks.tried[side] == LOOKS_A_SIDE
            return self._confirm(landmark_id, version) if cannot_tell else None
        looks.add(side, look.nothing())
        total = looks.total()
        looks.was_there |= total <= WAS_THERE
        if look.nothing() > 0:
            return Remove(landmark_id, version, self.name) if total >= SURELY_NOTHING and not looks.was_there else None
        return self._confirm(landmark_id, version) if total <= SURELY_THERE else None

    def _confirm(self, landmark_id: int, version: int) -> Edit | None:
        """Confirm a version once: that lets a landmark go on to be described and merged, and says nothing new the second time."""
        if self._confirmed.get(landmark_id) == version:
            return None
        self._confirmed[landmark_id] = version
        return Confirm(landmark_id, version, self.name)

    def _looks_at(self, landmark_id: int, view: AgentView) -> LooksAtOne:
        """The looks at a landmark, none if it has moved."""
        place = place_of(landmark_id, view)
        looks = self._looks.get(landmark_id)
        if looks is None:
            self._looks[landmark_id] = looks = self._left_at(place, view) or LooksAtOne(place.copy())
        elif float(np.linalg.norm(looks.p_world - place)) > ELSEWHERE_M:
            self._looks[landmark_id] = looks = LooksAtOne(place.copy())
        return looks

    def _left_at(self, place: FloatArray, view: AgentView) -> LooksAtOne | None:
        """The looks at a landmark that was at a place and has left the map: detectors see the same thing in the same wall again."""
        present = {int(i) for i in view.landmarks.ids}
        for old_id, looks in self._looks.items():
            if old_id not in present and float(np.linalg.norm(looks.p_world - place)) <= SAME_PLACE_M:
                return replace(looks, p_world=place.copy(), tried={})
        return None
