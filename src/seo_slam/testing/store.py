"""Contract of a ``MapStore``."""

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial

import numpy as np

from seo_slam.errors import MapError
from seo_slam.interfaces import MapStore
from seo_slam.records import Amendment, EditOutcome, EditRecord, KeyframeRecord, MapEvent
from seo_slam.types import Landmark, LandmarkState, Observations

_EMBEDDING_SIZE = 8


def check_store(make_store: Callable[[], MapStore]) -> None:
    """Check that a store keeps what it is given and refuses what it must.

    Args:
        make_store: makes a new, empty store at each call.

    Raises:
        AssertionError: says what the store did and what was wanted.
    """
    for check in (
        _keeps_keyframes, _follows_landmarks, _finds_near, _keeps_history, _refuses, _keeps_meta, _never_reuses_ids,
        _keeps_edits, _amends, _refuses_amendments,
    ):  # fmt: skip
        store = make_store()
        _require(isinstance(store, MapStore), f"{type(store).__name__} lacks methods of MapStore")
        _require(len(store.keyframe_ids()) == 0 and store.landmarks() == (), "a new store is not empty")
        try:
            check(store)
        finally:
            store.close()


def make_landmark(
    landmark_id: int, p_world: tuple[float, float, float] = (0.0, 0.0, 1.0), state: LandmarkState = "stable", version: int = 1
) -> Landmark:
    """Return a small landmark for tests of stores and maps: a "cup" that was a "bowl" now and then."""
    embedding = np.zeros(_EMBEDDING_SIZE)
    embedding[landmark_id % _EMBEDDING_SIZE] = 1.0
    return Landmark(
        id=landmark_id,
        label="cup",
        labels={"cup": 0.75, "bowl": 0.25},
        position_m=np.array(p_world, dtype=np.float64),
        covariance_m2=np.diag([1e-4, 2e-4, 3e-4]) + 1e-5,
        size_m=np.array([0.08, 0.09, 0.1]),
        embedding=embedding,
        observations=4,
        first_seen_s=1305031102.175304,
        last_seen_s=1305031103.5,
        state=state,
        version=version,
        existence=0.875,
    )


def make_record(
    keyframe_id: int,
    landmark_ids: tuple[int, ...] = (),
    landmarks: tuple[Landmark, ...] = (),
    removed_ids: tuple[int, ...] = (),
    events: tuple[MapEvent, ...] = (),
    edits: tuple[EditRecord, ...] = (),
) -> KeyframeRecord:
    """Return a small keyframe for tests of stores: a measurement a landmark id, all numbers made from the keyframe's."""
    n = len(landmark_ids)
    rng = np.random.default_rng(keyframe_id)
    T_world_camera, T_previous_current = np.eye(4), np.eye(4)
    T_world_camera[:3, 3] = rng.normal(size=3)
    T_previous_current[:3, 3] = rng.normal(size=3)
    embeddings = np.zeros((n, _EMBEDDING_SIZE))
    embeddings[:, 0] = 1.0
    corners = rng.uniform(0, 300, size=(n, 2))
    observations = Observations(
        p_camera=rng.normal(size=(n, 3)),
        cov_camera=np.tile(np.diag([1e-4, 1e-4, 4e-4]), (n, 1, 1)),
        size_m=rng.uniform(0.05, 0.3, size=(n, 2)),
        labels=tuple(None if k == 2 else "cup" for k in range(n)),
        scores=rng.uniform(0.3, 1.0, size=n),
        embeddings=embeddings,
        boxes_px=np.hstack([corners, corners + 20]),
        truncated=rng.uniform(size=(n, 4)) < 0.5,
        clouds=tuple(rng.normal(size=(5, 3)) for _ in range(n)),
        rows=np.arange(n, dtype=np.int64)[::-1].copy(),
    )
    return KeyframeRecord(
        keyframe_id=keyframe_id,
        timestamp_s=1305031102.175304 + 0.5 * keyframe_id,
        T_world_camera=T_world_camera,
        covariance=1e-4 * np.eye(6),
        T_previous_current=T_previous_current,
        motion_covariance=2e-4 * np.eye(6),
        observations=observations,
        landmark_ids=np.array(landmark_ids, dtype=np.int64),
        landmarks=landmarks,
        removed_ids=removed_ids,
        events=events,
        edits=edits,
    )


