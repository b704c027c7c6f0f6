"""DualMap's status checks: what is seen often as one thing stays, what is noise goes, what is two is split (III-B3)."""

from dataclasses import replace

import numpy as np
import pytest
from checked_map import AT, CheckedMap
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.errors import MapError
from seo_slam.mapping.edits import merge_landmarks
from seo_slam.mapping.status_checks import shared_share
from seo_slam.testing.store import make_landmark
from seo_slam.testing.worlds import T_WORLD_FIRST

ASIDE = AT + np.array([0.0, 0.12, 0.0])
ELSEWHERE = AT + np.array([0.0, -0.6, 0.0])


def watched(world, times, *seen):
    """See the same again and again; everything that happened."""
    return [event for _ in range(times) for event in world.see(*seen)]


def test_a_thing_is_stable_once_it_was_observed_often_enough():
    world = CheckedMap(observations=8)
    assert world.see((None, AT, "cup")) == []
    assert watched(world, 6, (0, AT, "cup")) == []
    assert world.see((0, AT, "cup")) == [("stable", 0)]
    assert world.row(0).state == "stable"
    assert watched(world, 5, (0, AT, "cup")) == []


def test_two_thirds_must_be_one_word():
    world = CheckedMap(observations=6, split=False)
    world.see((None, AT, "cup"))
    happened = []
    for word in ("bowl", "cup", "bowl", "cup", "bowl", "cup", "bowl"):
        happened += world.see((0, AT, word))
    assert happened == []  # 4 of 8
    assert watched(world, 3, (0, AT, "cup")) == []  # 7 of 11
    assert world.see((0, AT, "cup")) == [("stable", 0)]  # 8 of 12


def test_observations_without_a_class_abstain_or_count_as_one_as_in_the_paper():
    for named_share, stable in ((1 / 3, True), (1.0, False)):
        world = CheckedMap(observations=6, named_share=named_share)
        world.see((None, AT, "cup"))
        happened = watched(world, 1, (0, AT, None)) + watched(world, 1, (0, AT, "cup"))
        happened += watched(world, 1, (0, AT, None)) + watched(world, 1, (0, AT, "cup")) + watched(world, 1, (0, AT, None))
        assert (("stable", 0) in happened) == stable


def test_a_stray_word_names_nothing():
    world = CheckedMap(observations=6, background=())
    world.see((None, AT, "bowl"))
    watched(world, 6, (0, AT, None))
    assert (world.row(0).label, dict(world.row(0).labels), world.row(0).state) == ("", {}, "stable")
    watched(world, 4, (0, AT, "bowl"))
    assert world.row(0).label == "bowl"


def test_what_has_no_word_and_looks_like_a_wall_never_becomes_stable():
    words = HashedEmbedder(size=8)
    world = CheckedMap(observations=3, split=False, flat_m=0.0)
    world.see((None, ELSEWHERE, "cup"))
    wall, cup = words.embed_text(["wall", "cup"])
    world.see((None, AT, None), feature=wall)
    assert [event for _ in range(9) for event in world.see((1, AT, None), feature=wall)] == []
    assert (world.row(1).state, world.row(1).observations) == ("tentative", 10)
    again = CheckedMap(observations=3, split=False)
    again.see((None, ELSEWHERE, "cup"))
    again.see((None, AT, None), feature=cup)
    assert [event for _ in range(2) for event in again.see((1, AT, None), feature=cup)] == [("stable", 1)]


@pytest.mark.parametrize(("flat_m", "word", "stable"), [(0.04, None, False), (0.04, "paper", True), (0.0, None, True)])
@pytest.mark.parametrize("thick", [0.1, 0.0])
def test_a_flat_piece_without_a_word_is_no_thing(flat_m, word, stable, thick):
    world = CheckedMap(observations=3, background=(), flat_m=flat_m)
    world.see((None, AT, word), thick=thick)
    for _ in range(20):
        world.see((0, AT, word), thick=thick)
    assert world.ids() == [0]  # neither removed nor made anew
    assert (world.row(0).state == "stable") == stable


@pytest.mark.parametrize(("noise_at_1m_m", "stable"), [(0.0, True), (0.0057, True), (0.03, False)])
def test_a_surface_is_as_thick_as_depth_noise_makes_it(noise_at_1m_m, stable):
    world = CheckedMap(observations=3, background=(), flat_m=0.001, noise_at_1m_m=noise_at_1m_m)
    world.see((None, AT, None), thick=0.3)
    for _ in range(9):
        world.see((0, AT, None), thick=0.3)
    assert (world.row(0).state == "stable") == stable


