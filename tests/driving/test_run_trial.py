"""A home is mapped, a robot is sent for something, and the truth judges where it stopped."""

import json
from dataclasses import replace

import numpy as np
import pytest
from driven_homes import EVERY, apartment, mapped

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.driving.errand import errand, moves_in_words
from seo_slam.driving.home_map import MappingSettings, map_home
from seo_slam.driving.judging import distance_m
from seo_slam.driving.mappers import mapper_named
from seo_slam.driving.pictures import write_picture
from seo_slam.driving.run_trial import DriveOptions, run_trial
from seo_slam.driving.trials import START_AWAY_M, bearing
from seo_slam.driving.true_mapper import TrueMapper
from seo_slam.errors import ConfigError, MapError
from seo_slam.map import Map
from seo_slam.settings.navigation import NavigationSettings
from seo_slam.simulation.resting import anchors_of


def driven(trial, make_mapper=TrueMapper, **settings):
    return run_trial(
        apartment(),
        mapped(),
        trial,
        make_mapper=make_mapper,
        embedder=HashedEmbedder(),
        settings=NavigationSettings(**settings),
        options=DriveOptions(rate_hz=3.0),
    )


class LostMapper(TrueMapper):
    """Its odometry is lost from the first frame on."""

    def step(self, frame):
        return replace(super().step(frame), odometry_status="lost")


class BlindMapper(TrueMapper):
    """It is never shown anything."""

    def show(self, timestamp_s, view):
        """See nothing."""


def easy_trial():
    """A small thing with a word of its own."""
    world = apartment().world
    thing = next(t for t in world.things if t.kind == "volatile" and len(bearing(world, t.label)) == 1 and anchors_of(world)[t.id])
    return errand(apartment(), f"the {thing.label}", seed=1), thing


def test_the_map_of_a_home_has_its_things_where_they_are():
    world, abstract = apartment().world, mapped().abstract
    assert len(mapped().landmarks) > 0.8 * len(world.things)
    for row in mapped().landmarks:
        assert distance_m(world.thing(row.id), row.position_m) < 0.5
    assert abstract.layout is not None
    free = apartment().free
    open_floor = free.middles(np.argwhere(free.clearance_m > 0.4))
    cells = abstract.layout.cells(open_floor)
    inside = ((cells >= 0) & (cells < abstract.layout.floor.shape)).all(axis=1)
    seen = abstract.layout.floor[tuple(cells[inside].T)]
    assert inside.all()
    assert seen.mean() > 0.7
    assert not abstract.layout.obstacles[tuple(cells.T)].any()


def test_a_map_that_is_kept_is_taken(tmp_path):
    settings = MappingSettings(every=EVERY * 20)
    made = map_home(apartment(), TrueMapper, HashedEmbedder(), settings, tmp_path)
    asked = []

    def never(*parts):
        asked.append(parts)

    again = map_home(apartment(), never, HashedEmbedder(), settings, tmp_path)
    assert not asked
    assert len(again) == len(made)
    assert [a.label for a in again.abstract.anchors] == [a.label for a in made.abstract.anchors]
    with pytest.raises(ConfigError, match="every 0"):
        map_home(apartment(), TrueMapper, HashedEmbedder(), MappingSettings(every=0))


def test_a_bar_is_given_every_frame():
    seen = []

    def progress(frames):
        for frame in frames:
            seen.append(frame)
            yield frame

    map_home(apartment(), TrueMapper, HashedEmbedder(), MappingSettings(every=150), progress=progress)
    assert seen == list(range(0, len(apartment()), 150))


def test_the_robot_finds_a_thing_that_stands_where_it_was(tmp_path):
    trial, thing = easy_trial()
    result = driven(trial)
    drive = result.drive
    assert drive.is_success, result.outcome.reason
    assert drive.failure is None
    np.testing.assert_allclose(result.xy_world[0], trial.start_xy, atol=1e-9)
    assert drive.distance_m == pytest.approx(distance_m(thing, result.xy_world[-1]))
    assert drive.believed_m < 0.3
    assert drive.mapped
    assert drive.retrieved_object_m < 0.3
    assert drive.shortest_m > START_AWAY_M - 1.2
    assert drive.driven_m > drive.shortest_m - 0.3
    walked_m = np.linalg.norm(np.diff(result.xy_world, axis=0), axis=1).sum()
    assert walked_m <= drive.driven_m + 1e-6
    row = json.loads(json.dumps(result.as_dict()))
    assert row["success"] is True
    assert row["trial"]["query"] == trial.query
    assert len(row["log"]) == drive.attempts
    assert row["log"][0]["planned_m"] >= 0.0
    picture = write_picture(mapped(), result, tmp_path / "search.svg", "a search").read_text()
    assert picture.count('class="path"') == 2  # the way, and in the legend
    assert "a search" in picture
    assert thing.label in picture


