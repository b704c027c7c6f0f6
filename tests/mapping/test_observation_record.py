"""A landmark's list of observations: counted, parted, joined, and taken over from a map that is continued."""

from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.mapping.observation_record import NULL, RESTORED, ObservationRecord
from seo_slam.settings.observing import CloudSettings
from seo_slam.testing.store import make_landmark
from seo_slam.testing.worlds import T_WORLD_FIRST

SETTINGS = CloudSettings(enabled=True)
POSES = T_WORLD_FIRST[None]
WORDS = (NULL, "bowl", "cup", "mug")
POINTS = np.array([0.0, 0.0, 1.0]) + np.random.default_rng(5).uniform(-0.05, 0.05, (200, 3))


def restored(**changes):
    landmark = replace(make_landmark(3), cloud_world=POINTS, **changes)
    return ObservationRecord.restored(landmark, SETTINGS, T_WORLD_FIRST)


@pytest.mark.parametrize(
    ("labels", "observations", "counts"),
    [
        ({"cup": 0.75, "bowl": 0.25}, 4, {"cup": 3, "bowl": 1}),
        ({"cup": 0.4, "bowl": 0.3, "mug": 0.3}, 1, {"cup": 1}),
        ({"cup": 0.5, "bowl": 0.5}, 1, {"cup": 1}),
        ({"cup": 0.3333, "bowl": 0.3333, "mug": 0.3333}, 3000, {"cup": 1000, "bowl": 1000, "mug": 1000}),
        ({"cup": 1.0, "bowl": 0.0}, 5, {"cup": 5}),
        ({}, 7, {NULL: 7}),
    ],
)
def test_a_restored_list_has_as_many_observations_as_the_landmark_had(labels, observations, counts):
    record = restored(labels=labels, observations=observations)
    assert (record.counts(), len(record)) == (counts, observations)
    assert not len(record.of_words(set(counts)))  # the smoother has no measurement of any


@pytest.mark.parametrize("labels", [{"cup": 0.75, "bowl": 0.25}, {"cup": 1.0}, {}])
@pytest.mark.parametrize("cloud", [POINTS, np.zeros((0, 3))], ids=["cloud", "no cloud"])
def test_every_restored_word_has_a_look_and_a_place(labels, cloud):
    landmark = replace(make_landmark(3), labels=labels, cloud_world=cloud)
    record = ObservationRecord.restored(landmark, SETTINGS, T_WORLD_FIRST)
    assert record.majority(alike_cosine=0.75) == pytest.approx(1.0)  # of one look, so names of one thing
    assert record.majority() == pytest.approx(max(labels.values(), default=1.0))
    np.testing.assert_allclose(record.feature(), landmark.embedding)
    sizes = [len(record.cloud_of(word, POSES)) for word in record.counts()]
    assert sizes[0] == len(record.cloud(POSES)) > 0
    assert not any(sizes[1:])
    record.add("bowl", 0, landmark.embedding, np.array([[0.0, 0.0, 9.0]]), POSES)
    assert len(record.cloud(POSES)) == sizes[0] + 1


def test_what_comes_without_a_cloud_is_taken_for_its_box():
    landmark = make_landmark(3)
    low, high = ObservationRecord.restored(landmark, SETTINGS, T_WORLD_FIRST).cloud(POSES).bounds
    np.testing.assert_allclose(0.5 * (low + high), landmark.position_m, atol=1e-6)
    np.testing.assert_allclose(high - low, landmark.size_m, atol=2 * SETTINGS.voxel_m)


def test_a_restored_list_can_be_parted_by_any_of_its_words():
    record = restored()
    rest = record.taken({"cup"})
    assert (record.counts(), rest.counts()) == ({"bowl": 1}, {"cup": 3})
    assert len(record.cloud(POSES)) == 0
    record.absorb(rest, POSES)
    assert len(record.cloud(POSES)) == len(rest.cloud(POSES)) > 0


def counted(record):
    """What a list of observations says of itself, by reading all of it."""
    named = sum(word != NULL for word in record.words) / max(len(record), 1)
    most = max((n for word, n in Counter(record.words).items() if word != NULL), default=0)
    nameless = record.words.count(NULL) > most and named < SETTINGS.named_share
    return dict(Counter(record.words)), nameless, max(record.keyframes, default=RESTORED)


