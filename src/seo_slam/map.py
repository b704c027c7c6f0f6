"""The map of things: load it, ask it, save it."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from seo_slam import registry
from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.abstraction.files import abstract_map_from
from seo_slam.abstraction.from_words import is_of, with_features_of_words
from seo_slam.config import Component
from seo_slam.errors import BackendError, ConfigError, MapError, MapFormatError, MissingBackendError, UnknownLandmarkError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder
from seo_slam.map_clouds import CLOUDS_FILE, read_clouds, write_clouds
from seo_slam.map_document import (
    Gravity,
    document_bytes,
    landmark_from,
    make_document,
    read_document,
    write_atomically,
)
from seo_slam.map_features import FEATURES_FILE, read_features, write_features
from seo_slam.mapping.nearby import rows_within
from seo_slam.records import FeatureRecipe
from seo_slam.types import Landmark

MAP_FILE = "map.json"
STORE_FILE = "map.db"
_MODELS = "sentence_transformers"  # the embedder that loads a model by its name or folder

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class QueryHit:
    """An answer to a query.

    Attributes:
        landmark: the thing.
        score: cosine of the text's embedding with the landmark's, -1..1; 1 is the best.
    """

    landmark: Landmark
    score: float


class Map:
    """A map at one moment; it never changes.

    Args:
        landmarks: stable, tentative and lost ones, in any order; arrays are copied.
        gravity: "poses" if z is up as in the poses of the recording, else "unknown".
        embedder: name of the model that embeds labels; "" if none is known.
        next_id: the lowest id never used; at least the highest id here plus 1, which is the default.
        abstract: anchors, what is on them, and the layout of the floor; None where there is none.
        features: how features of things were made; None if that is not known. The abstract map's too, where it does not say.

    Raises:
        MapError: two landmarks have one id, or gravity is another word.
    """

    def __init__(
        self,
        landmarks: Iterable[Landmark] = (),
        gravity: Gravity = "unknown",
        embedder: str = "",
        next_id: int = 0,
        abstract: AbstractMap | None = None,
        features: FeatureRecipe | None = None,
    ) -> None:
        if gravity not in get_args(Gravity):
            raise MapError(f"gravity: got {gravity!r}, wanted one of {', '.join(get_args(Gravity))}")
        rows = sorted((_frozen(landmark) for landmark in landmarks), key=lambda landmark: landmark.id)
        self._by_id = {row.id: row for row in rows}
        if len(self._by_id) != len(rows):
            raise MapError(f"map: an id is given to two landmarks: {[row.id for row in rows]}")
        self._landmarks = tuple(row for row in rows if row.state == "stable")
        self._tentative = tuple(row for row in rows if row.state != "stable")
        self._gravity: Gravity = gravity
        self._embedder = embedder
        self._next_id = max(next_id, rows[-1].id + 1 if rows else 0)
        self._features = features
        self._abstract = abstract
        if abstract is not None and abstract.features is None and features is not None:
            self._abstract = replace(abstract, features=features)
        self._embedder_in_use: Embedder | None = None
        self._vectors: tuple[str, int, FloatArray] | None = None

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Load a map from the folder of a result, from its map.json or from its map.db.

        A folder without map.json, but with map.db, is a run that was killed: the map is then that of the last keyframe committed.

        Raises:
            MapFormatError: no map there, or one of another schema, cut off or damaged.
            MapError: it cannot be read.
        """
        target = Path(path)
        if not target.is_dir():
            return cls._from_store(target) if target.suffix == ".db" else cls._from_json(target)
        if (target / MAP_FILE).exists():
            return cls._from_json(target / MAP_FILE)
        if (target / STORE_FILE).exists():
            return cls._from_store(target / STORE_FILE)
        raise MapFormatError(f"{target}: holds no map: wanted {MAP_FILE}, or {STORE_FILE} of a run that was ended early")

    @classmethod
    def _from_json(cls, path: Path) -> Self:
        document = read_document(path)
        rows = [landmark_from(row) for row in (*document.landmarks, *document.tentative)]
        abstract = None if document.abstract is None else abstract_map_from(document.abstract)
        recipe = None if document.features is None else FeatureRecipe(**document.features.model_dump())
        loaded = cls(rows, document.gravity, document.embedder, document.next_id, abstract, recipe)
        clouds, features, store = (path.with_name(name) for name in (CLOUDS_FILE, FEATURES_FILE, STORE_FILE))
        loaded = loaded._with_clouds(read_clouds(clouds)) if clouds.is_file() else loaded
        loaded = loaded._with_features(features) if features.is_file() else loaded
        return loaded._with_stored_embeddings(store) if store.is_file() else loaded

    def _with_rows(self, rows: Iterable[Landmark]) -> Self:
        return type(self)(rows, self._gravity, self._embedder, self._next_id, self._abstract, self._features)

    def _with_clouds(self, clouds: Mapping[int, FloatArray]) -> Self:
        rows = [replace(row, cloud_world=clouds[row.id]) if row.id in clouds else row for row in self._by_id.values()]
        return self._with_rows(rows)

    def _with_features(self, path: Path) -> Self:
        """Take vectors that the map's embedder made; the map is of use without them, so nothing here fails."""
        try:
            embedder, features = read_features(path)
        except MapFormatError as error:
            _log.warning("%s; landmarks are known by their words only, those without words by nothing", error)
            return self
        if embedder != self._embedder:
            _log.warning("%s: features of %r, the map is of %r; they are left out", path, embedder, self._embedder)
            return self
        rows = [replace(row, embedding=features[row.id]) if row.id in features else row for row in self._by_id.values()]
        return self._with_rows(rows)

    @classmethod
    def _from_store(cls, path: Path) -> Self:
        with registry.find("store", "sqlite")(path, read_only=True) as store:
            meta = store.meta()
            gravity = meta.get("gravity", "unknown")
            if gravity not in get_args(Gravity):
                raise MapFormatError(f"{path}: gravity: got {gravity!r}, wanted one of {', '.join(get_args(Gravity))}")
            return cls(store.landmarks(), cast(Gravity, gravity), meta.get("embedder", ""), store.next_id())

    def _with_stored_embeddings(self, path: Path) -> Self:
        """Take embeddings from map.db where it says the same of a landmark; they are only a saving, so nothing here fails."""
        try:
            stored = self._from_store(path)
        except MapError as error:
            _log.warning("%s; label embeddings will be computed anew", error)
            return self
        if stored.embedder != self._embedder:
            return self
        rows = []
        for row in self._by_id.values():
            other = stored._by_id.get(row.id)
            same = other is not None and _same_words(row, other)
            rows.append(replace(row, embedding=other.embedding) if other is not None and same else row)
        return self._with_rows(rows)

    @property
    def landmarks(self) -> tuple[Landmark, ...]:
        """Stable landmarks, by rising id."""
        return self._landmarks

    @property
    def tentative(self) -> tuple[Landmark, ...]:
        """Landmarks that are not stable, by rising id: "tentative", seen too seldom to be trusted, or "lost", not where they should be."""
        return self._tentative

    @property
    def gravity(self) -> Gravity:
        """How the world frame lies: "poses" if z is up as in the recording's poses, "unknown" if no axis is known to be up."""
        return self._gravity

    @property
    def embedder(self) -> str:
        """Name of the model that embeds labels; "" if none is known."""
        return self._embedder

    @property
    def next_id(self) -> int:
        """The lowest landmark id that was never used."""
        return self._next_id

    @property
    def abstract(self) -> AbstractMap | None:
        """Anchors, what is on them, and the layout of the floor; None if the map has none. Not in map.db."""
        return self._abstract

    @property
    def features(self) -> FeatureRecipe | None:
        """How features of things were made: scores of two maps compare only where it is the same. None if not known. Not in map.db."""
        return self._features

    def __len__(self) -> int:
        return len(self._landmarks)

    def __repr__(self) -> str:
        return f"Map({len(self._landmarks)} landmarks, {len(self._tentative)} tentative, embedder {self._embedder!r})"

    def landmark(self, landmark_id: int) -> Landmark:
        """Return a landmark, stable or not, by its id.

        Raises:
            UnknownLandmarkError: the map has none of that id.
        """
        if landmark_id not in self._by_id:
            raise UnknownLandmarkError(f"no landmark {landmark_id} in this map; ids: {_some(list(self._by_id))}")
        return self._by_id[landmark_id]

    def near(self, p_world: ArrayLike, radius_m: float) -> tuple[Landmark, ...]:
        """Return stable landmarks whose centre is within ``radius_m`` of a point (3,), world frame, nearest first.

        Raises:
            FrameError: not a finite point, or a negative radius.
        """
        positions_m = np.array([row.position_m for row in self._landmarks], dtype=np.float64).reshape(-1, 3)
        ids = np.array([row.id for row in self._landmarks], dtype=np.int64)
        return tuple(self._landmarks[i] for i in rows_within(positions_m, ids, p_world, radius_m))

    def query(self, text: str, k: int = 5, embedder: Embedder | None = None) -> tuple[QueryHit, ...]:
        """Return the ``k`` stable landmarks that a text describes best, best first, the lower id first on a tie.

        Args:
            text: what to look for, in words.
            k: how many at most.
            embedder: used instead of the map's own.

        Raises:
            MapError: the text is empty, k is below 1, or the map does not say which embedder made it.
            MissingBackendError: the map's embedder, or its model, is not on this machine; says what to install.
            UnknownBackendError: nothing of the embedder's name is known.
        """
        if not text.strip():
            raise MapError("query: got an empty text, wanted words that describe a thing")
        if k < 1:
            raise MapError(f"query: got k={k}, wanted 1 or more")
        named = [row for row in self._landmarks if row.labels or row.embedding.any()]
        if not named:
            return ()
        model = embedder or self._own_embedder()
        vectors = self._label_vectors(named, model)
        scores = vectors @ model.embed_text([text.strip()])[0]
        # Rounded, so that two equal labels tie whatever the order of the sums was.
        ranks = np.lexsort(([row.id for row in named], -np.round(scores, 9)))[:k]
        return tuple(QueryHit(named[i], float(scores[i])) for i in ranks)

    def with_embeddings(self, embedder: Embedder) -> Self:
        """Return this map with the embedding of every landmark made, or made anew, for ``embedder``, and named after it.

        Features of an abstract map that another embedder made, or one of the same name and another size, are made anew of its words.
        """
        rows = list(self._by_id.values())
        vectors = self._embed(rows, embedder)
        filled = (replace(row, embedding=vector) for row, vector in zip(rows, vectors, strict=True))
        abstract, features = self._abstract, self._features
        if abstract is not None and not is_of(abstract, embedder):
            abstract = with_features_of_words(abstract, embedder)
        sizes = {row.embedding.shape for row in rows if row.embedding.any()}
        if features is not None and (self._embedder != embedder.name or sizes - {(embedder.size,)}):
            features = replace(features, image_encoder="")
        return type(self)(filled, self._gravity, embedder.name, self._next_id, abstract, features)

    def with_abstract(self, abstract_map: AbstractMap | None) -> Self:
        """Return this map with another abstract map, or with none."""
        return type(self)(self._by_id.values(), self._gravity, self._embedder, self._next_id, abstract_map, self._features)

    def save(self, folder: str | Path) -> Path:
        """Write ``map.json`` into a folder (made if missing) and return its path; at no moment is a half-written file there.

        The points of landmarks, where they are kept, go into ``clouds.ply`` beside it, and what they look like into ``features.npz``.

        Raises:
            MapError: the folder cannot be written, or a landmark holds NaN or a covariance that is none.
        """
        path, clouds_path, features_path = (Path(folder) / name for name in (MAP_FILE, CLOUDS_FILE, FEATURES_FILE))
        clouds = {row.id: row.cloud_world for row in self._by_id.values() if len(row.cloud_world)}
        features = {row.id: row.embedding for row in self._by_id.values() if clouds and row.embedding.any()}
        document = self.to_json()
        if clouds or clouds_path.is_file():  # those of an older map must not stay
            write_clouds(clouds_path, clouds)
        if features or features_path.is_file():
            write_features(features_path, self._embedder, features)
        write_atomically(path, document)
        return path

    def to_json(self) -> bytes:
        """Return the bytes of map.json; the same map gives the same bytes.

        Raises:
            MapError: a landmark holds NaN or a covariance that is none, or the abstract map holds NaN or ids that do not rise.
        """
        rest = self._gravity, self._embedder, self._next_id, self._abstract, self._features
        return document_bytes(make_document(self._by_id.values(), *rest))

    def _own_embedder(self) -> Embedder:
        if not self._embedder:
            raise MapError("query: this map does not say which embedder made it; give one: query(text, embedder=…)")
        if self._embedder_in_use is None:
            try:
                self._embedder_in_use = embedder_of(self._embedder)
            except (BackendError, ConfigError) as error:
                kind = type(error) if isinstance(error, BackendError) else MissingBackendError  # here the caller set nothing
                what = f"query: the labels of this map were embedded by {self._embedder!r}, which cannot be had here"
                raise kind(f"{what}: {error}. Or give it: query(text, embedder=…)") from error
        return self._embedder_in_use

    def _label_vectors(self, rows: Sequence[Landmark], model: Embedder) -> FloatArray:
        if self._vectors is None or self._vectors[:2] != (model.name, model.size):
            self._vectors = (model.name, model.size, self._embed(rows, model))
        return self._vectors[2]

    def _embed(self, rows: Sequence[Landmark], model: Embedder) -> FloatArray:
        """(N, D) unit rows, zeros where unnamed: those at hand if this model made them, else sums of label embeddings."""
        out = np.zeros((len(rows), model.size))
        own = model.name == self._embedder
        todo = [i for i, row in enumerate(rows) if not (own and row.embedding.shape == (model.size,) and row.embedding.any())]
        for i in set(range(len(rows))) - set(todo):
            out[i] = rows[i].embedding
        words = sorted({word for i in todo for word in _weights(rows[i])})
        of_word = dict(zip(words, model.embed_text(words), strict=True)) if words else {}
        for i in todo:
            for word, weight in _weights(rows[i]).items():
                out[i] += weight * of_word[word]
        lengths = np.linalg.norm(out, axis=1, keepdims=True)
        return np.asarray(np.divide(out, lengths, out=out, where=lengths > 0), dtype=np.float64)


