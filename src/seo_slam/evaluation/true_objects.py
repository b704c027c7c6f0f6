"""What is true of a scene, as the evaluation needs it: the objects that are there at the end, and where others were."""

from dataclasses import dataclass

from seo_slam.geometry import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TruthObject:
    """An object that is there when the recording ends.

    Attributes:
        id: its name in the truth.
        labels: all words that count as right; the first is its class.
        centers_m: (C, 3) its centres in the true world (of the box, of the visible surface); the nearest one counts.
        half_extent_m: half the smaller horizontal extent; 0 where no box is known.
        visible_keyframes: in how many keyframes it was in view; None where unknown.
        box_m: (2, 3) low and high corner of its box; None where unknown.
    """

    id: str
    labels: tuple[str, ...]
    centers_m: FloatArray
    half_extent_m: float = 0.0
    visible_keyframes: int | None = None
    box_m: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FormerPlace:
    """A place named by the timeline. Where the object is not there (any more) at the end, a landmark there is a ghost.

    Attributes:
        id: the object's.
        event: "removed", "moved" or "added".
        labels: the object's; empty where unknown, and then any label counts.
        center_m: (3,) in the true world.
        half_extent_m: as for ``TruthObject``.
        size_m: (3,) extent along x, y and z; None where unknown.
    """

    id: str
    event: str
    labels: tuple[str, ...]
    center_m: FloatArray
    half_extent_m: float = 0.0
    size_m: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The objects present at the end, and the places that the timeline names."""

    objects: tuple[TruthObject, ...]
    places: tuple[FormerPlace, ...] = ()

    def left_places(self, radius_m: float) -> tuple[FormerPlace, ...]:
        """The places where their object is not any more: none of its centres is within reach (``reach_m``)."""
        return tuple(place for place in self.places if not any(_is_at(item, place, radius_m) for item in self.objects))


def reach_m(item: TruthObject | FormerPlace, radius_m: float) -> float:
    """How far from it a landmark may be: the radius, or half the smaller horizontal extent if that is more."""
    return max(radius_m, item.half_extent_m)


def _is_at(item: TruthObject, place: FormerPlace, radius_m: float) -> bool:
    if item.id != place.id:
        return False
    gaps = ((item.centers_m - place.center_m) ** 2).sum(axis=1) ** 0.5
    return float(gaps.min()) <= reach_m(item, radius_m)