def make_edit(
    kind: str = "relabel",
    landmark_id: int = 1,
    other_id: int | None = None,
    outcome: EditOutcome = "applied",
    before: tuple[Landmark, ...] = (),
    keyframe_id: int = 0,
    detail: str = "cup -> chipped white mug",
) -> EditRecord:
    """Return an edit for tests of stores: what an agent "Painter" saw half a second ago."""
    timestamp_s = 1305031102.675304 + 0.5 * keyframe_id
    return EditRecord(
        kind=kind,
        landmark_id=landmark_id,
        other_id=other_id,
        outcome=outcome,
        detail=detail,
        agent="Painter",
        model="brush-2b",
        prompt_hash="5f2a9c01",
        view_keyframe_id=keyframe_id,
        view_s=timestamp_s - 0.5,
        keyframe_id=keyframe_id,
        timestamp_s=timestamp_s,
        before=before,
    )


def require_same_landmark(got: Landmark, wanted: Landmark, embedding_tolerance: float = 1e-6) -> None:
    """Raise ``AssertionError`` unless two landmarks are equal; embeddings may be rounded to single precision."""
    for name in ("id", "label", "observations", "first_seen_s", "last_seen_s", "state", "version", "existence", "category"):
        one, other = getattr(got, name), getattr(wanted, name)
        _require(one == other, f"landmark {wanted.id}: {name} is {one!r}, wanted {other!r}")
    _require(dict(got.labels) == dict(wanted.labels), f"landmark {wanted.id}: labels are {got.labels}, wanted {wanted.labels}")
    for name in ("position_m", "covariance_m2", "size_m"):
        _require_equal(getattr(got, name), getattr(wanted, name), f"landmark {wanted.id}: {name}")
    close = got.embedding.shape == wanted.embedding.shape and np.allclose(got.embedding, wanted.embedding, atol=embedding_tolerance)
    _require(close, f"landmark {wanted.id}: the embedding changed")


def _keeps_keyframes(store: MapStore) -> None:
    landmarks = (make_landmark(0), make_landmark(1), make_landmark(2, state="lost"))
    events = (MapEvent("created", 0), MapEvent("merged", 5, "cup", "somebody", other_id=0), MapEvent("moved", 1, other_id=4))
    first, second = make_record(3, (0, 1, 2), landmarks, (5,), events), make_record(7)
    store.commit(first)
    store.commit(second)
    _require(store.keyframe_ids().tolist() == [3, 7], f"keyframe_ids is {store.keyframe_ids().tolist()}, wanted [3, 7]")
    for wanted in (first, second):
        _require_same_keyframe(store.keyframe(wanted.keyframe_id), wanted)
    _require_raises(lambda: store.keyframe(4), "keyframe(4), which was never committed,")


def _require_same_keyframe(got: KeyframeRecord, wanted: KeyframeRecord) -> None:
    where = f"keyframe {wanted.keyframe_id}"
    _require(got.timestamp_s == wanted.timestamp_s, f"{where}: the stamp changed")
    for name in ("T_world_camera", "covariance", "T_previous_current", "motion_covariance", "landmark_ids"):
        _require_equal(getattr(got, name), getattr(wanted, name), f"{where}: {name}")
    for name in ("p_camera", "cov_camera", "size_m", "scores", "boxes_px", "truncated", "rows"):
        _require_equal(getattr(got.observations, name), getattr(wanted.observations, name), f"{where}: observations.{name}")
    _require(got.observations.labels == wanted.observations.labels, f"{where}: labels are {got.observations.labels}")
    _require(got.observations.embeddings.shape == wanted.observations.embeddings.shape, f"{where}: embeddings lost their shape")
    _require(np.allclose(got.observations.embeddings, wanted.observations.embeddings, atol=1e-6), f"{where}: embeddings changed")
    _require([row.id for row in got.landmarks] == [row.id for row in wanted.landmarks], f"{where}: other landmarks")
    for one, other in zip(got.landmarks, wanted.landmarks, strict=True):
        require_same_landmark(one, other)
    _require(got.removed_ids == wanted.removed_ids, f"{where}: removed_ids is {got.removed_ids}, wanted {wanted.removed_ids}")
    _require(got.events == wanted.events, f"{where}: events are {got.events}, wanted {wanted.events}")
    _require_same_edits(got.edits, wanted.edits, where)