def test_each_half_of_the_rule_is_switched_off_by_itself():
    wall = HashedEmbedder(size=8).embed_text(["wall"])[0]
    for thick, background, flat_m, stable in [
        (0.0, ("wall",), 0.0, False),  # by its looks
        (0.0, (), 0.04, False),  # by its shape
        (1.0, (), 0.04, True),
        (0.0, (), 0.0, True),
    ]:
        world = CheckedMap(observations=3, background=background, flat_m=flat_m)
        world.see((None, ELSEWHERE, "cup"))
        for n in range(4):
            world.see((1 if n else None, AT, None), feature=wall, thick=thick)
        assert (world.row(1).state == "stable") == stable


def test_background_that_gets_a_name_is_a_thing():
    for name in ("picture", None):
        world = CheckedMap(observations=3, split=False)
        world.see((None, AT, None), thick=0.0)
        for _ in range(4):
            world.see((0, AT, None), thick=0.0)
        assert world.objects[0].is_background
        if name is None:
            world.objects.relabel(0, "poster", np.ones(8) / np.sqrt(8))
        happened = [event for _ in range(8) for event in world.see((0, AT, name), thick=0.0)]
        assert happened == [("stable", 0)]
        assert not world.objects[0].is_background


def test_background_goes_once_it_is_out_of_view_and_is_folded_into_nothing():
    world = CheckedMap(observations=3, silent_keyframes=5, silent_seconds=0.0, merge=True, merge_every=1)
    world.see((None, AT, None), thick=0.0)
    for _ in range(3):
        world.see((0, AT, None), thick=0.0)
    assert world.see((None, AT + np.array([0.0, 0.0, 0.05]), "cup"), thick=0.0) == []
    assert watched(world, 4, (1, AT, "cup")) == [("stable", 1)]
    assert world.see((1, AT, "cup")) == [("removed", 0)]


@pytest.mark.parametrize("by", ["fold", "merge", "agent"])
def test_the_one_that_stays_was_seen_when_the_one_that_goes_was(by):
    world = CheckedMap(observations=50, silent_keyframes=5, silent_seconds=0.0, fold=by == "fold", merge=by == "merge", merge_every=7)
    book = (1, ELSEWHERE, "book")
    world.see((None, AT, "cup"), (None, ELSEWHERE, "book"))
    watched(world, 4, (0, AT, "cup"), book)
    world.see((None, AT, "cup"), book)
    watched(world, 2, (2, AT, "cup"), book)
    if by == "agent":
        merge_landmarks(0, 2, world.objects, world.smoother, "agent")
    assert world.ids() == [0, 1]
    assert watched(world, 5, book) == []
    assert world.see(book) == [("removed", 0)]


BOXES = arrays(np.float64, (2, 3), elements=st.sampled_from([-1.0, 0.0, 0.5, 1.0, 2.0])).map(lambda corners: np.sort(corners, axis=0))


@given(BOXES, BOXES, st.sampled_from([0.0, 0.05]))
def test_the_share_of_any_two_boxes_is_a_share(a, b, gap_m):
    share = shared_share(a, b[None], gap_m)[0]
    assert 0.0 <= share <= 1.0 + 1e-6
    assert share == pytest.approx(shared_share(b, a[None], gap_m)[0])
    assert shared_share(a, a[None], gap_m)[0] == pytest.approx(1.0)


def test_flat_boxes_share_their_area():
    flat, half = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]), np.array([[0.5, 0.0, 0.0], [1.5, 1.0, 0.0]])
    off, point = flat + np.array([0.0, 0.0, 0.1]), np.full((2, 3), 0.5) * [1.0, 1.0, 0.0]
    assert shared_share(flat, np.array([flat, half, off, point]), 0.0) == pytest.approx([1.0, 0.5, 0.0, 1.0], abs=1e-5)


def test_two_names_of_one_look_count_together():
    world = CheckedMap(observations=4, alike_cosine=-1.0)
    world.see((None, AT, "cup"))
    assert watched(world, 1, (0, AT, "mug"), (0, AT, "mug")) == []
    assert world.see((0, AT, "cup")) == [("stable", 0)]


def test_what_never_has_a_word_is_a_thing_too():
    world = CheckedMap(observations=6, background=())
    world.see((None, AT, None))
    assert watched(world, 5, (0, AT, None)) == [("stable", 0)]
    assert world.row(0).label == ""
    assert np.linalg.norm(world.row(0).embedding) > 0 or not world.row(0).embedding.any()


