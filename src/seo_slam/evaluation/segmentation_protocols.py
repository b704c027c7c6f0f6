"""The three protocols by which maps with clouds are scored: as DualMap, HOV-SG and ConceptGraphs do it.

They differ in which classes are dropped, in how a true point gets its predicted class, in which classes the mean is taken over, and in
how scenes are put together; so one prediction has three scores, and only scores of one protocol may be compared.
"""

from dataclasses import dataclass
from typing import Any, Literal

from seo_slam.errors import EvaluationError


@dataclass(frozen=True, slots=True)
class SegmentationProtocol:
    """One way to score a segmentation.

    Attributes:
        name: stated in every result.
        neighbours: a true point gets the class of most of so many nearest predicted points; the smaller class id on a tie.
        dropped_words: true points of classes named by these words are left out.
        drops_by: "part": a word anywhere in a class's name drops it ("wall" also drops "wall shelf"); "name": only the very name.
        masked: objects may be called only by classes that have true points here and are not dropped; else by all classes.
        mean_over: which classes the mean IoU is taken over. "union": those of true and of predicted points; a dropped class that was
            predicted is in it with IoU 0, and so is a class that only the prediction has. "truth": those of true points.
        scenes: "mean": of the scenes' values; "confusion": of the scenes' confusion matrices added up.
    """

    name: str
    neighbours: int
    dropped_words: tuple[str, ...]
    drops_by: Literal["part", "name"]
    masked: bool
    mean_over: Literal["union", "truth"]
    scenes: Literal["mean", "confusion"]

    def drops(self, class_name: str) -> bool:
        """Whether points of this class are left out."""
        name = class_name.casefold().strip()
        return any(word in name for word in self.dropped_words) if self.drops_by == "part" else name in self.dropped_words

    def as_dict(self) -> dict[str, Any]:
        """What a result states."""
        return {
            "protocol": self.name,
            "neighbours": self.neighbours,
            "dropped_words": list(self.dropped_words),
            "drops_by": self.drops_by,
            "objects_are_named": "by true classes that are not dropped" if self.masked else "by all class names",
            "mean_over": self.mean_over,
            "scenes": self.scenes,
        }


DUALMAP = SegmentationProtocol(
    name="segmentation/dualmap",
    neighbours=5,
    dropped_words=("wall", "floor", "ceiling", "pillar", "window", "vent", "background"),
    drops_by="part",
    masked=False,
    mean_over="union",
    scenes="mean",
)
"""DualMap's: doors count."""

HOVSG = SegmentationProtocol(
    name="segmentation/hovsg",
    neighbours=5,
    dropped_words=("wall", "floor", "ceiling", "door", "window", "background"),
    drops_by="part",
    masked=False,
    mean_over="truth",
    scenes="mean",
)
"""HOV-SG's: doors are dropped, and a class that only the prediction has costs nothing. Its public code keeps dropped points as places
where a prediction may be wrong; that charges a map without walls for the wall behind each thing, so they are dropped here as well."""

CONCEPTGRAPHS = SegmentationProtocol(
    name="segmentation/conceptgraphs",
    neighbours=1,
    dropped_words=("wall", "floor", "ceiling", "door", "window", "other"),
    drops_by="name",
    masked=True,
    mean_over="truth",
    scenes="confusion",
)
"""ConceptGraphs': objects choose among the classes of the scene only, so that every object is some true class."""

PROTOCOLS = {protocol.name: protocol for protocol in (DUALMAP, HOVSG, CONCEPTGRAPHS)}
"""All, by name."""


def protocols_named(text: str) -> tuple[SegmentationProtocol, ...]:
    """Return the protocols that a text names: "dualmap", "segmentation/dualmap", several with commas, or "all".

    Raises:
        EvaluationError: an unknown name.
    """
    if text.strip() == "all":
        return tuple(PROTOCOLS.values())
    found = []
    for word in text.split(","):
        name = word.strip() if word.strip().startswith("segmentation/") else f"segmentation/{word.strip()}"
        if name not in PROTOCOLS:
            known = ", ".join(sorted(known.removeprefix("segmentation/") for known in PROTOCOLS))
            raise EvaluationError(f"protocol: got {word.strip()!r}, wanted {known} or all")
        found.append(PROTOCOLS[name])
    return tuple(dict.fromkeys(found))