@pytest.mark.parametrize("make_mapper", [TrueMapper, LostMapper])
def test_a_drive_that_is_cut_short_gave_up(make_mapper):
    trial, _ = easy_trial()
    result = driven(trial, make_mapper, max_steps=2)
    assert (result.drive.ending, result.drive.failure) == ("gave_up", "gave up")
    assert "in 2 frames" in result.outcome.reason
    np.testing.assert_allclose(result.xy_world[-1], trial.start_xy, atol=0.5)


def test_a_drive_that_runs_out_of_frames_keeps_what_was_tried():
    trial, _ = easy_trial()
    result = driven(trial, BlindMapper, max_steps=120)
    assert result.drive.ending == "gave_up"
    assert result.drive.attempts == result.outcome.places_gone_to > 0
    assert all(row["reason"] for row in result.as_dict()["log"])


def test_what_nothing_is_called_is_not_found():
    trial = errand(apartment(), "qzxv")
    assert trial.target_ids == ()
    result = driven(trial, max_steps=4)
    assert not result.outcome.found
    assert result.target_world is None
    assert json.loads(json.dumps(result.as_dict()))["distance_m"] is None


def test_a_map_without_an_abstract_one_is_refused():
    trial, _ = easy_trial()
    with pytest.raises(MapError, match="abstract"):
        run_trial(apartment(), Map(), trial, make_mapper=TrueMapper, embedder=HashedEmbedder())


@pytest.mark.parametrize("kind", ["in_anchor", "cross_anchor"])
def test_an_errand_moves_what_it_asks_for(kind):
    plain, thing = easy_trial()
    trial = errand(apartment(), plain.query, kind, seed=2)
    assert [thing_id for thing_id, _ in trial.moved] == [thing.id]
    (line,) = moves_in_words(apartment().world, trial)
    assert line.startswith(f"{thing.label}: ")
    assert ("elsewhere on" in line) == (kind == "in_anchor")
    assert errand(apartment(), plain.query, kind, seed=2) == trial
    assert errand(apartment(), plain.query, kind, seed=3) != trial


def test_an_errand_for_furniture_moves_other_things():
    furniture = next(thing for thing in apartment().world.things if thing.kind == "anchor")
    trial = errand(apartment(), furniture.label, "in_anchor")
    assert trial.moved
    assert not {thing_id for thing_id, _ in trial.moved} & set(trial.target_ids)


def test_pictures_and_mappers_have_names(tmp_path):
    trial, _ = easy_trial()
    result = driven(trial, max_steps=1)
    with pytest.raises(ConfigError, match=r"\.svg"):
        write_picture(mapped(), result, tmp_path / "search.png")
    with pytest.raises(ConfigError, match="no folder"):
        write_picture(mapped(), result, tmp_path / "nowhere" / "search.svg")
    with pytest.raises(ConfigError, match="'lidar'"):
        mapper_named("lidar")
    assert replace(result.drive, ending="found").failure in ("false match", "not mapped")


def test_a_robot_that_starts_where_the_map_knows_no_floor_looks_around_for_some():
    """The tour did not look there: what the robot sees of the floor as it turns leads it to the floor of the map."""
    trial, _ = easy_trial()
    abstract = mapped().abstract
    layout = abstract.layout
    away_m = np.linalg.norm(layout.middles(np.argwhere(np.ones_like(layout.floor))) - trial.start_xy, axis=1).reshape(layout.floor.shape)
    holed = replace(abstract, layout=replace(layout, floor=layout.floor & (away_m > 1.6)))

    def run(grow_floor):
        return run_trial(
            apartment(),
            mapped().with_abstract(holed),
            trial,
            make_mapper=TrueMapper,
            embedder=HashedEmbedder(),
            settings=NavigationSettings(grow_floor=grow_floor),
            options=DriveOptions(rate_hz=3.0),
        )

    found = run(True)
    assert found.drive.is_success, found.outcome.reason
    assert found.drive.collisions == 0
    assert run(False).outcome.ending == "bad_start"