def together(record, window):
    """``seen_at_once`` by reading the whole list, but for what was joined."""
    seen = {}
    for word, keyframe in zip(record.words, record.keyframes, strict=True):
        if keyframe != RESTORED:
            seen.setdefault(keyframe, set()).add(word)
    newest = [seen[keyframe] - {NULL} for keyframe in sorted(seen)[-window:]]
    pairs = Counter(pair for words in newest for pair in combinations(sorted(words), 2))
    return {pair: times for pair, times in pairs.items() if not record.are_joined(*pair)}


STEPS = st.one_of(
    st.tuples(st.just("add"), st.sampled_from(WORDS), st.integers(0, 3)),
    st.tuples(st.just("taken"), st.sets(st.sampled_from(WORDS)), st.just(0)),
    st.tuples(st.just("absorb"), st.just(0), st.just(0)),
    st.tuples(st.just("look"), st.just(0), st.integers(1, 6)),
)


@settings(max_examples=150, deadline=None)
@given(st.booleans(), st.lists(STEPS, max_size=25))
def test_what_is_kept_up_is_what_the_whole_list_says(continued, steps):
    record = restored() if continued else ObservationRecord(SETTINGS)
    aside, keyframe = [], 0
    poses = np.tile(T_WORLD_FIRST, (80, 1, 1))
    for step, what, number in steps:
        if step == "add":
            keyframe += number
            for at, one in enumerate([record, *aside[:1]]):
                one.add(what, keyframe, np.eye(8)[WORDS.index(what)], POINTS[at : at + 5], poses)
        elif step == "taken":
            aside.append(record.taken(what))
        elif step == "absorb" and aside:
            record.absorb(aside.pop(), poses)
        elif step == "look":
            assert record.seen_at_once(number) == together(record, number)
        for one in (record, *aside):
            counts, nameless, last_keyframe = counted(one)
            assert (one.counts(), one.is_nameless, one.last_keyframe) == (counts, nameless, last_keyframe)
            assert [one.seen_at_once(window) for window in (3, 9, 2)] == [together(one, window) for window in (3, 9, 2)]
            for word in counts:
                one.cloud_of(word, poses)
            assert 0.0 <= one.majority(0.75) <= 1.0


class Unread(list):
    """A list that is only appended to."""

    def __iter__(self):
        raise AssertionError("the whole list is read")


def test_a_keyframe_costs_the_same_however_long_the_list_is():
    record = ObservationRecord(SETTINGS)
    for keyframe in range(12):
        record.add("cup", keyframe, np.ones(8), POINTS[:5], np.tile(T_WORLD_FIRST, (40, 1, 1)))
    record.seen_at_once(5)
    record.words, record.keyframes = Unread(record.words), Unread(record.keyframes)
    for keyframe in range(12, 20):
        record.add("cup", keyframe, np.ones(8), POINTS[:5], np.tile(T_WORLD_FIRST, (40, 1, 1)))
        record.add("bowl", keyframe, np.ones(8), POINTS[:5], np.tile(T_WORLD_FIRST, (40, 1, 1)))
        assert not record.is_nameless
        assert record.majority(0.75) == pytest.approx(1.0)
        assert record.seen_at_once(5) == {("bowl", "cup"): min(keyframe - 11, 5)}
    assert sum(record.counts().values()) == len(record) == 28


def seen(*words):
    """A list of one keyframe."""
    record = ObservationRecord(SETTINGS)
    for word in words:
        record.add(word, 0, np.ones(8), POINTS[:5], POSES)
    return record


def test_words_that_were_merged_are_not_parted_again():
    record = seen("cup", "mug", None)
    assert record.seen_at_once(1) == {("cup", "mug"): 1}
    record.absorb(seen("bowl", "cup", None), POSES)
    assert record.seen_at_once(1) == {}  # bowl with cup and mug, cup with mug
    assert record.majority() == pytest.approx(1.0)  # names of one thing
    assert not record.are_joined("cup", "cup")
    assert not record.are_joined(NULL, "cup")
    apart = seen("cup", "mug", "hat")
    apart.absorb(seen("shoe"), POSES)
    assert apart.seen_at_once(1) == {("cup", "mug"): 1, ("cup", "hat"): 1, ("hat", "mug"): 1}
    half = apart.taken({"cup", "shoe"})
    assert half.are_joined("shoe", "cup")
    assert half.seen_at_once(1) == {}
    apart.absorb(half, POSES)
    assert apart.seen_at_once(1) == {("hat", "mug"): 1}
