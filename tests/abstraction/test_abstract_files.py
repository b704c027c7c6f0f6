"""The abstract map in map.json."""

import base64
import json
from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Layout, Place, Room, Volatile
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.errors import MapError, MapFormatError
from seo_slam.map import Map
from seo_slam.map_document import map_json_schema
from seo_slam.testing.store import make_landmark


def unit(draws, size):
    vector = draws.normal(size=size)
    return vector / np.linalg.norm(vector)


def a_place(draws):
    return Place(draws.normal(size=3).round(4), draws.normal(size=16).round(2))


def an_abstract_map(anchors=3, volatiles=2, size=8, side_m=1.0, shape=(7, 5), seed=0):
    draws = np.random.default_rng(seed)
    rows = []
    for k in range(anchors):
        kinds = ("on", "in", "next to")
        things = tuple(Volatile(f"thing {j}", unit(draws, size), kinds[j % 3], 100 + j, a_place(draws)) for j in range(volatiles))
        hints = (Volatile("doubt", unit(draws, size), "on", 90, a_place(draws)),)
        ticks = np.arange(0.0, side_m, 0.05)
        footprint = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2) + draws.normal(0, 0.01, (len(ticks) ** 2, 2)) + k
        rows.append(Anchor(3 * k, "tisch é", unit(draws, size), footprint, 400, (-0.0, 0.75), 1 / 3, things, hints))
    rooms = np.repeat(np.arange(shape[0] * shape[1]) * 4 // (shape[0] * shape[1]), 1).reshape(shape).astype(np.int16)
    layout = Layout(np.array([-1.5, 2.0]), 0.05, *(draws.random(shape) < share for share in (0.1, 0.3, 0.8)), rooms)
    return AbstractMap(tuple(rows), layout, (Room(1, "kitchen", 12.5), Room(2, "room 2", 8.0)), "minilm")


def a_map(abstract_map):
    return Map([make_landmark(4), make_landmark(5, state="tentative")], "poses", "minilm").with_abstract(abstract_map)


def test_it_comes_back(tmp_path):
    source = an_abstract_map()
    a_map(source).save(tmp_path)
    loaded = Map.load(tmp_path)
    back = loaded.abstract
    assert back.embedder == "minilm"
    assert back.rooms == source.rooms
    for anchor, other in zip(source.anchors, back.anchors, strict=True):
        assert (anchor.id, anchor.label, anchor.points) == (other.id, other.label, other.points)
        np.testing.assert_allclose(other.feature, anchor.feature, atol=1e-7)
        np.testing.assert_allclose(other.footprint_world, anchor.footprint_world, atol=1e-6)
        assert (*other.z_range_m, other.support_z_m) == pytest.approx((*anchor.z_range_m, anchor.support_z_m))
        for thing, same in zip((*anchor.volatiles, *anchor.hints), (*other.volatiles, *other.hints), strict=True):
            assert (thing.label, thing.relation, thing.landmark_id) == (same.label, same.relation, same.landmark_id)
            np.testing.assert_allclose(same.feature, thing.feature, atol=1e-7)
            np.testing.assert_allclose(same.place.p_world, thing.place.p_world, atol=1e-9)
            np.testing.assert_allclose(same.place.horizon, thing.place.horizon, atol=1e-9)
    for grid in ("walls", "obstacles", "floor", "rooms", "corner_world"):
        np.testing.assert_array_equal(getattr(back.layout, grid), getattr(source.layout, grid))
    assert back.layout.rooms.dtype == np.int16
    assert back.layout.cell_m == 0.05
    assert loaded.to_json() == (tmp_path / "map.json").read_bytes()
    assert list(jsonschema.Draft202012Validator(map_json_schema()).iter_errors(json.loads(loaded.to_json()))) == []


def test_a_section_of_version_1_has_no_places_and_no_hints(tmp_path):
    document = json.loads(a_map(an_abstract_map()).to_json())
    document["abstract"]["version"] = 1
    for anchor in document["abstract"]["anchors"]:
        del anchor["hints"]
        for volatile in anchor["volatiles"]:
            del volatile["place"]
    (tmp_path / "map.json").write_text(json.dumps(document), encoding="utf-8")
    back = Map.load(tmp_path).abstract
    assert [len(anchor.volatiles) for anchor in back.anchors] == [2, 2, 2]
    assert all(anchor.hints == () for anchor in back.anchors)
    assert all(volatile.place is None for anchor in back.anchors for volatile in anchor.volatiles)
    assert b'"place": null' in a_map(back).to_json()


def test_an_anchor_is_a_line():
    lines = a_map(an_abstract_map()).to_json().decode().splitlines()
    assert sum(line.strip().startswith('{"id": ') and '"footprint_world"' in line for line in lines) == 3


def test_a_map_without_it_has_the_bytes_it_always_had(tmp_path):
    plain = a_map(None)
    assert plain.abstract is None
    assert b"abstract" not in plain.to_json()
    plain.save(tmp_path)
    assert Map.load(tmp_path).abstract is None
    assert a_map(an_abstract_map()).with_abstract(None).to_json() == plain.to_json()


@pytest.mark.parametrize(
    "source", [AbstractMap(()), AbstractMap((), an_abstract_map(shape=(0, 4)).layout), replace(an_abstract_map(), layout=None)]
)
def test_little_of_it_comes_back_too(source, tmp_path):
    a_map(source).save(tmp_path)
    back = Map.load(tmp_path).abstract
    assert len(back.anchors) == len(source.anchors)
    assert (back.layout is None) == (source.layout is None)


def test_with_another_embedder_its_features_are_made_of_its_words():
    made, embedder = an_abstract_map(), HashedEmbedder(size=24)
    again = a_map(made).with_embeddings(embedder).abstract
    assert again.embedder == embedder.name
    assert again.layout is made.layout
    assert again.rooms == made.rooms
    for old, new in zip(made.anchors, again.anchors, strict=True):
        np.testing.assert_allclose(new.feature, embedder.embed_text([old.label])[0] if old.label else 0.0)
        assert [volatile.label for volatile in new.volatiles] == [volatile.label for volatile in old.volatiles]
        assert all(volatile.feature.shape == (24,) for volatile in new.volatiles)


def test_a_flat_of_100_m2_takes_less_than_a_megabyte():
    source = an_abstract_map(anchors=25, volatiles=0, size=384, shape=(240, 240))
    things = an_abstract_map(anchors=1, volatiles=20, size=384).anchors[0].volatiles
    anchors = [replace(anchor, volatiles=things[k : k + 1]) for k, anchor in enumerate(source.anchors)]
    noisy = np.random.default_rng(1).integers(0, 6, (240, 24), dtype=np.int16).repeat(10, axis=1)
    whole = replace(source, anchors=tuple(anchors), layout=replace(source.layout, rooms=noisy))
    size = len(Map().with_abstract(whole).to_json())
    assert 100_000 < size < 500_000


def broken(edit):
    document = json.loads(a_map(an_abstract_map()).to_json())
    edit(document["abstract"])
    return json.dumps(document)


def floats(*values):
    return base64.b64encode(np.array(values, dtype="<f4").tobytes()).decode()


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda a: a.update(version=3), "abstract.version"),
        (lambda a: a["anchors"][1].pop("label"), "abstract.anchors.1.label"),
        (lambda a: a["anchors"][1].update(feature="%%"), "anchor 3: feature: not base64"),
        (lambda a: a["anchors"][1].update(feature=floats(1, 0)), r"lengths \[2, 8\]"),
        (lambda a: a["anchors"][2].update(footprint_world=floats(1, 2, 3)), "anchor 6: footprint_world: got 12 bytes"),
        (lambda a: a["anchors"][2].update(footprint_world=""), "anchor 6: footprint_world: got no point"),
        (lambda a: a["anchors"][0]["volatiles"][1].update(feature=floats(*[np.nan] * 8)), "volatile 101: feature: holds NaN"),
        (lambda a: a["anchors"][0]["volatiles"][1].update(relation="under"), "abstract.anchors.0.volatiles.1.relation"),
        (lambda a: a["anchors"].reverse(), "anchor ids"),
        (lambda a: a["anchors"][0].update(z_range_m=[1.0, 0.0]), "lower one first"),
        (lambda a: a["layout"].update(walls=a["layout"]["walls"][:4]), "walls: got 3 bytes, wanted 5"),
        (lambda a: a["layout"].update(shape=[-7, -5]), "wanted 0 to"),
        (lambda a: a["layout"].update(cell_m=0), "abstract.layout.cell_m"),
        (lambda a: a["layout"]["rooms"].pop(), "rooms: the counts cover"),
        (lambda a: a["layout"]["rooms"].append([1, 0]), "counts above 0"),
        (lambda a: a["rooms"].append(a["rooms"][0]), "room ids"),
    ],
)
def test_a_damaged_section_is_refused_with_what_and_where(edit, message, tmp_path):
    (tmp_path / "map.json").write_text(broken(edit), encoding="utf-8")
    with pytest.raises(MapFormatError, match=message) as caught:
        Map.load(tmp_path)
    assert "map.json: abstract" in str(caught.value)


def test_what_a_file_may_not_hold_is_not_written():
    source = an_abstract_map()
    bad = replace(source.anchors[0], feature=np.full(8, np.nan))
    with pytest.raises(MapError, match="feature: holds NaN"):
        a_map(replace(source, anchors=(bad,))).to_json()
    with pytest.raises(MapError, match="anchor ids"):
        a_map(replace(source, anchors=source.anchors[::-1])).to_json()
