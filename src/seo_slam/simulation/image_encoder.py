"""An image encoder for simulated frames: as good and as bad as is said, so that Eq 1 of DualMap can be tried without a network.

Figures that rest on it must say "simulated encoder".
"""

from collections import OrderedDict
from collections.abc import Sequence

import numpy as np

from seo_slam.errors import ConfigError, FrameError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder
from seo_slam.simulation.box_pictures import InBox, PictureFrame
from seo_slam.simulation.draws import generator
from seo_slam.simulation.furniture import FURNITURE
from seo_slam.simulation.inventories import INVENTORIES
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.simulation.stand_ins import STAND_INS
from seo_slam.simulation.visible import View
from seo_slam.types import Frame

OBJECT_ANGLE_DEG = 45.0
"""How far the picture of a thing is from the word for it, from all sides."""
INSTANCE_ANGLE_DEG = 15.0
"""Between the direction in which all copies of a model differ from the word, and that in which one of them does: wear, light, place."""
VIEW_ANGLE_DEG = 30.0
"""How far one view of a thing is from what it looks like from all sides."""
_WORDS = tuple(
    dict.fromkeys([*(word for room in INVENTORIES.values() for word in room), *FURNITURE, *STAND_INS, "wall", "floor", "ceiling"])
)
_INSTANCE_RAD = float(np.radians(INSTANCE_ANGLE_DEG))


class SimulatedImageEncoder:
    """An ``Embedder`` and ``CropEmbedder`` that knows the truth, for the frames of a simulated recording.

    The vector of a box is the text vector of what is in its middle, turned by ``object_angle_deg`` in a direction that belongs to what the
    thing looks like, and by ``view_angle_deg`` in one that belongs to thing and frame. Two things in a box mix by how much of its middle
    they fill. What is no thing counts a third, and is called by what it is: wall, floor, ceiling, window, ….

    What looks alike is alike: the direction of a thing is that of its model (of its label, where it is made of plain shapes), but for
    ``INSTANCE_ANGLE_DEG`` of its own. With MiniLM's words the means over forty views of two copies of a mug have a cosine of 0.89 to 0.97,
    those of two models of mug 0.20 to 0.68 (eight seeds).

    Directions lie among the vectors of indoor words, so that what is taken for something else is taken for another word, as with a
    network. With the default angles and MiniLM's words one view of a thing in its true box is nearest to its own word among 40 in 74 to
    86 % of cases (apartments 10 to 12, four seeds of the encoder each, boxes that show 60 pixels of it or more at 160x120), a perfect
    encoder (both angles 0) in 91 to 98 %, since boxes show more than their thing.
    """

    def __init__(
        self,
        embedder: Embedder,
        seed: int = 0,
        object_angle_deg: float = OBJECT_ANGLE_DEG,
        view_angle_deg: float = VIEW_ANGLE_DEG,
        kept_frames: int = 200,
    ) -> None:
        """Make an encoder; both angles 0: a perfect one.

        Args:
            embedder: of the words.
            seed: of all directions.
            object_angle_deg: 0..90.
            view_angle_deg: 0..90.
            kept_frames: so many frames, those shown last, are known.

        Raises:
            ConfigError: an angle or a number out of range.
        """
        for name, angle_deg in (("object_angle_deg", object_angle_deg), ("view_angle_deg", view_angle_deg)):
            if not 0.0 <= angle_deg <= 90.0:
                raise ConfigError(f"simulated image encoder: {name} is {angle_deg}, wanted 0..90")
        if kept_frames < 1:
            raise ConfigError(f"simulated image encoder: kept_frames is {kept_frames}, wanted at least 1")
        self._embedder = embedder
        self._seed = seed
        self._object_rad, self._view_rad = float(np.radians(object_angle_deg)), float(np.radians(view_angle_deg))
        self._kept_frames = kept_frames
        self._shown: OrderedDict[float, PictureFrame] = OrderedDict()
        self._span: FloatArray | None = None
        self._objects: dict[tuple[str, str, str], FloatArray] = {}

    @classmethod
    def of(
        cls,
        recording: SimulatedRecording,
        embedder: Embedder,
        object_angle_deg: float = OBJECT_ANGLE_DEG,
        view_angle_deg: float = VIEW_ANGLE_DEG,
        kept_frames: int = 200,
    ) -> "SimulatedImageEncoder":
        """Return an encoder with the seed of a recording; it knows the frames that are drawn from now on, the newest ``kept_frames``."""
        encoder = cls(embedder, recording.seed, object_angle_deg, view_angle_deg, kept_frames)
        recording.show_to(encoder)
        return encoder

    @property
    def name(self) -> str:
        """That of the embedder of words: a map made with pictures is asked with words."""
        return self._embedder.name

    @property
    def size(self) -> int:
        """D, the length of a vector."""
        return self._embedder.size

    def embed_text(self, texts: Sequence[str]) -> FloatArray:
        """Return (N, D) float64 unit rows, those of the embedder of words."""
        return self._embedder.embed_text(texts)

    def show(self, timestamp_s: float, view: View) -> None:
        """Tell what is in the frame of this stamp; frames may come in any order, and again."""
        self._shown.pop(timestamp_s, None)
        self._shown[timestamp_s] = PictureFrame.of(view)
        while len(self._shown) > self._kept_frames:
            self._shown.popitem(last=False)

    def embed_crops(self, frame: Frame, boxes_px: FloatArray) -> FloatArray:
        """Return (N, D) float64 unit rows of what is in boxes (N, 4) of a frame.

        Raises:
            FrameError: the frame was never shown, or is not among the newest any more.
        """
        shown = self._shown.get(frame.timestamp_s)
        if shown is None:
            raise FrameError(
                f"frame {frame.index} (t={frame.timestamp_s}): not among the newest {self._kept_frames} frames that were shown to the "
                "simulated image encoder"
            )
        rows = [self._picture(shown.index, seen) for seen in shown.in_boxes(boxes_px)]
        return np.array(rows, dtype=np.float64).reshape(len(boxes_px), self.size)

    def _picture(self, index: int, seen: Sequence[InBox]) -> FloatArray:
        """(D,) what one view of some things looks like."""
        main = seen[0]
        mixed = np.sum([part.weight * self._object(part) for part in seen[:2]], axis=0)
        return self._turned(mixed / np.linalg.norm(mixed), self._view_rad, self._weights("view", main.name, index))

    def _object(self, seen: InBox) -> FloatArray:
        """(D,) a thing from all sides."""
        key = (seen.name, seen.look, seen.word)
        if key not in self._objects:
            alike, own = self._weights("look", seen.look), self._weights("object", seen.name)
            weights = np.cos(_INSTANCE_RAD) * alike + np.sin(_INSTANCE_RAD) * own
            self._objects[key] = self._turned(self.embed_text([seen.word])[0], self._object_rad, weights)
        return self._objects[key]

    def _weights(self, *key: int | str) -> FloatArray:
        """How much of each indoor word is in a direction."""
        return generator(self._seed, "picture", *key).standard_normal(len(_WORDS))

    def _turned(self, v: FloatArray, angle_rad: float, weights: FloatArray) -> FloatArray:
        """A unit vector (D,) turned by an angle in a direction that is made of words."""
        if angle_rad == 0.0:
            return v
        if self._span is None:
            self._span = self.embed_text(_WORDS)
        direction = weights @ self._span
        direction -= (direction @ v) * v
        length = float(np.linalg.norm(direction))
        if length < 1e-9:  # the words span nothing else
            return v
        turned = np.cos(angle_rad) * v + np.sin(angle_rad) * direction / length
        return np.asarray(turned / np.linalg.norm(turned))
