"""The abstract map as a search changes it, and the places that the search is done with (DualMap IV-D)."""

import logging
from dataclasses import replace

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Volatile
from seo_slam.errors import SeoSlamError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.parts import Abstracting, Updating
from seo_slam.navigation.query import cosine
from seo_slam.navigation.senses import Senses
from seo_slam.settings.navigation import NavigationSettings

_LOG = logging.getLogger(__name__)


class Memory:
    """What the search started with, what it made of it, and where it has been.

    The map is updated from the start of the search each time, with all that was seen since: were each view added to the last update,
    what was seen early would count again and again.

    Attributes:
        map: as updated.
        original: as it was at the start.
        tried: anchors that need not be gone to again.
    """

    def __init__(
        self, abstract_map: AbstractMap, senses: Senses, settings: NavigationSettings, abstracting: Abstracting, updating: Updating
    ) -> None:
        """Take the map at the start of a search, and how a local map changes it."""
        self.map = abstract_map
        self.original = abstract_map
        self.tried: list[Anchor] = []
        self._missing: set[int] = set()
        self._senses = senses
        self._settings = settings
        self._abstracting = abstracting
        self._updating = updating

    def anchor(self, anchor_id: int) -> Anchor:
        """Return an anchor of the map as updated."""
        return next(anchor for anchor in self.map.anchors if anchor.id == anchor_id)

    def done_with(self, anchor: Anchor, looked_at: bool) -> None:
        """Do not choose an anchor again. One that was looked at, and well, does not carry what was asked for."""
        self.tried.append(anchor)
        if looked_at and self._senses.coverage.seen_share(anchor.id) >= self._settings.seen_share:
            self._missing.add(anchor.id)

    @property
    def tried_ids(self) -> frozenset[int]:
        """Ids, in ``map``, of anchors not to choose again: those tried, and anchors found since in the same places."""
        known = {anchor.id for anchor in self.original.anchors}
        tried = {anchor.id for anchor in self.tried if anchor.id in known}
        doubles = {anchor.id for anchor in self.map.anchors if anchor.id not in known and any(_inside(anchor, one) for one in self.tried)}
        return frozenset(tried | doubles)

    def learn(self, feature: FloatArray, required: float) -> None:
        """Update the map with the stable landmarks of this search, and forget things like the query that were looked for and not there.

        The paper replaces what is on an anchor only if the new view covers nearly all of it; else a thing that is gone would be sought
        there for ever.

        Args:
            feature: (D,) of the query.
            required: score from which a thing is like it.
        """
        least = self._settings.update_observations
        rows = [row for row in self._senses.landmarks if row.state == "stable" or self._senses.observations(row) >= least]
        try:
            self.map = self._updating(self._forgetful(feature, required), self._abstracting(rows))
        except SeoSlamError as error:  # a local map that cannot be abstracted must not end a drive
            _LOG.warning("the abstract map stays as it is: %s", error)
        self._senses.coverage.follow(self.map.anchors)

    def forget_hints(self, trusted: AbstractMap) -> None:
        """End a search that went by hints: what was only hinted at is a hint again, unless it was found, and then is learned."""
        self.map = self.original = trusted

    def _forgetful(self, feature: FloatArray, required: float) -> AbstractMap:
        anchors = []
        for anchor in self.original.anchors:
            if anchor.id in self._missing:
                volatiles, hints = (_unlike(rows, feature, required) for rows in (anchor.volatiles, anchor.hints))
                anchor = replace(anchor, volatiles=volatiles, hints=hints)
            anchors.append(anchor)
        return replace(self.original, anchors=tuple(anchors))


def _unlike(rows: tuple[Volatile, ...], feature: FloatArray, required: float) -> tuple[Volatile, ...]:
    return tuple(row for row in rows if cosine(row.feature[None], feature)[0] < required)


def _inside(anchor: Anchor, other: Anchor) -> bool:
    """Whether the middle of an anchor is in the box of another."""
    low, high = other.bounds_world
    return bool((anchor.xy_world >= low).all() and (anchor.xy_world <= high).all())
