"""How imperfect the simulated detector is."""

from dataclasses import dataclass
from typing import Self

from seo_slam.simulation.sensors import require_level

PIXELS_OF_VGA = 640 * 480


@dataclass(frozen=True, slots=True)
class DetectorKnobs:
    """How imperfect the detector is.

    Attributes:
        miss: chance that a thing in plain view is missed in a frame.
        visibility: how much small, hidden and cut-off things are missed beyond that (0: not at all, 1: fully).
        relabel: chance that a box bears a look-alike's label.
        sticky: share of the label draws that belong to the thing and the side it is seen from; the rest are made anew each frame.
        box_jitter: standard deviation of each edge, as a share of the box's size.
        merge: chance that two neighbours of one class, closer than half the smaller box's diagonal, come as one box.
        split: chance that a thing comes as two boxes: half of the time cut in two, half of the time seen twice.
        phantom_spots, phantom_rate: fixed places where something is seen that is not there, and how often when in view.
        spurious: mean number of loose false boxes a frame.
        smallest_px: visible pixels, in a 640x480 image, below which nothing is detected; scaled to the size of the image.
    """

    miss: float = 0.0
    visibility: float = 0.0
    relabel: float = 0.0
    sticky: float = 0.7
    box_jitter: float = 0.0
    merge: float = 0.0
    split: float = 0.0
    phantom_spots: int = 0
    phantom_rate: float = 0.35
    spurious: float = 0.0
    smallest_px: float = 60.0

    @classmethod
    def at_level(cls, level: float) -> Self:
        """Return the knobs of a level: 0 is perfect, 1 the reference.

        Raises:
            ConfigError: the level is below 0.
        """
        require_level(level)

        def chance(at_one: float) -> float:
            return min(at_one * level, 0.95)

        return cls(
            miss=chance(0.12),
            visibility=min(level, 1.0),
            relabel=chance(0.22),
            box_jitter=0.04 * level,
            merge=chance(0.35),
            split=chance(0.06),
            phantom_spots=int(6 * level),
            spurious=0.15 * level,
        )

    def smallest_in(self, height: int, width: int) -> float:
        """Return how many visible pixels a thing needs in an image of this size, at least one."""
        return max(self.smallest_px * height * width / PIXELS_OF_VGA, 1.0)