def test_what_was_seen_too_seldom_goes_after_a_while():
    world = CheckedMap(observations=8, silent_keyframes=10, silent_seconds=2.0)
    world.see((None, AT, "cup"), (None, ELSEWHERE, "book"))
    happened = watched(world, 10, (1, ELSEWHERE, "book"))
    assert ("removed", 0) not in happened
    assert world.see((1, ELSEWHERE, "book")) == [("removed", 0)]
    assert world.ids() == [1]
    assert world.smoother.positions()[0].tolist() == [1]


def test_silence_is_counted_in_seconds_too():
    world = CheckedMap(silent_keyframes=3, silent_seconds=10.0)
    world.see((None, AT, "cup"), (None, ELSEWHERE, "book"))
    assert ("removed", 0) not in watched(world, 19, (1, ELSEWHERE, "book"))
    assert world.see((1, ELSEWHERE, "book")) == [("removed", 0)]


def test_what_is_stable_stays_when_it_is_not_in_view():
    world = CheckedMap(observations=4, silent_keyframes=3, silent_seconds=0.0)
    world.see((None, AT, "cup"), (None, ELSEWHERE, "book"))
    watched(world, 5, (0, AT, "cup"), (1, ELSEWHERE, "book"))
    watched(world, 20, (1, ELSEWHERE, "book"))
    assert world.ids() == [0, 1]


@pytest.mark.parametrize("smoother", [None, GtsamSmoother], ids=["given poses", "gtsam"])
def test_two_things_taken_for_one_are_split_by_their_words(smoother):
    world = CheckedMap(smoother() if smoother else None, split_keyframes=6)
    world.see((None, AT, "cup"))
    both = ((0, AT, "cup"), (0, ASIDE, "book"))
    assert watched(world, 6, *both) == []
    assert world.see(*both)[0] == ("split", 1)
    cup, book = world.row(0), world.row(1)
    assert (cup.label, book.label) == ("cup", "book")
    assert np.allclose(cup.position_m, AT, atol=0.02)
    assert np.allclose(book.position_m, ASIDE, atol=0.02)
    ids, p_world = world.smoother.positions()
    assert ids.tolist() == [0, 1]
    assert np.allclose(p_world, [AT, ASIDE], atol=1e-3)
    assert (cup.observations, book.observations) == (8, 7)


def test_without_splitting_they_stay_one():
    world = CheckedMap(split=False)
    world.see((None, AT, "cup"))
    watched(world, 12, (0, AT, "cup"), (0, ASIDE, "book"))
    assert world.ids() == [0]


def test_words_that_take_turns_are_one_thing():
    world = CheckedMap(split_keyframes=2)
    world.see((None, AT, "cup"))
    for word in ("mug", "cup") * 8:
        assert ("split", 1) not in world.see((0, AT, word))


def test_observations_of_no_class_go_with_what_they_overlap():
    world = CheckedMap(split_keyframes=3)
    world.see((None, AT, "cup"))
    watched(world, 2, (0, ASIDE, None))
    watched(world, 4, (0, AT, "cup"), (0, ASIDE, "book"))
    assert world.ids() == [0, 1]
    assert world.objects[1].record.counts() == {"book": 4, "": 2}


def test_what_overlaps_can_be_merged_in_3d():
    apart = CheckedMap(merge=True, merge_every=1)
    apart.see((None, AT, "cup"), (None, ELSEWHERE, "cup"))
    assert apart.ids() == [0, 1]
    same = CheckedMap(merge=True, merge_every=1)
    assert same.see((None, AT, "cup"), (None, AT + 0.001, "mug")) == [("merged", 1)]
    assert same.ids() == [0]
    assert same.objects[0].record.counts() == {"cup": 1, "mug": 1}


@pytest.mark.parametrize("smoother", [None, GtsamSmoother], ids=["given poses", "gtsam"])
def test_splitting_and_merging_do_not_undo_each_other_for_ever(smoother):
    world = CheckedMap(smoother() if smoother else None, merge=True, merge_every=10, split_keyframes=3)
    world.see((None, AT, "cup"))
    happened = []
    for _ in range(50):
        words = dict(zip(world.ids(), ("cup", "tray"), strict=False))  # whatever there is of the two is found again
        happened += world.see(*((i, AT, word) for i, word in words.items()), *([(0, AT, "tray")] if len(words) == 1 else []))
    assert [kind for kind, _ in happened if kind in ("split", "merged")] == ["split", "merged"]
    assert world.ids() == [0]
    assert world.checks.passes(world.objects[0])  # two names, as often one as the other, but of one thing


