"""Read what is true of a scene: ``truth.json`` of a recording, and files of synonyms.

Unknown keys are allowed, since truth comes from many hands; what is used is checked, and a mistake names file, object and key.
"""

import json
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from seo_slam.errors import DatasetError
from seo_slam.evaluation.true_objects import FormerPlace, Truth, TruthObject
from seo_slam.geometry import FloatArray

Vector = tuple[float, float, float]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False, coerce_numbers_to_str=True)


class ObjectEntry(_Entry):
    """One object of ``truth.json``: metres, world frame. At least one centre or the box must be there."""

    id: str
    label: str = ""
    accepted_labels: tuple[str, ...] = ()
    center: Vector | None = None
    surface_center: Vector | None = None
    aabb_min: Vector | None = None
    aabb_max: Vector | None = None
    visible_keyframes: int | None = Field(None, ge=0)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if not self.words():
            raise ValueError("has neither 'label' nor 'accepted_labels'")
        if (self.aabb_min is None) != (self.aabb_max is None):
            raise ValueError("has only one of 'aabb_min' and 'aabb_max'")
        if self.aabb_min and self.aabb_max and any(low > high for low, high in zip(self.aabb_min, self.aabb_max, strict=True)):
            raise ValueError(f"'aabb_min' {self.aabb_min} is not below 'aabb_max' {self.aabb_max}")
        if not self.centers():
            raise ValueError("has no place: give 'center', or 'aabb_min' and 'aabb_max'")
        return self

    def words(self) -> tuple[str, ...]:
        """All labels that count as right."""
        return tuple(dict.fromkeys(word for word in (self.label, *self.accepted_labels) if word.strip()))

    def centers(self) -> list[Vector]:
        """The places a landmark may be measured against: as given, of the visible surface, middle of the box."""
        found = [point for point in (self.center, self.surface_center) if point is not None]
        if self.aabb_min and self.aabb_max:
            low, high = self.aabb_min, self.aabb_max
            found.append(((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2))
        return found

    def to_object(self) -> TruthObject:
        """What the evaluation needs of it."""
        half_m, box_m = 0.0, None
        if self.aabb_min and self.aabb_max:
            half_m = min(self.aabb_max[0] - self.aabb_min[0], self.aabb_max[1] - self.aabb_min[1]) / 2
            box_m = np.array([self.aabb_min, self.aabb_max])
        return TruthObject(self.id, self.words(), np.array(self.centers()), half_m, self.visible_keyframes, box_m)


class EventEntry(_Entry):
    """One change of the scene while it was recorded.

    ``center`` is a place where the object was or came to be; an optional ``previous_center`` where it was before. The box, if given, is
    that around ``center``.
    """

    timestamp_s: float
    event: str
    id: str
    center: Vector | None = None
    previous_center: Vector | None = None
    aabb_min: Vector | None = None
    aabb_max: Vector | None = None
    label: str = ""
    accepted_labels: tuple[str, ...] = ()

    def size_m(self) -> FloatArray | None:
        """Extent (3,) of the box; None where it is not given."""
        if self.aabb_min is None or self.aabb_max is None:
            return None
        return np.asarray(np.abs(np.array(self.aabb_max) - np.array(self.aabb_min)), dtype=np.float64)


class TruthFile(_Entry):
    """A whole ``truth.json``: the objects present when the recording ends, and what changed before."""

    objects: tuple[ObjectEntry, ...]
    timeline: tuple[EventEntry, ...] = ()

    def to_truth(self) -> Truth:
        """What the evaluation needs of it."""
        objects = tuple(entry.to_object() for entry in self.objects)
        known = {item.id: item for item in objects}
        words = {event.id: event for event in self.timeline if event.label or event.accepted_labels}
        places: list[FormerPlace] = []
        for event in self.timeline:
            item = known.get(event.id)
            named = words.get(event.id)
            labels = item.labels if item else ((named.label, *named.accepted_labels) if named else ())
            labels = tuple(word for word in labels if word.strip())
            size_m = event.size_m()
            if size_m is None and item is not None and item.box_m is not None:
                size_m = item.box_m[1] - item.box_m[0]
            half_m = 0.0 if size_m is None else float(min(size_m[0], size_m[1])) / 2
            for point in (event.previous_center, event.center):
                if point is not None:
                    places.append(FormerPlace(event.id, event.event, labels, np.array(point), half_m, size_m))
        return Truth(objects, tuple(places))


def read_truth(path: str | Path) -> Truth:
    """Read the true objects of a scene.

    Raises:
        DatasetError: the file is missing or not JSON (with its line), or an object is wrong (with its number, id and key).
    """
    file = Path(path)
    return truth_from(_read_json(file), str(file))


def truth_from(content: Any, where: str = "truth") -> Truth:
    """Take the true objects of a scene from the content of a ``truth.json``, such as ``SimulatedRecording.truth``.

    Args:
        content: a mapping with "objects" and perhaps "timeline".
        where: what messages call it.

    Raises:
        DatasetError: an object is wrong (with its number, id and key), or there is none.
    """
    if not isinstance(content, dict) or "objects" not in content:
        raise DatasetError(f"{where}: wanted a JSON object with the key 'objects', got {_kind(content)}")
    try:
        checked = TruthFile.model_validate(content)
    except ValidationError as error:
        raise DatasetError(f"{where}: " + "; ".join(_explain(item, content) for item in error.errors())) from None
    ids = [entry.id for entry in checked.objects]
    doubled = sorted({name for name in ids if ids.count(name) > 1})
    if doubled:
        raise DatasetError(f"{where}: two objects have the id {doubled[0]!r}; wanted each id once")
    if not ids:
        raise DatasetError(f"{where}: 'objects' is empty; wanted at least one object present at the end")
    return checked.to_truth()


def read_synonyms(path: str | Path) -> list[list[str]]:
    """Read groups of words that mean the same: a JSON list of lists of words.

    Raises:
        DatasetError: the file is missing, not JSON, or of another form.
    """
    file = Path(path)
    raw = _read_json(file)
    if not isinstance(raw, list):
        raise DatasetError(f"{file}: wanted a JSON list of lists of words, got {_kind(raw)}")
    for number, words in enumerate(raw):
        if not isinstance(words, list) or not all(isinstance(word, str) for word in words) or len(words) < 2:
            raise DatasetError(f"{file}: group {number} is {json.dumps(words)}, wanted a list of two words or more")
    return raw


def _read_json(file: Path) -> Any:
    if not file.is_file():
        raise DatasetError(f"{file}: no such file")
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise DatasetError(f"{file}: not JSON: {error}") from None


def _kind(raw: Any) -> str:
    return f"the keys {sorted(raw)}" if isinstance(raw, dict) else f"a {type(raw).__name__}"


def _explain(item: Any, raw: dict[str, Any]) -> str:
    where = list(item["loc"])
    name = ".".join(str(part) for part in where)
    if len(where) > 1 and isinstance(where[1], int):
        entry = raw[where[0]][where[1]]
        label = f" ({entry['id']!r})" if isinstance(entry, dict) and "id" in entry else ""
        key = ".".join(str(part) for part in where[2:])
        name = f"{where[0]}[{where[1]}]{label}" + (f" {key}" if key else "")
    message = str(item["msg"]).removeprefix("Value error, ")
    got = item.get("input")
    return f"{name}: {message}" + (f", got {got!r}" if not isinstance(got, dict) else "")