def _require_same_edits(got: tuple[EditRecord, ...], wanted: tuple[EditRecord, ...], where: str) -> None:
    _require(len(got) == len(wanted), f"{where}: got {len(got)} edits, wanted {len(wanted)}")
    for number, (one, other) in enumerate(zip(got, wanted, strict=True), start=1):
        for field in fields(EditRecord):
            if field.name != "before":
                a, b = getattr(one, field.name), getattr(other, field.name)
                _require(a == b, f"{where}: edit {number}: {field.name} is {a!r}, wanted {b!r}")
        _require(len(one.before) == len(other.before), f"{where}: edit {number} lost a landmark as it was before")
        for a_row, b_row in zip(one.before, other.before, strict=True):
            require_same_landmark(a_row, b_row)


def _follows_landmarks(store: MapStore) -> None:
    store.commit(make_record(0, landmarks=(make_landmark(9), make_landmark(4, state="tentative"))))
    moved = make_landmark(4, (2.0, 0.0, 0.0), version=2)
    store.commit(make_record(1, landmarks=(moved, make_landmark(11))))
    store.commit(make_record(2, removed_ids=(9,)))
    ids = [row.id for row in store.landmarks()]
    _require(ids == [4, 11], f"landmarks are {ids}, wanted [4, 11]: 9 was removed, and ids rise")
    require_same_landmark(store.landmarks()[0], moved)


def _finds_near(store: MapStore) -> None:
    places = {0: (0.0, 0.0, 0.0), 1: (0.3, 0.0, 0.0), 2: (0.0, -0.1, 0.0), 3: (5.0, 5.0, 5.0), 4: (0.0, 0.1, 0.0)}
    store.commit(make_record(0, landmarks=tuple(make_landmark(i, place) for i, place in places.items())))
    origin = np.zeros(3)
    _require(store.near(origin, 1.0) == (0, 2, 4, 1), f"near gave {store.near(origin, 1.0)}, wanted (0, 2, 4, 1), nearest first")
    _require(store.near(origin, 0.2) == (0, 2, 4), f"near gave {store.near(origin, 0.2)}, wanted (0, 2, 4)")
    _require(store.near(np.array([0.3, 0.0, 0.0]), 0.0) == (1,), "the border does not belong to the radius")
    store.commit(make_record(1, landmarks=(make_landmark(3, (0.05, 0.0, 0.0)),), removed_ids=(0,)))
    _require(store.near(origin, 0.2) == (3, 2, 4), f"near gave {store.near(origin, 0.2)} after a move and a removal, wanted (3, 2, 4)")


def _keeps_history(store: MapStore) -> None:
    store.commit(make_record(0, landmarks=(make_landmark(1),), events=(MapEvent("created", 1), MapEvent("created", 2))))
    store.commit(make_record(1, removed_ids=(1,), events=(MapEvent("removed", 1, "seen through", "agent"),)))
    wanted = ((0, "created", "", "pipeline"), (1, "removed", "seen through", "agent"))
    _require(store.history(1) == wanted, f"history is {store.history(1)}, wanted {wanted}")
    _require(store.history(99) == (), "history of an unknown id is not empty")


def _refuses(store: MapStore) -> None:
    store.commit(make_record(5, landmarks=(make_landmark(1),)))
    broken = make_landmark(2, (0.0, float("nan"), 0.0))
    _require_raises(lambda: store.commit(make_record(5)), "a second keyframe 5")
    _require_raises(lambda: store.commit(make_record(4)), "keyframe 4 after 5")
    _require_raises(lambda: store.commit(make_record(6, landmarks=(make_landmark(3), broken))), "a landmark with NaN")
    unlikely = replace(make_landmark(2), existence=1.5)
    _require_raises(lambda: store.commit(make_record(6, landmarks=(unlikely,))), "a landmark with an existence of 1.5")
    left = ([row.id for row in store.landmarks()], store.keyframe_ids().tolist())
    _require(left == ([1], [5]), f"refused keyframes left {left}, wanted ([1], [5]): wholly or not at all")
    store.commit(make_record(6))
    store.close()
    _require_raises(lambda: store.commit(make_record(7)), "a commit after close")


def _keeps_meta(store: MapStore) -> None:
    store.set_meta("gravity", "unknown")
    store.set_meta("embedder", "hashed")
    store.set_meta("gravity", "poses")
    kept = store.meta()
    _require(kept == {"gravity": "poses", "embedder": "hashed"}, f"meta is {kept}")


def _never_reuses_ids(store: MapStore) -> None:
    _require(store.next_id() == 0, f"next_id of a new store is {store.next_id()}, wanted 0")
    store.commit(make_record(0, landmarks=(make_landmark(2), make_landmark(6))))
    store.commit(make_record(1, removed_ids=(6,)))
    _require(store.next_id() == 7, f"next_id is {store.next_id()} after landmark 6 was kept and removed, wanted 7")


