"""DualMap's preset in the pipeline: clouds, words, lost frames, continued maps, and the abstract map that comes with the result."""

import sys

import numpy as np
import pytest

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.errors import MissingBackendError
from seo_slam.map import Map
from two_boxes import LEFT, RIGHT, Says, Standing, frames, mapped, pipeline


def both(index):
    return [("table", LEFT), ("cup", RIGHT)]


def by_label(made):
    return {row.label: row for row in made.landmarks}


@pytest.mark.parametrize("preset", ["dualmap", "dualmap_estimated_poses"])
def test_two_things_with_clouds_where_they_are(preset):
    made = by_label(mapped(pipeline(both, preset=preset)))
    assert sorted(made) == ["cup", "table"]
    np.testing.assert_allclose(made["table"].position_m, [-0.6, 1.5, 1.2], atol=0.03)
    np.testing.assert_allclose(made["cup"].position_m, [0.6, 1.5, 1.2], atol=0.03)
    assert len(made["cup"].cloud_world) > 300
    assert made["cup"].size_m[0] == pytest.approx(0.6, abs=0.05)


def test_the_result_has_an_abstract_map_and_a_snapshot_has_none():
    running = pipeline(both)
    made = mapped(running)
    assert [anchor.label for anchor in made.abstract.anchors] == ["table"]
    assert made.abstract.layout.floor.any()
    assert running.snapshot().abstract is None
    assert mapped(pipeline(both, "layout.enabled=false")).abstract is None


def test_seeing_the_same_again_costs_no_memory():
    running = pipeline(both)
    points = []
    for frame in frames(60):
        running.step(frame)
        points.append(sum(len(row.cloud_world) for row in running.snapshot().landmarks))
    assert points[20] == points[-1] > 0


@pytest.mark.parametrize("classes", [[0, 2, 5], {0: "table", 41: "cup"}, np.array(["table", "cup"]), "my_words.txt"])
@pytest.mark.parametrize("preset", ["dualmap", "seo_slam_no_agents"])
def test_a_detector_may_hold_anything_under_the_name_classes(monkeypatch, preset, classes):
    monkeypatch.setattr(Says, "classes", classes, raising=False)
    assert sorted(by_label(mapped(pipeline(both, preset=preset)))) == ["cup", "table"]


@pytest.mark.parametrize("said", ["cafe\u0301", "caf\u00e9"])
@pytest.mark.parametrize("wanted", ["cafe\u0301", "caf\u00e9"])
def test_a_class_is_kept_however_its_accent_is_spelt(said, wanted):
    settings = f'features.classes=["{wanted}"]', "features.only_classes=true"
    made = mapped(pipeline(lambda i: [(said, LEFT), ("cup", RIGHT)], *settings))
    assert list(by_label(made)) == ["caf\u00e9"]


@pytest.mark.parametrize(("settings", "stays"), [((), False), (("status.existence=false",), True), (("life.enabled=false",), True)])
def test_what_is_in_sight_and_not_found_any_more_is_lost_unless_misses_do_not_count(settings, stays):
    made = mapped(pipeline(lambda i: both(i) if i < 20 else both(i)[:1], *settings), 90)
    assert sorted(by_label(made)) == (["cup", "table"] if stays else ["table"])


def test_lost_frames_leave_the_clouds_as_they_are():
    steady = by_label(mapped(pipeline(both), 30))
    lost = by_label(mapped(pipeline(both, odometry=Standing(lost=range(20, 30), drift_m=0.05)), 30))
    np.testing.assert_allclose(lost["cup"].size_m, steady["cup"].size_m, atol=1e-6)
    assert len(lost["cup"].cloud_world) == len(steady["cup"].cloud_world)


def test_a_continued_map_goes_on_whatever_it_was_called():
    made = mapped(pipeline(lambda i: [("cup" if i % 5 else "mug", LEFT)]), 20)
    again = pipeline(lambda i: [("bowl", RIGHT)], map=made)
    grown = mapped(again, 30)  # the cup is not in view: it is checked all the same
    assert sorted(by_label(grown)) == ["bowl", "cup"]
    assert by_label(grown)["cup"].observations == by_label(made)["cup"].observations
    np.testing.assert_allclose(by_label(grown)["cup"].position_m, by_label(made)["cup"].position_m, atol=0.01)


