"""Scores of a segmentation: worked by hand, laws, and what is said of bad input."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from labelled_lines import NAMES, OneWordOneAxis, feature, line, thing, truth, words

from seo_slam.errors import EvaluationError
from seo_slam.evaluation.class_words import ClassWords
from seo_slam.evaluation.labelled_points import LabelledCloud
from seo_slam.evaluation.segmentation import PredictedObject, evaluate_segmentation, majority
from seo_slam.evaluation.segmentation_protocols import CONCEPTGRAPHS, DUALMAP, HOVSG, PROTOCOLS, protocols_named
from seo_slam.evaluation.segmentation_scores import over_scenes

THREE = (DUALMAP, HOVSG, CONCEPTGRAPHS)


def scored(objects, protocol=DUALMAP, true=None):
    return evaluate_segmentation(objects, true or truth(), words(), [protocol])[0]


def perfect():
    return [thing(name, name) for name in ("chair", "table", "door")]


def test_one_prediction_has_three_scores():
    """The table looks more like a lamp than like a table, and the door is called a wall.

    DualMap counts chair, table and door (12 points) and takes the mean over these and the predicted lamp and wall: 1 / 5.
    HOV-SG counts chair and table (8 points): 1 / 2. ConceptGraphs too, but the table cannot be a lamp, for there is none: 2 / 2.
    """
    objects = [thing("chair", "chair"), thing("table", feature(lamp=0.8, table=0.6)), thing("door", "wall")]
    dualmap, hovsg, conceptgraphs = evaluate_segmentation(objects, truth(), words(), THREE)
    assert (dualmap.miou, dualmap.fmiou, dualmap.macc) == pytest.approx((1 / 5, 4 / 12, 1 / 3))
    assert (hovsg.miou, hovsg.fmiou, hovsg.macc) == pytest.approx((1 / 2, 4 / 8, 1 / 2))
    assert (conceptgraphs.miou, conceptgraphs.fmiou, conceptgraphs.macc) == pytest.approx((1.0, 1.0, 1.0))
    assert dualmap.called_by_name == ("chair", "lamp", "wall")
    assert conceptgraphs.called_by_name[:2] == ("chair", "table")
    assert {row.name: (row.iou, row.is_dropped) for row in dualmap.per_class} == {
        "chair": (1.0, False),
        "door": (0.0, False),
        "lamp": (0.0, False),
        "table": (0.0, False),
        "wall": (0.0, True),
    }
    assert (dualmap.counts.predicted, dualmap.counts.objects, dualmap.counts.odr) == (2, 3, pytest.approx(2 / 3))
    assert (hovsg.counts.predicted, hovsg.counts.objects) == (2, 2)
    assert (conceptgraphs.counts.predicted, conceptgraphs.counts.objects) == (3, 2)


def test_five_neighbours_outvote_the_nearest():
    """A stray point called table lies right on a point of the chair: one neighbour believes it, five do not."""
    stray = PredictedObject(line("chair")[:1] + np.array([0.0, 0.001, 0.0]), label="table")
    objects = [thing("chair", "chair"), stray, thing("table", "table")]
    shifted = truth(("chair", "table"))
    shifted = replace(shifted, p_world=shifted.p_world + np.array([0.0, 0.002, 0.0]))
    of_five, of_one = evaluate_segmentation(objects, shifted, words(), (DUALMAP, CONCEPTGRAPHS))
    assert of_five.miou == 1.0
    assert of_one.miou == pytest.approx((3 / 4 + 4 / 5) / 2)
    assert of_one.fmiou == pytest.approx(0.5 * 3 / 4 + 0.5 * 4 / 5)
    assert of_one.macc == pytest.approx((3 / 4 + 1) / 2)


def test_of_equally_many_neighbours_the_smaller_class_wins():
    assert majority(np.array([[4, 4, 1, 1, 3], [2, 2, 2, 0, 0], [3, 1, 4, 2, 9], [7, 7, 7, 7, 7]])).tolist() == [1, 2, 1, 7]


@given(st.lists(st.lists(st.integers(0, 4), min_size=5, max_size=5), min_size=1, max_size=20))
def test_a_majority_is_that_of_counting(rows):
    counted = [int(np.bincount(row).argmax()) for row in rows]
    assert majority(np.array(rows)).tolist() == counted


@pytest.mark.parametrize("protocol", THREE, ids=lambda protocol: protocol.name)
def test_a_perfect_map_scores_one(protocol):
    result = scored(perfect(), protocol)
    assert (result.miou, result.fmiou, result.macc, result.covered) == (1.0, 1.0, 1.0, 1.0)


@pytest.mark.parametrize("protocol", THREE, ids=lambda protocol: protocol.name)
def test_an_empty_map_scores_zero(protocol):
    result = scored([], protocol)
    assert (result.miou, result.fmiou, result.macc, result.covered) == (0.0, 0.0, 0.0, 0.0)
    assert (result.counts.odr, result.counts.missed, result.counts.swallowed) == (0.0, result.counts.objects, 0)


@given(st.lists(st.sampled_from(NAMES), min_size=3, max_size=3))
def test_all_scores_are_shares(labels):
    for result in evaluate_segmentation(
        [thing(place, label) for place, label in zip(("chair", "table", "door"), labels, strict=True)], truth(), words(), THREE
    ):
        assert all(0.0 <= value <= 1.0 for value in (result.miou, result.fmiou, result.macc))
        assert result.confusion.sum() == sum(row.true_points for row in result.per_class)


def test_a_thing_in_two_pieces_is_one_and_a_duplicate():
    counts = scored([thing("chair", "chair", slice(2)), thing("chair", "chair", slice(2, 4)), *perfect()[1:]]).counts
    assert (counts.predicted, counts.objects, counts.matched, counts.duplicates, counts.missed) == (4, 3, 3, 1, 0)
    assert counts.odr == pytest.approx(4 / 3)


def test_of_several_things_in_one_object_one_is_found_and_the_others_are_swallowed():
    both = PredictedObject(np.concatenate([line("chair"), line("table")[:3]]), label="chair")
    counts = scored([both, thing("door", "door")]).counts
    assert (counts.matched, counts.missed, counts.swallowed, counts.of_nothing) == (2, 1, 1, 0)
    three = PredictedObject(np.concatenate([line("chair"), line("table"), line("door")]), label="chair")
    counts = scored([three]).counts
    assert (counts.matched, counts.of_nothing, counts.missed, counts.swallowed) == (1, 0, 2, 2)


def test_a_small_thing_whose_cloud_spills_over_its_table_is_found():
    """Half of the points of a banana lie on the table: it is still the banana."""
    x = 0.02 * np.arange(200)
    table = np.column_stack([x, np.zeros((200, 2))])
    banana = np.column_stack([x[:6], np.zeros(6), np.full(6, 0.04)])
    ids = np.repeat([3, 0], [200, 6])
    small = LabelledCloud(np.concatenate([table, banana]), ids + 1, ids, NAMES)
    objects = [PredictedObject(table[8:], label="table"), PredictedObject(np.concatenate([banana, table[:8]]), label="chair")]
    counts = scored(objects, true=small).counts
    assert (counts.matched, counts.duplicates, counts.missed, counts.rightly_called) == (2, 0, 0, 2)


def test_an_object_in_the_air_is_of_nothing():
    in_the_air = PredictedObject(line("chair") + np.array([0.0, 0.0, 3.0]), label="chair")
    counts = scored([*perfect(), in_the_air]).counts
    assert (counts.of_nothing, counts.matched, counts.duplicates) == (1, 3, 0)


def test_a_missing_thing_is_missed_though_its_points_get_a_class():
    result = scored(perfect()[:2])
    assert (result.counts.missed, result.counts.swallowed) == (1, 0)
    assert result.covered == pytest.approx(8 / 12)
    assert {row.name: row.iou for row in result.per_class}["table"] == pytest.approx(4 / 8)  # the door's points go to the table


def test_a_piece_of_wall_counts_unless_it_is_called_one():
    assert scored([*perfect(), thing("wall", "wall")]).counts.odr == 1.0
    called_lamp = scored([*perfect(), thing("wall", "lamp")])
    assert (called_lamp.counts.odr, called_lamp.counts.of_dropped) == (pytest.approx(4 / 3), 1)
    assert called_lamp.miou == 1.0  # no true point that counts is near it


def test_what_nobody_saw_five_times_does_not_count_as_missed():
    counts = scored(perfect()[:2], true=truth(visible_keyframes={0: 9, 30: 5, 10: 4, 40: 9})).counts
    assert (counts.visible, counts.odr, counts.odr_objects) == (2, 1.0, pytest.approx(2 / 3))
    assert (counts.missed, counts.missed_visible) == (1, 0)


def test_an_object_without_feature_and_label_has_no_class():
    result = scored([*perfect()[:2], thing("door")])
    assert result.called_by_name == ("chair", "table", "(no class)")
    assert result.counts.unnamed == 1
    assert result.miou == pytest.approx((1 + 1 + 0 + 0) / 4)  # chair, table, door, and no class as a class of its own
    assert result.per_class[-1].name == "(no class)"


def test_points_without_a_label_are_left_out():
    known = truth(("chair",))
    class_ids, instance_ids = known.class_ids.copy(), known.instance_ids.copy()
    class_ids[2:], instance_ids[2:] = -1, -1
    result = scored([thing("chair", "chair")], true=replace(known, class_ids=class_ids, instance_ids=instance_ids))
    assert result.confusion.sum() == 2
    assert result.counts.objects == 1


def test_a_thing_has_the_class_of_most_of_its_points():
    p_world = np.arange(15.0).reshape(5, 3)
    cloud = LabelledCloud(p_world, np.array([1, 1, 1, 2, 2]), np.array([3, 0, 3, 4, 1]), NAMES)
    assert cloud.instances == {1: 3, 2: 1}


def test_scenes_are_averaged_or_added_up():
    """Scene 1 is perfect (8 points count by ConceptGraphs), scene 2 has a chair only, which is called a table."""
    first, second = perfect(), [thing("chair", "table")]
    by_mean = [scored(first), scored(second, true=truth(("chair", "table")))]
    assert over_scenes(by_mean).miou == pytest.approx((1.0 + by_mean[1].miou) / 2)
    added = over_scenes([scored(first, CONCEPTGRAPHS), scored(second, CONCEPTGRAPHS, truth(("chair", "table")))])
    # chair: 4 of 8 points right; table: 8 right, and 4 of the chair's: 8 / 12
    assert added.miou == pytest.approx((4 / 8 + 8 / 12) / 2)
    assert added.macc == pytest.approx((4 / 8 + 1) / 2)
    assert added.fmiou == pytest.approx(0.5 * 4 / 8 + 0.5 * 8 / 12)
    assert (added.odr, added.odr_error) == (pytest.approx((3 / 2 + 1 / 2) / 2), pytest.approx(0.5))


def test_classes_of_several_scenes_are_joined_by_name():
    other = tuple(reversed(NAMES))
    turned = replace(truth(), class_ids=len(NAMES) - 1 - truth().class_ids, class_names=other)
    result = evaluate_segmentation(perfect(), turned, ClassWords.of(other, OneWordOneAxis()), [CONCEPTGRAPHS])[0]
    assert over_scenes([result, scored(perfect(), CONCEPTGRAPHS)]).miou == 1.0


def test_a_result_states_what_a_reader_needs():
    content = json.loads(json.dumps(scored(perfect()).as_dict()))
    assert content["protocol"] == "segmentation/dualmap"
    assert content["dropped_classes"] == ["wall"]
    assert content["class_names"] == list(NAMES)
    assert content["embedder"] == "one word one axis"
    assert content["templates"][0] == "{}"
    assert {"miou", "fmiou", "macc", "odr", "matched", "duplicates", "missed", "per_class", "counted"} <= content.keys()


def test_doors_count_in_one_protocol_only_and_words_drop_by_part_or_by_name():
    assert [protocol.drops("door") for protocol in THREE] == [False, True, True]
    assert [protocol.drops("wall shelf") for protocol in THREE] == [True, True, False]
    assert [protocol.drops("Ceiling") for protocol in THREE] == [True, True, True]
    assert [protocol.drops("vent") for protocol in THREE] == [True, False, False]


def test_protocols_are_named_shortly_or_in_full():
    assert protocols_named("all") == THREE == tuple(PROTOCOLS.values())
    assert protocols_named("hovsg, segmentation/dualmap,hovsg") == (HOVSG, DUALMAP)
    with pytest.raises(EvaluationError, match="got 'dualmap2', wanted conceptgraphs, dualmap, hovsg or all"):
        protocols_named("dualmap2")


@pytest.mark.parametrize(
    ("objects", "message"),
    [
        ([PredictedObject(np.zeros((0, 3)), name="landmark 7")], r"landmark 7: got a cloud of shape \(0, 3\), wanted"),
        ([PredictedObject(np.zeros((4, 2)))], r"object 0: got a cloud of shape \(4, 2\)"),
        ([PredictedObject(np.full((1, 3), math.nan), label="chair")], "object 0: its cloud holds NaN"),
        ([PredictedObject(np.zeros((1, 3)), np.ones(3))], r"got a feature of shape \(3,\), wanted \(5,\) as of one word one axis"),
        ([PredictedObject(np.zeros((1, 3)), np.full(5, math.inf))], "its feature holds NaN or infinity"),
    ],
)
def test_bad_objects_are_refused(objects, message):
    with pytest.raises(EvaluationError, match=message):
        scored(objects)


def test_bad_truth_is_refused():
    with pytest.raises(EvaluationError, match="truth: got no points"):
        LabelledCloud(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), NAMES)
    ones = np.ones(4, dtype=np.int64)
    with pytest.raises(EvaluationError, match=r"shapes \(4, 3\), \(4,\) and \(3,\)"):
        LabelledCloud(line("chair"), ones, ones[:3], NAMES)
    with pytest.raises(EvaluationError, match=r"class ids 1\.\.5, wanted -1\.\.4"):
        LabelledCloud(line("chair"), ones, np.array([1, 1, 1, 5]), NAMES)
    with pytest.raises(EvaluationError, match="point 2 is"):
        LabelledCloud(np.where(np.arange(12).reshape(4, 3) == 7, np.nan, 0.0), ones, ones, NAMES)
    with pytest.raises(EvaluationError, match="got 'chair' more than once"):
        LabelledCloud(line("chair"), ones, ones, ("chair", "table", "chair"))
    with pytest.raises(EvaluationError, match="number 1 is ' '"):
        LabelledCloud(line("chair"), ones, ones, ("chair", " "))


def test_words_must_be_those_of_the_truth():
    with pytest.raises(EvaluationError, match="class words: got chair, table, wanted those of the truth: chair, door"):
        evaluate_segmentation(perfect(), truth(), ClassWords.of(("chair", "table"), OneWordOneAxis()), THREE)
    with pytest.raises(EvaluationError, match="templates: got"):
        ClassWords.of(NAMES, OneWordOneAxis(), ["a thing"])


def test_a_truth_of_walls_alone_cannot_be_scored():
    with pytest.raises(EvaluationError, match=r"segmentation/dualmap: got no true points but those of dropped classes \(wall\)"):
        scored(perfect(), true=truth(("wall",)))


def test_scenes_of_two_protocols_are_not_put_together():
    with pytest.raises(EvaluationError, match="segmentation/dualmap, segmentation/hovsg, wanted those of one"):
        over_scenes([scored(perfect()), scored(perfect(), HOVSG)])
    with pytest.raises(EvaluationError, match="no protocol"):
        over_scenes([])
