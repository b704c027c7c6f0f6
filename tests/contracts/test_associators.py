"""Every registered associator keeps the contract, and the check notices those that do not."""

import numpy as np
import pytest

from seo_slam import registry
from seo_slam.association.nearest import NearestAssociator
from seo_slam.config import AssociationSettings
from seo_slam.interfaces import Associator
from seo_slam.testing import check_associator
from seo_slam.types import NEW, Association


@pytest.mark.parametrize("name", registry.known("associator"))
def test_contract(name):
    check_associator(registry.create("associator", name))


@pytest.mark.parametrize("gate", ["likelihood", "cosine", "none"])
def test_two_stage_with_each_semantic_gate(gate):
    check_associator(registry.create("associator", "two_stage", settings=AssociationSettings(semantic_gate=gate)))


class AllNew(Associator):
    def associate(self, observations, landmarks, estimate):
        return Association(np.full(len(observations), NEW, np.int64), np.full(len(observations), np.nan))


class InOrder(Associator):
    """Believes that observations come in the order of the landmarks."""

    def associate(self, observations, landmarks, estimate):
        ids = np.full(len(observations), NEW, np.int64)
        n = min(len(observations), len(landmarks))
        ids[:n] = landmarks.ids[:n]
        return Association(ids, np.where(ids >= 0, 0.0, np.nan))


class Indices(NearestAssociator):
    """Gives indices for ids."""

    def associate(self, observations, landmarks, estimate):
        found = super().associate(observations, landmarks, estimate)
        ids = [NEW if i < 0 else int(np.flatnonzero(landmarks.ids == i)[0]) for i in found.landmark_ids]
        return Association(np.array(ids, dtype=np.int64), found.costs)


class ZeroCosts(NearestAssociator):
    def associate(self, observations, landmarks, estimate):
        return Association(super().associate(observations, landmarks, estimate).landmark_ids, np.zeros(len(observations)))


class Moves(NearestAssociator):
    def associate(self, observations, landmarks, estimate):
        landmarks.p_world[:] += 0.001
        return super().associate(observations, landmarks, estimate)


class Flips(Associator):
    def __init__(self):
        self._count = 0

    def associate(self, observations, landmarks, estimate):
        self._count += 1
        return (NearestAssociator() if self._count % 2 else AllNew()).associate(observations, landmarks, estimate)


@pytest.mark.parametrize(
    ("associator", "words"),
    [
        (AllNew, "exact measurements of"),
        (InOrder, "in another order|off any landmark"),
        (Indices, "not in the map"),
        (ZeroCosts, "costs must be finite where matched"),
        (Moves, "changed its arguments"),
        (Flips, "two answers"),
        (object, "not a subclass"),
    ],
)
def test_broken_ones_are_noticed(associator, words):
    with pytest.raises(AssertionError, match=words):
        check_associator(associator())


def test_one_without_a_gate_is_noticed():
    class Hungry(Associator):
        def associate(self, observations, landmarks, estimate):
            found = NearestAssociator().associate(observations, landmarks, estimate)
            ids, left = found.landmark_ids.copy(), [i for i in landmarks.ids if i not in found.landmark_ids]
            for row in np.flatnonzero(ids < 0)[: len(left)]:
                ids[row] = left.pop(0)
            return Association(ids, np.where(ids >= 0, 0.0, np.nan))

    with pytest.raises(AssertionError, match="off any landmark"):
        check_associator(Hungry())