def _keeps_edits(store: MapStore) -> None:
    was = make_landmark(1, (0.1, -0.2, 1 / 3))
    named = replace(was, label="chipped white mug", category="cup", version=2)
    merge = make_edit("merge", 3, 1, before=(make_landmark(3), named))
    edits = (make_edit(before=(was,)), make_edit("remove", 9, outcome="refused", detail="no such landmark"), merge)
    later = (make_edit("confirm", 1, outcome="noted", keyframe_id=0),)  # judged before the keyframe that it is kept with
    first = make_record(0, (1,), (named,), edits=edits)
    store.commit(first)
    store.commit(make_record(1, edits=later))
    _require_same_keyframe(store.keyframe(0), first)
    _require_same_edits(store.keyframe(1).edits, later, "keyframe 1")
    _require_same_edits(store.edits(), (*edits, *later), "edits")
    _require(store.next_id() == 2, f"next_id is {store.next_id()} after an edit of a landmark 9 that never was, wanted 2")


def _amends(store: MapStore) -> None:
    first = make_record(0, (1, 2), (make_landmark(1), make_landmark(2)), events=(MapEvent("created", 1),))
    store.commit(first)
    named = replace(make_landmark(1, (0.0, 2.0, 0.0), version=2), label="chipped white mug", category="cup")
    edit = make_edit(before=(make_landmark(1),))
    event = MapEvent("relabelled", 1, "cup -> chipped white mug", "Painter")
    store.amend(Amendment(0, (named,), (2,), (event,), (edit,)))
    store.amend(Amendment(0, (replace(named, version=3), make_landmark(2, (0.0, 0.0, 3.0), version=4)), (), (MapEvent("undone", 2),)))
    _require_same_keyframe(store.keyframe(0), first)  # as it was committed
    _require([row.id for row in store.landmarks()] == [1, 2], "a landmark that an amendment brought back is not there")
    require_same_landmark(store.landmarks()[0], replace(named, version=3))
    _require(store.near(np.array([0.0, 0.0, 3.0]), 0.1) == (2,), "near does not find a landmark where an amendment put it")
    _require_same_edits(store.edits(), (edit,), "edits")
    kinds = [line[1] for line in store.history(1)]
    _require(kinds == ["created", "relabelled"], f"history of 1 is {kinds}, wanted created, relabelled")
    store.commit(make_record(1, (1,), (replace(named, version=5),)))
    store.amend(Amendment(1, (), (1,), ()))
    _require([row.id for row in store.landmarks()] == [2], "an amendment did not remove a landmark")


def _refuses_amendments(store: MapStore) -> None:
    _require_raises(lambda: store.amend(Amendment(0, (), (), ())), "an amendment of a store without keyframes")
    store.commit(make_record(3, landmarks=(make_landmark(1),)))
    store.commit(make_record(4))
    broken = make_landmark(2, (0.0, float("nan"), 0.0))
    timeless = replace(make_edit(), view_s=float("nan"))
    for what, amendment in (
        ("an amendment of a keyframe that is not the newest", Amendment(3, (make_landmark(5),), (), ())),
        ("an amendment of a keyframe to come", Amendment(5, (make_landmark(5),), (), ())),
        ("an amendment with a landmark with NaN", Amendment(4, (make_landmark(5), broken), (1,), (), (make_edit(),))),
        ("an edit with a stamp of NaN", Amendment(4, (make_landmark(5),), (), (), (timeless,))),
        ("an edit that was before NaN", Amendment(4, (make_landmark(5),), (), (), (make_edit(before=(broken,)),))),
    ):
        _require_raises(partial(store.amend, amendment), what)
    left = ([row.id for row in store.landmarks()], len(store.edits()))
    _require(left == ([1], 0), f"refused amendments left {left}, wanted ([1], 0): wholly or not at all")
    store.close()
    _require_raises(lambda: store.amend(Amendment(4, (), (), ())), "an amendment after close")


def _require(holds: bool, message: str) -> None:
    if not holds:
        raise AssertionError(message)


def _require_equal(got: object, wanted: object, what: str) -> None:
    _require(np.array_equal(np.asarray(got), np.asarray(wanted)), f"{what} is {got!r}, wanted {wanted!r}")


def _require_raises(call: Callable[[], object], what: str) -> None:
    try:
        call()
    except MapError:
        return
    raise AssertionError(f"{what} was taken, wanted a MapError")