def embedder_of(name: str) -> Embedder:
    """Make the embedder that a map names: a registered name, "sentence_transformers:MODEL", "module:Class", or a bare model name.

    Raises:
        MissingBackendError: it, or its model, is not here; says what to install.
        UnknownBackendError: nothing of that name is known.
        BackendError: it cannot be loaded.
    """
    kind, colon, model = name.partition(":")
    if name in registry.known("embedder") or (colon and kind != _MODELS):
        return cast(Embedder, registry.create("embedder", name))
    return cast(Embedder, registry.create("embedder", Component(name=_MODELS, options={"model": model if colon else name})))


def _frozen(landmark: Landmark) -> Landmark:
    return replace(
        landmark,
        labels=dict(landmark.labels),
        position_m=_read_only(landmark.position_m),
        covariance_m2=_read_only(landmark.covariance_m2),
        size_m=_read_only(landmark.size_m),
        embedding=_read_only(landmark.embedding),
        cloud_world=_read_only_view(landmark.cloud_world),
    )


def _read_only(array: FloatArray) -> FloatArray:
    copy = np.array(array, dtype=np.float64)
    copy.flags.writeable = False
    return copy


def _read_only_view(array: FloatArray) -> FloatArray:
    """Not a copy: clouds are large, and whoever makes them never changes them."""
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view


def _same_words(a: Landmark, b: Landmark) -> bool:
    if (a.label, a.category, a.labels.keys()) != (b.label, b.category, b.labels.keys()):
        return False
    return all(abs(a.labels[word] - b.labels[word]) < 1e-8 for word in a.labels)  # map.json rounds to 1e-9


def _weights(landmark: Landmark) -> dict[str, float]:
    """Word -> weight in the landmark's embedding: its labels, and a descriptive label that is none of them with its category's weight."""
    label = landmark.label
    extra = {label: landmark.labels.get(landmark.category, 1.0)} if label and label not in landmark.labels else {}
    return {**landmark.labels, **extra}


def _some(ids: list[int], most: int = 12) -> str:
    shown = ", ".join(str(i) for i in ids[:most])
    return (shown or "none") + (", …" if len(ids) > most else "")
