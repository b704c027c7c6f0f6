"""The map: load, ask, save, and what it refuses."""

import json
import logging
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam import registry
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.config import Component
from seo_slam.errors import FrameError, MapError, MapFormatError, MissingBackendError, UnknownBackendError, UnknownLandmarkError
from seo_slam.map import Map, embedder_of
from seo_slam.testing.store import make_landmark, make_record, require_same_landmark

WORDS = ("cup", "bowl", "book", "tv")


class WordEmbedder:
    """One axis a word; counts how often it is asked."""

    name = "words"
    size = len(WORDS)

    def __init__(self):
        self.asked = []

    def embed_text(self, texts):
        self.asked += texts
        return np.array([[float(word == text) for word in WORDS] for text in texts]).reshape(-1, self.size)


def named(landmark_id, labels, embedding=(), **changes):
    label = max(labels, key=lambda word: labels[word], default="")
    return replace(make_landmark(landmark_id), label=label, labels=labels, embedding=np.array(embedding, dtype=float), **changes)


def require_same_map(got, wanted):
    assert (got.gravity, got.embedder, got.next_id) == (wanted.gravity, wanted.embedder, wanted.next_id)
    for ours, theirs in ((got.landmarks, wanted.landmarks), (got.tentative, wanted.tentative)):
        assert [row.id for row in ours] == [row.id for row in theirs]
        for one, other in zip(ours, theirs, strict=True):
            require_same_landmark(replace(one, embedding=other.embedding), other)


@pytest.fixture
def desk():
    return Map(
        [
            named(3, {"cup": 0.9, "bowl": 0.1}, position_m=np.array([0.0, 0.0, 0.0])),
            named(1, {"book": 1.0}, position_m=np.array([1.0, 0.0, 0.0])),
            named(2, {"book": 1.0}, position_m=np.array([0.5, 0.0, 0.0])),
            named(8, {"tv": 1.0}, state="tentative"),
        ],
        gravity="poses",
        embedder="words",
        next_id=12,
    )


def test_a_map_comes_back_from_its_folder(desk, tmp_path):
    path = desk.save(tmp_path / "new" / "result")
    assert path == tmp_path / "new" / "result" / "map.json"
    require_same_map(Map.load(path.parent), desk)
    require_same_map(Map.load(path), desk)
    assert [row.id for row in desk.landmarks] == [1, 2, 3]
    assert [row.id for row in desk.tentative] == [8]
    assert len(desk) == 3


def test_the_same_map_gives_the_same_bytes(desk, tmp_path):
    other = Map([*reversed(desk.landmarks), *desk.tentative], "poses", "words", 12)
    assert desk.to_json() == other.to_json()
    assert Map.load(desk.save(tmp_path)).to_json() == desk.to_json()


