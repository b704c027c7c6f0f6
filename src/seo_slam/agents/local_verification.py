"""Is anything there? The verification agent that asks no model: it looks at depth and colour around each landmark."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from seo_slam.agents.local_looks import LooksAtOne, look_at, place_of, side_of, version_of
from seo_slam.agents.word_choice import leading_words, word_doubted
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Agent, AgentView
from seo_slam.records import AgentRole, Confirm, Doubt, Edit, Remove

LOOKS_A_SIDE = 4
"""More looks from one side would say the same again."""

SURELY_NOTHING = 3.5
"""Log likelihood ratio from which a landmark is proposed to be removed; the map weighs its sightings against it."""

SURELY_THERE = -2.0
"""… and from which it is confirmed."""

WAS_THERE = -3.5
"""Once it was as low as this, there was a thing."""

UNSEEN = 2
"""A landmark of which so many looks came to nothing, since it gives no depth or is hidden, is passed on as it is …"""

FILLS_IMAGE = 0.5
"""… and at once if its box is so much of the image: nothing is around it to compare it with."""

DOUBTS_A_SIDE = 4
"""A word is doubted so often from one side for the sake of another one; the map need not agree."""

ELSEWHERE_M = 0.3
"""A landmark this far from where it was looked at has moved: what was seen was another place."""

SAME_PLACE_M = 0.1
"""What comes up this near to where a landmark left the map is at the same place."""


class LocalVerification(Agent):
    """Finds landmarks of which nothing stands out, neither in depth nor in colour: things that detectors see in bare walls and floors.

    A landmark's own surface points lie on a plane that goes on around its box, and no colour in the box is new: then there is nothing.
    It is proposed for removal when that holds over several looks, and confirmed when something stands out. A thing that stood out once is
    never proposed for removal: if it is gone, the map's life cycle finds out from free space, and knows it again elsewhere.
    """

    role: AgentRole = "verification"

    def __init__(
        self,
        depth_noise_at_1m_m: float = 0.0019,
        looks_a_view: int = 3,
        most_remembered: int = 5000,
        likelihood: LabelLikelihood | None = None,
        confirms: bool = True,
    ) -> None:
        """Take how noisy depth is.

        Args:
            depth_noise_at_1m_m: standard deviation of depth at 1 m; it grows with depth squared (a Kinect's).
            looks_a_view: landmarks looked at in a view, those seen least from its side first: what bounds its time.
            most_remembered: landmarks whose looks are kept; beyond them the oldest are forgotten.
            likelihood: compares words; a pipeline gives its own. None: different words mean different things.
            confirms: False for a witness beside chat models: it denies and doubts, and leaves it to them to confirm.

        Raises:
            ConfigError: one of them is not above 0.
        """
        if not depth_noise_at_1m_m > 0 or looks_a_view < 1 or most_remembered < 1:
            got = f"{depth_noise_at_1m_m}, {looks_a_view}, {most_remembered}"
            raise ConfigError(f"local_verification: depth_noise_at_1m_m, looks_a_view and most_remembered must be above 0, got {got}")
        self._likelihood = likelihood
        self.confirms = confirms
        self._noise = depth_noise_at_1m_m
        self._looks_a_view = looks_a_view
        self._most_remembered = most_remembered
        self._looks: dict[int, LooksAtOne] = {}

    @property
    def name(self) -> str:
        """Written beside every edit."""
        return "local verification"

    def propose(self, view: AgentView) -> Sequence[Edit]:
        """Return ``Remove`` for what is nothing, ``Confirm`` for what is something; nothing where it cannot tell or has said it before.

        A landmark that has another word than the detector said most, since agents named it before, is doubted.
        """
        asked = view.asked or tuple(view.boxes_px)
        due = []
        for landmark_id in asked:
            looks, side = self._looks_at(landmark_id, view), side_of(landmark_id, view)
            if not looks.was_there and looks.tried.get(side, 0) < LOOKS_A_SIDE:
                due.append((looks.tried.get(side, 0), sum(looks.tried.values()), landmark_id, side))
        denied = [i for _, _, i, side in sorted(due)[: self._looks_a_view] if self._denies(i, side, view)]
        leading = leading_words(view.landmarks)
        edits = [self._denied(i, view) if i in denied else self._confirmed_or_doubted(i, view, leading) for i in asked]
        self._forget_oldest()
        return [edit for edit in edits if edit is not None]

    def _denies(self, landmark_id: int, side: int, view: AgentView) -> bool:
        """Look at a landmark; whether there is nothing. One that surely was there is not looked at again: nothing would follow."""
        looks = self._looks[landmark_id]
        looks.tried[side] = looks.tried.get(side, 0) + 1
        look = look_at(landmark_id, view, self._noise)
        if look is None:
            return False
        looks.add(side, look.nothing())
        looks.was_there |= looks.total() <= WAS_THERE
        return look.nothing() > 0 and looks.total() >= SURELY_NOTHING and not looks.was_there

    def _denied(self, landmark_id: int, view: AgentView) -> Edit:
        return Remove(landmark_id, version_of(landmark_id, view), self.name)

    def _confirmed_or_doubted(self, landmark_id: int, view: AgentView, leading: Mapping[str, int]) -> Edit | None:
        """Confirm what is there; doubt a word that is not the one said most."""
        looks, version = self._looks[landmark_id], version_of(landmark_id, view)
        seen = looks.total() <= SURELY_THERE
        if not looks.confirmed and not seen and not self._cannot_tell(landmark_id, view):
            return None
        word = word_doubted(landmark_id, view, leading, self._likelihood)
        doubt = (word, side_of(landmark_id, view))
        if word and looks.doubts.get(doubt, 0) < DOUBTS_A_SIDE:
            looks.doubts[doubt] = looks.doubts.get(doubt, 0) + 1
            looks.confirmed = True
            return Doubt(landmark_id, version, self.name)
        if looks.confirmed or not self.confirms:
            return None
        looks.confirmed = True
        return Confirm(landmark_id, version, self.name)

    def _cannot_tell(self, landmark_id: int, view: AgentView) -> bool:
        looks, box, camera = self._looks[landmark_id], view.boxes_px[landmark_id], view.frame.camera
        fills = float((box[2] - box[0]) * (box[3] - box[1])) >= FILLS_IMAGE * camera.width * camera.height
        return not looks.by_side and (fills or sum(looks.tried.values()) >= UNSEEN)

    def _forget_oldest(self) -> None:
        while len(self._looks) > self._most_remembered:
            del self._looks[next(iter(self._looks))]

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
                return replace(looks, p_world=place.copy(), tried={}, confirmed=False, doubts={})
        return None