def test_an_agents_merge_is_not_undone():
    world = CheckedMap(split_keyframes=3, fold=False)
    world.see((None, AT, "cup"), (None, ASIDE, "saucer"))
    merge_landmarks(0, 1, world.objects, world.smoother, "agent")
    assert ("split", 2) not in watched(world, 12, (0, AT, "cup"), (0, ASIDE, "saucer"))
    assert watched(world, 4, (0, AT, "cup"), (0, ELSEWHERE, "book"))[-1] == ("split", 2)  # which nobody has said to be one
    assert (set(world.objects[0].record.counts()), set(world.objects[2].record.counts())) == ({"cup", "saucer"}, {"book"})


def test_what_was_joined_stays_with_its_own():
    world = CheckedMap(split_keyframes=3, fold=False)
    world.see((None, AT, "cup"), (None, ASIDE, "saucer"))
    merge_landmarks(0, 1, world.objects, world.smoother, "agent")
    watched(world, 4, (0, AT, "cup"), (0, ASIDE + 0.01, "book"))
    assert world.ids() == [0, 2]
    assert world.objects[0].record.counts() == {"cup": 5, "saucer": 1}  # though the book is where the saucer was


def test_a_split_needs_both_sides():
    world = CheckedMap()
    world.see((None, AT, "cup"))
    with pytest.raises(MapError, match="seen as \\['cup'\\]"):
        world.objects.split(0, 9, {"book"})
    with pytest.raises(MapError, match="cannot be split"):
        world.objects.split(0, 9, {"cup"})
    assert world.ids() == [0]


def test_two_sides_of_a_thing_are_one_if_they_are_never_seen_at_once():
    world = CheckedMap()
    world.see((None, AT, "cup"))
    watched(world, 3, (0, AT, "cup"))
    side = AT + np.array([0.0, 0.08, 0.0])
    assert world.see((None, side, "cup")) == []
    assert watched(world, 2, (1, side, "cup")) == [("merged", 1)]
    assert world.ids() == [0]
    assert world.row(0).size_m[1] == pytest.approx(0.18, abs=0.02)


@pytest.mark.parametrize(("where", "word"), [(ELSEWHERE, "cup"), (ASIDE, "book")])
def test_what_does_not_touch_or_is_called_otherwise_stays_two(where, word):
    world = CheckedMap()
    world.see((None, AT, "cup"))
    watched(world, 3, (0, AT, "cup"))
    world.see((None, where, word))
    assert watched(world, 5, (1, where, word)) == []


def test_two_things_side_by_side_were_seen_at_once():
    world = CheckedMap(observations=20)
    world.see((None, AT, "cup"), (None, ASIDE, "cup"))
    watched(world, 6, (0, AT, "cup"), (1, ASIDE, "cup"))
    assert world.ids() == [0, 1]


def test_folding_can_be_switched_off_as_in_the_paper():
    world = CheckedMap(fold=False)
    world.see((None, AT, "cup"))
    watched(world, 3, (0, AT, "cup"))
    world.see((None, ASIDE, "cup"))
    assert watched(world, 5, (1, ASIDE, "cup")) == []


@pytest.mark.parametrize("smoother", [None, GtsamSmoother], ids=["given poses", "gtsam"])
def test_a_guessed_camera_adds_words_but_no_points(smoother):
    world = CheckedMap(smoother() if smoother else None, observations=6, split_keyframes=3, flat_m=0.0, background=())
    world.see((None, AT, "cup"))
    thing, cloud = world.objects[0], world.row(0).cloud_world
    for _ in range(4):
        world.see((0, AT + 0.02, "cup"), half_m=0.5, placed=False)
    np.testing.assert_array_equal(world.row(0).cloud_world, cloud)
    assert [len(kept) for kept in (thing.surface_views, thing.whole_sizes + thing.cut_sizes)] == [1, 1]
    assert (thing.observations, thing.record.counts()) == (5, {"cup": 5})
    assert world.see((0, AT, "cup"), placed=False) == [("stable", 0)]
    # split by measurements of both kinds: the smoother has one for each observation
    watched(world, 3, (0, AT, "cup"), (0, ASIDE, "book"))
    assert world.see((0, AT, "cup"), (0, ASIDE, "book"), placed=False)[0] == ("split", 1)
    np.testing.assert_allclose(world.row(1).position_m, ASIDE, atol=0.02)
    np.testing.assert_allclose(world.smoother.positions()[1][1], ASIDE, atol=1e-3)