def test_save_replaces_whole_and_leaves_nothing_else(desk, tmp_path):
    Map().save(tmp_path)
    desk.save(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["map.json"]
    assert len(Map.load(tmp_path)) == 3


def test_a_failing_save_keeps_the_old_map(desk, tmp_path):
    desk.save(tmp_path)
    bad = Map([named(1, {"cup": 1.0}, position_m=np.array([0.0, np.nan, 0.0]))])
    with pytest.raises(MapError, match=r"position_m\.1.*finite"):
        bad.save(tmp_path)
    require_same_map(Map.load(tmp_path), desk)


def test_saving_where_nothing_can_be_written_says_where(desk, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(MapError, match=r"file.map\.json: cannot be written"):
        desk.save(tmp_path / "file")


def test_what_the_map_holds_cannot_be_changed(desk):
    labels, position_m = {"cup": 1.0}, np.zeros(3)
    made = Map([named(0, labels, position_m=position_m)])
    position_m[0], labels["tv"] = 9.0, 1.0
    assert made.landmarks[0].position_m[0] == 0.0
    assert set(made.landmarks[0].labels) == {"cup"}
    with pytest.raises(ValueError, match="read-only"):
        desk.landmarks[0].position_m[0] = 9.0


def test_a_map_travels_between_processes(desk):
    require_same_map(pickle.loads(pickle.dumps(desk)), desk)


def test_two_landmarks_of_one_id_are_refused():
    with pytest.raises(MapError, match="an id is given to two"):
        Map([make_landmark(1), make_landmark(1, state="tentative")])


def test_gravity_is_one_of_two_words():
    with pytest.raises(MapError, match="'down'"):
        Map(gravity="down")


def test_next_id_is_above_every_id():
    assert Map([make_landmark(7)]).next_id == 8
    assert Map([make_landmark(7)], next_id=30).next_id == 30
    assert Map().next_id == 0


def test_landmark_by_id(desk):
    assert desk.landmark(8).label == "tv"
    with pytest.raises(UnknownLandmarkError, match=r"no landmark 5 in this map; ids: 1, 2, 3, 8"):
        desk.landmark(5)


def test_near_gives_stable_landmarks_nearest_first(desk):
    assert [row.id for row in desk.near([0.0, 0.0, 0.0], 0.6)] == [3, 2]
    assert [row.id for row in desk.near([0.75, 0.0, 0.0], 0.25)] == [1, 2]
    assert Map().near(np.zeros(3), 5.0) == ()
    with pytest.raises(FrameError, match="p_world"):
        desk.near([0.0, np.inf, 0.0], 1.0)


def test_query_orders_by_cosine_then_id(desk):
    hits = desk.query(" book ", embedder=WordEmbedder())
    assert [hit.landmark.id for hit in hits] == [1, 2, 3]
    assert [hit.score for hit in hits] == pytest.approx([1.0, 1.0, 0.0])
    best = desk.query("bowl", k=1, embedder=WordEmbedder())
    assert [hit.landmark.id for hit in best] == [3]
    assert best[0].score == pytest.approx(0.1 / np.hypot(0.9, 0.1))


def test_query_embeds_each_label_once(desk):
    embedder = WordEmbedder()
    desk.query("tv", embedder=embedder)
    desk.query("cup", embedder=embedder)
    assert sorted(embedder.asked) == ["book", "bowl", "cup", "cup", "tv"]


def test_query_takes_the_embeddings_at_hand_only_if_they_are_the_models_own():
    rows = [named(0, {"cup": 1.0}, (0, 0, 0, 1.0)), named(1, {"book": 1.0}, (1.0, 0, 0))]
    own = Map(rows, embedder="words").query("tv", embedder=WordEmbedder())
    assert [(hit.landmark.id, hit.score) for hit in own] == [(0, 1.0), (1, 0.0)]
    foreign = Map(rows, embedder="other").query("cup", embedder=WordEmbedder())
    assert [(hit.landmark.id, hit.score) for hit in foreign] == [(0, 1.0), (1, 0.0)]


def test_query_asks_anew_for_a_model_of_one_name_and_another_size(desk):
    for size in (256, 64):
        assert desk.query("book", embedder=HashedEmbedder(size))[0].score == pytest.approx(1.0)


def test_query_leaves_out_what_nothing_has_named():
    assert Map([named(0, {})], embedder="words").query("cup", embedder=WordEmbedder()) == ()


def test_query_of_an_empty_map_needs_no_model():
    assert Map().query("cup") == ()


@pytest.mark.parametrize(("text", "k"), [("", 5), (" \n", 5), ("cup", 0)])
def test_query_refuses(desk, text, k):
    with pytest.raises(MapError, match="query"):
        desk.query(text, k, embedder=WordEmbedder())


def test_query_with_an_unknown_model_says_so(desk):
    with pytest.raises(MapError, match="does not say which embedder"):
        Map(desk.landmarks).query("cup")
    with pytest.raises(UnknownBackendError, match="nowhere"):
        Map(desk.landmarks, embedder="seo_slam.map:nowhere").query("cup")


def test_the_maps_own_embedder_is_made_from_its_name(monkeypatch):
    made = []
    monkeypatch.setattr(registry, "create", lambda kind, component: made.append(component) or WordEmbedder())
    loaded = Map([named(0, {"cup": 1.0})], embedder="hashed")
    loaded.query("cup")
    loaded.query("tv")
    assert made == ["hashed"]


@pytest.mark.parametrize(
    ("name", "component"),
    [
        ("minilm", "minilm"),
        ("my_package.words:Words", "my_package.words:Words"),
        ("sentence_transformers:some/model", Component(name="sentence_transformers", options={"model": "some/model"})),
        ("some/model", Component(name="sentence_transformers", options={"model": "some/model"})),
    ],
)
def test_names_of_embedders(monkeypatch, name, component):
    made = []
    monkeypatch.setattr(registry, "create", lambda kind, wanted: made.append(wanted))
    embedder_of(name)
    assert made == [component]


def test_a_query_by_words_alone_with_the_hashed_embedder(desk, tmp_path):
    Map([*desk.landmarks, *desk.tentative], embedder="hashed").save(tmp_path)
    best = Map.load(tmp_path).query("books", k=1)[0]
    assert best.landmark.label == "book"
    assert 0.3 < best.score < 1.0


def test_a_model_that_is_not_here_is_named(desk):
    with pytest.raises(MissingBackendError, match=r"embedded by 'nobody/has-this-model'.*embedder=…"):
        Map(desk.landmarks, embedder="nobody/has-this-model").query("cup")


def test_with_embeddings_fills_every_landmark(desk):
    filled = desk.with_embeddings(WordEmbedder())
    assert filled.landmark(8).embedding.tolist() == [0, 0, 0, 1]
    assert np.linalg.norm(filled.landmark(3).embedding) == pytest.approx(1.0)
    assert (filled.embedder, filled.next_id, filled.gravity) == ("words", 12, "poses")


def write_store(folder, landmarks, embedder="words"):
    with SqliteStore(folder / "map.db") as store:
        store.set_meta("gravity", "poses")
        store.set_meta("embedder", embedder)
        store.commit(make_record(0, landmarks=tuple(landmarks)))


def test_a_run_that_was_killed_is_loaded_from_its_store(desk, tmp_path):
    write_store(tmp_path, [*desk.landmarks, *desk.tentative])
    for path in (tmp_path, tmp_path / "map.db"):
        loaded = Map.load(path)
        assert [row.id for row in loaded.landmarks] == [1, 2, 3]
        assert [row.id for row in loaded.tentative] == [8]
        assert (loaded.gravity, loaded.embedder, loaded.next_id) == ("poses", "words", 9)


def test_embeddings_come_from_the_store_beside_the_file(tmp_path):
    Map([named(0, {"cup": 2 / 3, "bowl": 1 / 3}), named(1, {"tv": 1.0})], embedder="words").save(tmp_path)
    write_store(tmp_path, [named(0, {"cup": 2 / 3, "bowl": 1 / 3}, (0, 0, 0.6, 0.8)), named(1, {"book": 1.0}, (0, 0, 1, 0))])
    loaded = Map.load(tmp_path)
    assert loaded.landmark(0).embedding == pytest.approx([0, 0, 0.6, 0.8])
    assert loaded.landmark(1).embedding.size == 0, "the store says something else of landmark 1"
    assert loaded.query("tv", embedder=WordEmbedder())[1].score == pytest.approx(0.8)


def test_embeddings_of_another_model_are_not_taken(tmp_path):
    Map([named(0, {"cup": 1.0})], embedder="words").save(tmp_path)
    write_store(tmp_path, [named(0, {"cup": 1.0}, (0, 0, 0.6, 0.8))], embedder="other")
    assert Map.load(tmp_path).landmark(0).embedding.size == 0


def test_a_damaged_store_beside_a_good_file_is_only_a_warning(desk, tmp_path, caplog):
    desk.save(tmp_path)
    (tmp_path / "map.db").write_bytes(b"nonsense")
    with caplog.at_level(logging.WARNING):
        require_same_map(Map.load(tmp_path), desk)
    assert "map.db" in caplog.text


def test_a_store_with_a_strange_gravity_is_refused(tmp_path):
    with SqliteStore(tmp_path / "map.db") as store:
        store.set_meta("gravity", "sideways")
    with pytest.raises(MapFormatError, match="sideways"):
        Map.load(tmp_path)


def test_folders_and_files_without_a_map(tmp_path):
    with pytest.raises(MapFormatError, match=r"holds no map: wanted map\.json"):
        Map.load(tmp_path)
    for name in ("missing", "missing.json", "missing.db"):
        with pytest.raises(MapFormatError, match=f"{name}: no such map file"):
            Map.load(tmp_path / name)


def test_a_file_cut_off_anywhere_is_refused(desk, tmp_path):
    data = desk.to_json()
    path = tmp_path / "map.json"
    for size in range(0, len(data) - 1, 10):
        path.write_bytes(data[:size])
        with pytest.raises(MapFormatError, match=r"map\.json: cut off"):
            Map.load(path)


def edited(desk, edit):
    document = json.loads(desk.to_json())
    edit(document)
    return json.dumps(document)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda d: d.update(schema="seo_slam.map/9"), r"schema: got 'seo_slam\.map/9', wanted 'seo_slam\.map/1'"),
        (lambda d: d.pop("schema"), r"schema: got None"),
        (lambda d: d.pop("landmarks"), r"landmarks: Field required"),
        (lambda d: d["landmarks"][1].pop("label"), r"landmarks\.1\.label: Field required"),
        (lambda d: d["landmarks"][0].update(colour="red"), r"landmarks\.0\.colour: Extra"),
        (lambda d: d["landmarks"][0]["position_m"].__setitem__(2, float("nan")), r"landmarks\.0\.position_m\.2: .*finite"),
        (lambda d: d["landmarks"][0]["position_m"].pop(), r"landmarks\.0\.position_m\.2: Field required"),
        (lambda d: d["landmarks"][0].update(observations="4"), r"observations: .*integer, got 4"),
        (lambda d: d["landmarks"][0]["covariance_m2"][0].__setitem__(0, -1.0), r"covariance_m2: .*not positive definite"),
        (lambda d: d["landmarks"][0]["covariance_m2"][0].__setitem__(1, 0.5), r"covariance_m2: .*not symmetric"),
        (lambda d: d["landmarks"][0].update(id=2), r"landmark id 2 is given twice"),
        (lambda d: d["tentative"][0].update(id=2), r"landmark id 2 is given twice"),
        (lambda d: d.update(next_id=8), r"next_id is 8, but landmark 8 exists"),
        (lambda d: d["landmarks"][0].update(state="tentative"), r"landmark 1 is tentative, but stands among the stable"),
        (lambda d: d["landmarks"][0].update(label="desk"), r"label 'desk' is not among labels"),
        (lambda d: d.update(units="ft"), r"units: .*'m', got ft"),
        (lambda d: d.update(gravity="down"), r"gravity: "),
    ],
)
def test_a_file_with_a_fault_is_refused_by_name(desk, tmp_path, edit, message):
    path = tmp_path / "map.json"
    path.write_text(edited(desk, edit))
    with pytest.raises(MapFormatError, match=r"map\.json: .*" + message):
        Map.load(path)


