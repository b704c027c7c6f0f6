"""The file map.json: its model, its JSON schema, reading and writing.

The same map gives the same bytes: keys have a fixed order, each landmark is one line, positions, sizes and weights are rounded to
1e-9, covariances to twelve digits.
"""

import json
import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.abstraction.files import AbstractDocument, abstract_document
from seo_slam.errors import MapError, MapFormatError
from seo_slam.records import FeatureRecipe
from seo_slam.types import Landmark, LandmarkState

SCHEMA_NAME = "seo_slam.map/1"
Gravity = Literal["poses", "unknown"]

Finite = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class LandmarkDocument(_Model):
    """One thing in the map."""

    id: int = Field(ge=0, description="Never reused, also not after the landmark was removed.")
    label: str = Field(
        description='The heaviest word of "labels", or what an agent called the thing, which need not be among them where there is a '
        '"category"; "" while nothing has named it.'
    )
    labels: dict[str, NotNegative] = Field(description="Word -> weight; the weights sum to 1. Heaviest first.")
    position_m: Vector = Field(description="Centre [x, y, z] in the world frame, metres.")
    covariance_m2: tuple[Vector, Vector, Vector] = Field(
        description="Covariance of position_m, world frame, square metres; symmetric and positive definite."
    )
    size_m: tuple[NotNegative, NotNegative, NotNegative] = Field(description="Extent along the world's x, y and z, metres.")
    observations: int = Field(
        ge=0, description="How often it was seen: once a keyframe, or more often where two observations of one were joined."
    )
    first_seen_s: Finite = Field(description="Stamp of the first of them, seconds.")
    last_seen_s: Finite = Field(description="Stamp of the last of them, seconds.")
    state: LandmarkState = Field(
        description='"stable"; "tentative" while it was not seen often and long enough; "lost" while it is not where it should be.'
    )
    version: int = Field(ge=0, description="Rises when label or state change or landmarks are merged; not with every observation.")
    existence: float = Field(
        1.0, ge=0, le=1, allow_inf_nan=False, description="Probability that it is there; 1 where that is not estimated, or not given."
    )

    category: str = Field("", description='The plain word that an agent gave beside a descriptive "label". Left out where there is none.')

    @field_validator("covariance_m2")
    @classmethod
    def _is_covariance(cls, value: tuple[Vector, Vector, Vector]) -> tuple[Vector, Vector, Vector]:
        matrix = np.array(value)
        if np.abs(matrix - matrix.T).max() > 1e-6 * np.abs(matrix).max():
            raise ValueError("not symmetric")
        if np.linalg.eigvalsh(matrix)[0] <= 0:
            raise ValueError("not positive definite")
        return value

    @model_validator(mode="after")
    def _label_is_among_labels(self) -> Self:
        if self.label and self.labels and self.label not in self.labels and self.category not in self.labels:
            also = f", nor is its category {self.category!r}" if self.category else ""
            raise ValueError(f"label {self.label!r} is not among labels{also}")
        return self

    @model_serializer(mode="wrap")
    def _without_empty_category(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # A map that no agent has touched keeps the bytes it always had, and older readers, which know no such field, read it.
        fields: dict[str, Any] = write(self)
        return fields if self.category else {key: value for key, value in fields.items() if key != "category"}


class FeaturesDocument(_Model):
    """How features were made: a weighted sum of picture and word."""

    image_weight: NotNegative = Field(description="Of the picture.")
    text_weight: NotNegative = Field(description="Of the word.")
    image_encoder: str = Field(description='Name of what looked at the pictures; "" if nothing did: features are of words only.')


class MapDocument(_Model):
    """A map of things: the whole of map.json."""

    schema_name: Literal["seo_slam.map/1"] = Field(alias="schema", description="Name and version of this format.")
    frame: Literal["world"] = Field(description="The frame of all positions, sizes and covariances.")
    units: Literal["m"] = Field(description="The unit of all lengths: metres.")
    gravity: Gravity = Field(
        description='"poses": z points up, as in the poses that the recording came with. "unknown": the world frame is that of the '
        "first camera, and no axis is known to point up."
    )
    embedder: str = Field(description='Name of the model that embeds labels; a query uses the same one. "" if none is known.')
    next_id: int = Field(ge=0, description="The lowest landmark id that was never used.")
    landmarks: tuple[LandmarkDocument, ...] = Field(description="Stable landmarks, by rising id.")
    tentative: tuple[LandmarkDocument, ...] = Field(description="Landmarks that are not stable, by rising id: seen too seldom, or lost.")
    abstract: AbstractDocument | None = Field(
        None, description="Anchors, what is on them, and the layout of the floor. Left out where there is none."
    )
    features: FeaturesDocument | None = Field(
        None,
        description="How features were made; scores of two maps compare only where it is the same. Left out where it is not known.",
    )

    @model_validator(mode="after")
    def _ids_and_states_agree(self) -> Self:
        ids = [row.id for row in (*self.landmarks, *self.tentative)]
        if len(set(ids)) != len(ids):
            raise ValueError(f"landmark id {next(i for i in ids if ids.count(i) > 1)} is given twice")
        if ids and max(ids) >= self.next_id:
            raise ValueError(f"next_id is {self.next_id}, but landmark {max(ids)} exists")
        for wanted, rows in (("stable", self.landmarks), ("tentative", self.tentative)):
            for row in rows:
                if (row.state == "stable") != (wanted == "stable"):
                    raise ValueError(f"landmark {row.id} is {row.state}, but stands among the {wanted} ones")
        return self

    @model_serializer(mode="wrap")
    def _without_what_there_is_not(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields: dict[str, Any] = write(self)  # a map without them keeps the bytes it always had
        return {key: value for key, value in fields.items() if key not in ("abstract", "features") or value is not None}


def map_json_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of map.json."""
    schema = MapDocument.model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": SCHEMA_NAME, **_without_title(schema)}


def _without_title(schema: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in schema.items() if key != "title"}


def make_document(
    landmarks: Iterable[Landmark],
    gravity: Gravity,
    embedder: str,
    next_id: int,
    abstract: AbstractMap | None = None,
    features: FeatureRecipe | None = None,
) -> MapDocument:
    """Build the document of a map.

    Raises:
        MapError: a landmark holds what map.json may not: NaN, a covariance that is none, an id given twice; or the abstract map does.
    """
    rows = sorted(landmarks, key=lambda landmark: landmark.id)
    try:
        return MapDocument.model_validate(
            {
                "schema": SCHEMA_NAME,
                "frame": "world",
                "units": "m",
                "gravity": gravity,
                "embedder": embedder,
                "next_id": int(next_id),
                "landmarks": [landmark_fields(row) for row in rows if row.state == "stable"],
                "tentative": [landmark_fields(row) for row in rows if row.state != "stable"],
                "abstract": None if abstract is None else abstract_document(abstract),
                "features": None if features is None else asdict(features),
            }
        )
    except ValidationError as error:
        raise MapError(f"the map cannot be written: {_first_fault(error)}") from error


def landmark_fields(landmark: Landmark) -> dict[str, Any]:
    """Return a landmark as it stands in map.json: plain numbers, lists and words; no "category" where it has none."""
    covariance = np.asarray(landmark.covariance_m2, dtype=np.float64)
    symmetric = 0.5 * (covariance + covariance.T)
    weights = {word: _rounded(weight) for word, weight in landmark.labels.items()}
    return {
        "id": int(landmark.id),
        "label": landmark.label,
        "labels": {word: weights[word] for word in sorted(weights, key=lambda word: (-weights[word], word))},
        "position_m": [_rounded(x) for x in landmark.position_m],
        "covariance_m2": [[float(f"{x:.12g}") + 0.0 for x in row] for row in symmetric],
        "size_m": [_rounded(x) for x in landmark.size_m],
        "observations": int(landmark.observations),
        "first_seen_s": float(landmark.first_seen_s),
        "last_seen_s": float(landmark.last_seen_s),
        "state": landmark.state,
        "version": int(landmark.version),
        "existence": _rounded(landmark.existence),
        **({"category": landmark.category} if landmark.category else {}),
    }


def _rounded(x: float) -> float:
    return round(float(x), 9) + 0.0  # + 0.0 turns -0.0 into 0.0


def landmark_from(row: LandmarkDocument) -> Landmark:
    """Return the landmark of a row; its embedding, which map.json does not hold, is empty."""
    return Landmark(
        id=row.id,
        label=row.label,
        labels=dict(row.labels),
        position_m=np.array(row.position_m),
        covariance_m2=np.array(row.covariance_m2),
        size_m=np.array(row.size_m),
        embedding=np.zeros(0),
        observations=row.observations,
        first_seen_s=row.first_seen_s,
        last_seen_s=row.last_seen_s,
        state=row.state,
        version=row.version,
        existence=row.existence,
        category=row.category,
    )


def document_bytes(document: MapDocument) -> bytes:
    """Return the text of map.json: UTF-8, one line a landmark or anchor, the same bytes for the same document.

    Raises:
        MapError: a label is no valid Unicode.
    """
    text = _lines(document.model_dump(mode="json", by_alias=True), " ")
    try:
        return f"{text}\n".encode()
    except UnicodeEncodeError as error:  # half of a surrogate pair
        raise MapError(f"the map cannot be written: a text is no valid Unicode: {error}") from error


def _lines(fields: dict[str, Any], indent: str) -> str:
    """A line a field, an item of a list of objects, and so on in an object of objects."""
    lines = []
    for key, value in fields.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            items = f",\n{indent} ".join(_compact(item) for item in value)
            text = f"[\n{indent} {items}\n{indent}]"
        else:
            text = _lines(value, f"{indent} ") if isinstance(value, dict) and value else _compact(value)
        lines.append(f'{indent}"{key}": {text}')
    return "{\n" + ",\n".join(lines) + f"\n{indent[1:]}}}"


def _compact(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def read_document(path: Path) -> MapDocument:
    """Read map.json.

    Raises:
        MapFormatError: missing, not JSON, cut off, of another schema, or with a field missing or wrong; names file and field.
        MapError: it cannot be read.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise MapFormatError(f"{path}: no such map file") from error
    except OSError as error:
        raise MapError(f"{path}: cannot be read: {error}") from error
    return parse_document(data, str(path))


def parse_document(data: bytes, source: str) -> MapDocument:
    """Read the bytes of a map.json; ``source`` names them in messages.

    Raises:
        MapFormatError: as ``read_document``.
    """
    try:
        loaded = json.loads(data)
    except json.JSONDecodeError as error:
        cut = not data.strip() or error.pos >= len(error.doc.rstrip()) or not data.rstrip().endswith(b"}")
        what = "cut off" if cut else "not JSON"
        raise MapFormatError(f"{source}: {what}, line {error.lineno}, column {error.colno}: {error.msg}") from error
    except (ValueError, RecursionError) as error:  # not UTF-8, or numbers or nesting beyond all measure
        raise MapFormatError(f"{source}: not JSON: {error}") from error
    if not isinstance(loaded, dict):
        raise MapFormatError(f"{source}: got a JSON {type(loaded).__name__}, wanted a map ({SCHEMA_NAME})")
    if loaded.get("schema") != SCHEMA_NAME:
        raise MapFormatError(f"{source}: schema: got {loaded.get('schema')!r}, wanted {SCHEMA_NAME!r}")
    try:
        return MapDocument.model_validate_json(data, strict=True)
    except ValidationError as error:
        raise MapFormatError(f"{source}: {_first_fault(error)}") from error


def _first_fault(error: ValidationError) -> str:
    faults = error.errors(include_url=False)
    first = faults[0]
    where = ".".join(str(part) for part in first["loc"])
    more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    got = "" if isinstance(first["input"], dict | BaseModel) else f", got {str(first['input'])[:80]}"
    return f"{where + ': ' if where else ''}{first['msg'].removeprefix('Value error, ')}{got}{more}"


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that at any moment the old one or the new one is there, whole.

    Raises:
        MapError: it cannot be written.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with draft.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            draft.replace(path)
            _keep_name(path.parent)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise MapError(f"{path}: cannot be written: {error}") from error


def _keep_name(folder: Path) -> None:
    # The new name itself must reach the disk too; not every file system lets a folder be synced.
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
