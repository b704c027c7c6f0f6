"""``seo-slam navigate``: a map and words in, attempts and the truth out; the exit status says whether it was found."""

import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "driving"))
from driven_homes import apartment, mapped

from seo_slam.driving import home_map, homes
from seo_slam.map import Map
from seo_slam.navigation.navigator import Navigator
from seo_slam.simulation.resting import anchors_of

SMALL = ("--world", "apartment:10", "--size", "96x72", "--senses", "true", "--level", "0")


@pytest.fixture(scope="module")
def map_folder(tmp_path_factory):
    return mapped().save(tmp_path_factory.mktemp("map")).parent


@pytest.fixture
def planned(monkeypatch):
    """The home that the other tests of this run have planned already; what the command asks for is right."""

    def home_named(*asked):
        assert asked == ("apartment:10", 0.0, None, (96, 72))
        return apartment()

    monkeypatch.setattr(homes, "home_named", home_named)


def carried():
    """A small thing with a word of its own that stands on furniture."""
    world = apartment().world
    labels = [word for thing in world.things for word in (thing.label, *thing.accepted_labels)]
    return next(t for t in world.things if t.kind == "volatile" and labels.count(t.label) == 1 and anchors_of(world)[t.id])


def test_a_thing_is_found_and_the_way_is_drawn(run, map_folder, planned, tmp_path):
    picture = tmp_path / "search.svg"
    status, out, err = run("navigate", map_folder, f"the {carried().label}", *SMALL, "--seed", 1, "--out", picture)
    assert (status, err) == (0, "")
    assert "place 1" in out
    assert "\nfound " in out
    assert "m away, in sight\n" in out
    assert str(picture) in out
    ET.parse(picture)


def test_a_moved_thing_is_said_to_be_moved(run, map_folder, planned):
    status, out, _ = run("navigate", map_folder, carried().label, *SMALL, "--moved", "in_anchor")
    assert f"moved       {carried().label}: elsewhere on the " in out
    assert status == (0 if "\nfound " in out and ": false match" not in out else 1)


def test_what_is_not_there_is_not_found(run, map_folder, planned):
    status, out, _ = run("navigate", map_folder, "qzxv wvkj", *SMALL, "--set", "navigation.unknown=answer")
    assert status == 1
    assert "\nnot found " in out
    assert "nothing in this world has that name" in out
    assert " 0 frames" in out


def test_settings_reach_the_robot(run, map_folder, planned, monkeypatch):
    """The words of the command end in what the navigator is made with; --strategy wins over --set."""
    made = []
    init = Navigator.__init__

    def noted(self, abstract_map, mapper, embedder, settings, **parts):
        made.append((settings, parts["planning"], parts["abstraction"], parts["scene"]))
        init(self, abstract_map, mapper, embedder, settings, **parts)

    monkeypatch.setattr(Navigator, "__init__", noted)
    sets = ("navigation.unknown=answer", "navigation.attempts=7", "planner.radius_m=0.2", "abstraction.next_to_m=0.5", "layout.cell_m=0.06")
    words = [word for setting in sets for word in ("--set", setting)]
    run("navigate", map_folder, "qzxv wvkj", *SMALL, *words, "--set", "navigation.strategy=random")
    run("navigate", map_folder, "qzxv wvkj", *SMALL, *words, "--set", "navigation.strategy=random", "--strategy", "original")
    search, planner, abstraction, layout = made[0]
    assert (search.attempts, planner.radius_m, abstraction.next_to_m, layout.cell_m) == (7, 0.2, 0.5, 0.06)
    assert [row[0].strategy for row in made] == ["random", "original"]


@pytest.mark.parametrize("name", ["", "map.json"])
@pytest.mark.parametrize("is_there", [True, False])
def test_a_world_is_mapped_only_where_there_is_no_map(run, map_folder, planned, monkeypatch, tmp_path, name, is_there):
    made = []

    def map_home(home, make_mapper, embedder, settings, folder, progress):
        made.append(folder)
        return mapped()

    monkeypatch.setattr(home_map, "map_home", map_home)
    folder = map_folder if is_there else tmp_path / "new"
    status, out, _ = run("navigate", folder / name, "qzxv wvkj", *SMALL, "--make-map", "--set", "navigation.unknown=answer")
    assert (status, "\nnot found " in out) == (1, True)
    assert made == ([] if is_there else [folder])


@pytest.mark.parametrize(("off_m", "is_refused"), [((0.1, 0.1), False), ((1.5, 1.0), True), ((40.0, 0.0), True)])
def test_a_map_of_another_floor_is_refused(run, planned, tmp_path, off_m, is_refused):
    abstract_map = mapped().abstract
    layout = replace(abstract_map.layout, corner_world=abstract_map.layout.corner_world + off_m)
    mapped().with_abstract(replace(abstract_map, layout=layout)).save(tmp_path)
    status, out, err = run("navigate", tmp_path, "qzxv wvkj", *SMALL, "--set", "navigation.unknown=answer")
    assert (status, out == "") == ((2, True) if is_refused else (1, False))
    assert err.startswith("error: map: " if is_refused else "")
    assert ("of its floor is free floor in apartment" in err) == is_refused


def test_mistakes_end_with_one_clear_line(run, map_folder, tmp_path):
    bare = tmp_path / "bare"
    Map().save(bare)
    for words, told in (
        ((bare, "cup", *SMALL), "no abstract map"),
        ((map_folder, "cup", "--world", "castle"), "wanted house, or apartment:SEED"),
        ((map_folder, "cup", *SMALL, "--out", tmp_path / "search.png"), "ends in .svg"),
        ((map_folder, "cup", *SMALL, "--size", "big"), "WIDTHxHEIGHT"),
        ((map_folder, "cup", *SMALL, "--set", "navigation.attemps=3"), "attempts"),
        ((map_folder, "cup", *SMALL, "--set", "detector.name=yolo"), "navigation, planner, abstraction, layout"),
        ((map_folder, "cup", *SMALL, "--set", "navigation"), "navigation.attempts=5"),
        ((tmp_path / "nowhere", "cup", *SMALL), "nowhere"),
    ):
        status, out, err = run("navigate", *words)
        assert (status, out) == (2, "")
        assert err.startswith("error: ")
        assert err.count("\n") == 1
        assert told in err