@pytest.mark.parametrize("content", [b"\xff\xfe{}", b"[1]", b"null", b"{'a': 1}", b"[" * 100_000, b'{"schema": ' + b"9" * 5000 + b"}"])
def test_what_is_no_json_map_is_refused(tmp_path, content):
    path = tmp_path / "map.json"
    path.write_bytes(content)
    with pytest.raises(MapFormatError, match=r"map\.json: "):
        Map.load(path)


finite = st.floats(-1e6, 1e6)
weights = st.dictionaries(st.text(min_size=1, max_size=8), st.floats(0.01, 1.0), max_size=4)


@st.composite
def some_landmarks(draw):
    rows = []
    for landmark_id in draw(st.sets(st.integers(0, 10**9), max_size=5)):
        raw = draw(weights)
        labels = {word: weight / sum(raw.values()) for word, weight in raw.items()}
        factor = np.array(draw(st.lists(st.floats(-1, 1), min_size=9, max_size=9))).reshape(3, 3)
        rows.append(
            named(
                landmark_id,
                labels,
                position_m=np.array(draw(st.tuples(finite, finite, finite))),
                covariance_m2=factor @ factor.T + 1e-4 * np.eye(3),
                size_m=np.array(draw(st.tuples(*[st.floats(0, 10)] * 3))),
                first_seen_s=draw(st.floats(0, 2e9)),
                state=draw(st.sampled_from(["stable", "tentative"])),
            )
        )
    return rows


@settings(max_examples=60, deadline=None)
@given(some_landmarks(), st.sampled_from(["poses", "unknown"]), st.integers(0, 50))
def test_any_map_comes_back_and_then_never_changes(tmp_path_factory, rows, gravity, next_id):
    folder = tmp_path_factory.mktemp("map")
    made = Map(rows, gravity, "words", next_id)
    made.save(folder)
    loaded = Map.load(folder)
    assert (loaded.gravity, loaded.next_id) == (made.gravity, made.next_id)
    for got, wanted in zip((*loaded.landmarks, *loaded.tentative), (*made.landmarks, *made.tentative), strict=True):
        assert (got.id, got.label, got.first_seen_s, got.state) == (wanted.id, wanted.label, wanted.first_seen_s, wanted.state)
        assert dict(got.labels) == pytest.approx(dict(wanted.labels), abs=1e-9)
        assert got.position_m == pytest.approx(wanted.position_m, abs=1e-9)
        assert got.covariance_m2 == pytest.approx(wanted.covariance_m2, rel=1e-9, abs=1e-15)
    assert loaded.to_json() == made.to_json()
