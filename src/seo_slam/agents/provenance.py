"""Where the pixels of an image that is sent to a model come from: a note inside the JPEG itself.

It names no landmark. Whoever scores a model, or plays one, can tell from it which part of which frame lies in each drawn box.
"""

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Box = tuple[float, float, float, float]
"""``x0, y0, x1, y1`` in pixels: the slice ``image[y0:y1, x0:x1]``."""

_SOI, _COM, _SOS, _EOI = 0xD8, 0xFE, 0xDA, 0xD9
_MOST_BYTES = 65533  # of one comment segment


@dataclass(frozen=True, slots=True)
class Panel:
    """A piece of a frame, laid into an image.

    Attributes:
        source: the piece, in pixels of the frame.
        target: where it lies, in pixels of the image. It is scaled, nothing else.
        boxes: number drawn at a box -> the box, in pixels of the image.
    """

    source: Box
    target: Box
    boxes: Mapping[str, Box]

    def in_frame(self, box: Box) -> Box:
        """Return a box of the image in pixels of the frame."""
        return _mapped(box, self.target, self.source)

    def in_image(self, box: Box) -> Box:
        """Return a box of the frame in pixels of the image."""
        return _mapped(box, self.source, self.target)


@dataclass(frozen=True, slots=True)
class Provenance:
    """What an image was made of.

    Attributes:
        timestamp_s: stamp of the frame.
        width, height: of the frame, in pixels.
        panels: the pieces of it.
    """

    timestamp_s: float
    width: int
    height: int
    panels: tuple[Panel, ...]


def with_provenance(jpeg: bytes, provenance: Provenance) -> bytes:
    """Return the same picture with the note in a comment segment right after its first marker.

    Raises:
        ValueError: it is no JPEG, or the note is longer than 65,533 bytes.
    """
    if jpeg[:2] != bytes((0xFF, _SOI)):
        raise ValueError(f"got bytes that begin with {jpeg[:2]!r}, wanted a JPEG")
    note = json.dumps(_plain(provenance), separators=(",", ":"), allow_nan=False).encode()
    if len(note) > _MOST_BYTES:
        raise ValueError(f"the note is {len(note)} bytes long, wanted at most {_MOST_BYTES}")
    return jpeg[:2] + struct.pack(">BBH", 0xFF, _COM, len(note) + 2) + note + jpeg[2:]


def provenance_of(jpeg: bytes) -> Provenance | None:
    """Return the note inside a JPEG; None if there is none, or none that can be read."""
    for comment in _comments(jpeg):
        try:
            return _parsed(json.loads(comment))
        except (ValueError, KeyError, TypeError, RecursionError):
            continue  # a comment of somebody else
    return None


def _mapped(box: Box, here: Box, there: Box) -> Box:
    scale_x = (there[2] - there[0]) / (here[2] - here[0])
    scale_y = (there[3] - there[1]) / (here[3] - here[1])
    return (
        there[0] + scale_x * (box[0] - here[0]),
        there[1] + scale_y * (box[1] - here[1]),
        there[0] + scale_x * (box[2] - here[0]),
        there[1] + scale_y * (box[3] - here[1]),
    )


def _plain(provenance: Provenance) -> dict[str, Any]:
    return {
        "seo_slam": 1,
        "timestamp_s": provenance.timestamp_s,
        "width": provenance.width,
        "height": provenance.height,
        "panels": [
            {
                "source": _rounded(panel.source),
                "target": _rounded(panel.target),
                "boxes": {number: _rounded(box) for number, box in panel.boxes.items()},
            }
            for panel in provenance.panels
        ],
    }


def _rounded(box: Box) -> list[float]:
    return [round(float(edge), 3) for edge in box]


def _comments(jpeg: bytes) -> list[bytes]:
    """The comment segments before the picture's data; as far as it can be followed."""
    found = []
    at = 2 if jpeg[:2] == bytes((0xFF, _SOI)) else len(jpeg)
    while at + 4 <= len(jpeg) and jpeg[at] == 0xFF and jpeg[at + 1] not in (_SOS, _EOI):
        length = int.from_bytes(jpeg[at + 2 : at + 4], "big")
        if length < 2 or at + 2 + length > len(jpeg):
            break
        if jpeg[at + 1] == _COM:
            found.append(jpeg[at + 4 : at + 2 + length])
        at += 2 + length
    return found


def _parsed(note: Any) -> Provenance:
    if note["seo_slam"] != 1:
        raise ValueError("a note of another version")
    panels = tuple(
        Panel(_box(panel["source"]), _box(panel["target"]), {str(number): _box(box) for number, box in dict(panel["boxes"]).items()})
        for panel in list(note["panels"])
    )
    return Provenance(_finite(note["timestamp_s"]), int(note["width"]), int(note["height"]), panels)


def _box(edges: Any) -> Box:
    x0, y0, x1, y1 = (_finite(edge) for edge in edges)
    if not (x0 < x1 and y0 < y1):
        raise ValueError("a box without inside")
    return x0, y0, x1, y1


def _finite(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError("not finite")
    return number