def test_a_continued_map_finds_its_things_again():
    made = mapped(pipeline(both))
    again = mapped(pipeline(both, map=made))
    assert [(row.id, row.label) for row in again.landmarks] == [(row.id, row.label) for row in made.landmarks]
    assert by_label(again)["cup"].observations == 2 * by_label(made)["cup"].observations


def test_a_continued_map_without_its_clouds_makes_no_doubles(tmp_path):
    mapped(pipeline(both)).save(tmp_path)
    (tmp_path / "clouds.ply").unlink()
    again = mapped(pipeline(both, map=Map.load(tmp_path)))
    assert sorted(row.label for row in again.landmarks) == ["cup", "table"]


def test_the_floor_of_a_continued_map_grows():
    made = mapped(pipeline(both))
    grown = mapped(pipeline(both, odometry=Standing(at_x_m=20.0), map=made))
    assert len(grown.abstract.anchors) == 2
    before, after = made.abstract.layout, grown.abstract.layout
    assert after.floor.sum() > 1.5 * before.floor.sum()
    rows = after.cells(np.array([anchor.xy_world for anchor in grown.abstract.anchors]))
    assert ((rows >= 0) & (rows < after.floor.shape)).all()


class Jumping(Standing):
    """Its pose is 30 km away in one frame."""

    def update(self, frame):
        self.at_x_m = 3e4 if frame.index == 12 else 0.0
        return super().update(frame)


def test_a_pose_that_jumped_costs_neither_the_layout_nor_the_map(tmp_path):
    made = mapped(pipeline(both))
    with pipeline(both, odometry=Jumping()) as running:
        for frame in frames(20):
            running.step(frame)
        result = running.result()
    (told,) = (text for text in result.warnings if text.startswith("layout: "))
    assert "has a pose jumped?" in told
    layout = Map.load(result.map.save(tmp_path)).abstract.layout
    assert layout.floor.shape == made.abstract.layout.floor.shape
    assert layout.floor[made.abstract.layout.floor].all()


def test_a_map_that_is_continued_far_off_keeps_its_floor():
    made = mapped(pipeline(both))
    with pipeline(both, odometry=Standing(at_x_m=3e4), map=made) as running:
        for frame in frames(20):
            running.step(frame)
        result = running.result()
    assert any(text.startswith("layout: the floor that was seen now is left out") for text in result.warnings)
    np.testing.assert_array_equal(result.map.abstract.layout.floor, made.abstract.layout.floor)


def test_with_another_embedder_the_abstract_map_is_made_anew():
    class Other(HashedEmbedder):
        name = "other"

    made = mapped(pipeline(both))
    assert made.with_embeddings(Other(size=16)).abstract.embedder == "other"
    assert mapped(pipeline(both, embedder=Other(size=16), map=made)).abstract.embedder == "other"


def test_with_an_embedder_of_another_size_the_abstract_map_is_made_anew():
    made, short = mapped(pipeline(both)), HashedEmbedder(size=64)
    (anchor,) = made.with_embeddings(short).abstract.anchors
    assert anchor.feature.tolist() == short.embed_text(["table"])[0].tolist()
    again = mapped(pipeline(both, embedder=short, map=made))
    assert {row.feature.shape for row in again.abstract.anchors} == {(64,)}
    assert sorted(by_label(again)) == ["cup", "table"]


def test_without_the_extra_it_says_so_before_anything_is_mapped(monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage.segmentation", None)
    monkeypatch.delitem(sys.modules, "seo_slam.abstraction.rooms", raising=False)
    with pytest.raises(MissingBackendError, match=r"seo-slam\[nav\]"):
        pipeline(both)
    assert mapped(pipeline(both, "layout.enabled=false"), 3).abstract is None


def test_the_map_says_how_its_features_were_made():
    class Looks(HashedEmbedder):
        def embed_image(self, images):
            return self.embed_text(["picture"] * len(images))

    assert mapped(pipeline(both)).features.in_words == "words only"
    looking = pipeline(both, embedder=Looks())
    expected = looking.snapshot().features  # a navigator asks before the first frame
    assert expected.in_words == "0.7 pictures (Looks:hashed) and 0.3 words"
    assert mapped(looking).features == expected
    assert mapped(pipeline(both, preset="seo_slam_no_agents")).features is None