def test_what_was_only_seen_by_a_guessed_camera_has_no_points():
    world = CheckedMap(observations=3, split_keyframes=3, background=())
    world.see((None, AT, "cup"))
    for _ in range(4):
        world.see((0, AT, "cup"), (0, ASIDE, "book"), (0, ASIDE, None), placed=False)
    assert world.ids() == [0, 1]
    assert (len(world.row(0).cloud_world) > 0, len(world.row(1).cloud_world)) == (True, 0)
    np.testing.assert_allclose(world.row(1).position_m, ASIDE, atol=1e-3)  # as the smoother has it
    assert len(world.objects.landmarks(world.smoother).clouds) == 2
    world.see((1, ASIDE, "book"))
    assert len(world.row(1).cloud_world) > 0


def test_what_is_silent_and_passes_is_asked_once(monkeypatch):
    world = CheckedMap(observations=4, silent_keyframes=3, silent_seconds=0.0)
    book = (1, ELSEWHERE, "book")
    world.see((None, AT, "cup"), (None, ELSEWHERE, "book"))
    watched(world, 5, (0, AT, "cup"), book)
    asked, passes = [], world.checks.passes
    monkeypatch.setattr(world.checks, "passes", lambda thing: asked.append(thing.id) or passes(thing))
    watched(world, 12, book)
    assert asked == [0]
    watched(world, 3, (0, AT, "bowl"), book)  # seen again, as something else: 6 of 9 are two thirds
    watched(world, 1, (0, AT, "bowl"), book)
    world.objects[0].state = "tentative"
    watched(world, 6, book)
    assert world.ids() == [1]


def test_background_joined_with_a_thing_is_judged_anew():
    world = CheckedMap(observations=3, silent_keyframes=50)
    world.see((None, AT, None), thick=0.0)
    for _ in range(4):
        world.see((0, AT, None), thick=0.0)
    world.see((None, AT, None))
    assert (world.objects[0].is_background, world.objects[1].is_background) == (True, False)
    merge_landmarks(0, 1, world.objects, world.smoother, "agent")
    assert not world.objects[0].is_background
    assert world.see((0, AT, None)) == [("stable", 0)]


def test_a_continued_things_distance_is_not_known_and_its_surface_is():
    world = CheckedMap(background=(), noise_at_1m_m=0.0057)
    far = AT + np.array([6.0, 0.0, 0.0])
    cube = far + np.random.default_rng(2).uniform(-0.1, 0.1, (200, 3))
    landmark = replace(make_landmark(0), label="", labels={}, position_m=far, cloud_world=cube)
    world.objects.restore(landmark, T_WORLD_FIRST)
    assert world.objects[0].record.blur_m() == 0.0
    assert not world.checks._is_background(world.objects[0])
    surface = world.objects[0].surface()
    assert np.ptp(surface, axis=0) == pytest.approx([0.2] * 3, abs=0.05)
    assert surface.mean(axis=0) == pytest.approx([0.0] * 3, abs=0.05)


def test_each_half_of_a_split_has_its_own_sightings_and_surface():
    world = CheckedMap(observations=4)
    world.see((None, AT, "cup"))
    while len(world.ids()) == 1:
        world.see((0, AT, "cup"), (0, ASIDE, "book"))
        world.objects[0].sightings.hits = world.keyframes
        assert world.keyframes < 12
    for one in (world.objects[i] for i in world.ids()):
        assert 0 < one.sightings.hits <= one.observations < world.keyframes + 1
        assert np.abs(one.surface()).max() < 0.1
        assert one.looks == []


@pytest.mark.parametrize(("state", "stays"), [("stable", True), ("tentative", False)])
def test_what_a_continued_map_trusted_is_not_doubted_unseen(state, stays):
    """Other presets trust what was seen three times; here eight are wanted."""
    landmark = replace(make_landmark(0), observations=3, state=state, last_seen_s=0.0, position_m=ELSEWHERE)
    world = CheckedMap(observations=8, silent_keyframes=10, silent_seconds=2.0, background=(), before=landmark)
    world.see((None, AT, "book"))
    watched(world, 20, (1, AT, "book"))
    assert world.ids() == ([0, 1] if stays else [1])


def test_silence_is_not_waited_for_by_the_clock_of_another_day():
    """The stamps of a continued map may be later than those of the recording that goes on with it."""
    landmark = replace(make_landmark(0), observations=2, state="tentative", last_seen_s=1.7e9, position_m=ELSEWHERE)
    world = CheckedMap(observations=8, silent_keyframes=10, silent_seconds=5.0, background=(), before=landmark)
    world.see((None, AT, "book"))
    watched(world, 20, (1, AT, "book"))
    assert world.ids() == [1]
