"""A picture for a model: pieces of a frame laid side by side, a box around each thing, and its number beside the box."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from seo_slam.agents.chips import CHIP_PX, Rect, chip_place, rect_gap
from seo_slam.agents.provenance import Box, Panel, Provenance, with_provenance
from seo_slam.geometry import FloatArray
from seo_slam.types import Frame

RED = (225, 20, 20)

COLOURS = (RED, (20, 90, 235), (0, 140, 50), (250, 145, 0), (150, 40, 200), (0, 180, 205), (245, 70, 200), (245, 215, 0))
"""Told apart at a glance; number 1 has the first."""

_EMPTY = 118
_LINE_PX, _HALO_PX = 3, 1
_LEAST_BOX_PX = 6
_FONT, _FONT_SCALE, _FONT_LINE = cv2.FONT_HERSHEY_SIMPLEX, 0.8, 2
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 90, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]

Colour = tuple[int, int, int]


class Drawing:
    """An RGB picture in the making. It copies what it takes from the frame, and changes nothing of it.

    Args:
        frame: whose pieces are shown.
        width, height: of the picture, pixels.
    """

    def __init__(self, frame: Frame, width: int, height: int) -> None:
        self.pixels: NDArray[np.uint8] = np.full((height, width, 3), _EMPTY, dtype=np.uint8)
        self.chips: list[Rect] = []
        self._frame = frame
        self._panels: list[Panel] = []

    def add(self, source: Rect, cell: Rect, boxes_px: Mapping[int, FloatArray], colours: Sequence[Colour] = (RED,)) -> None:
        """Show a piece of the frame as large as it fits into a cell, with numbered boxes.

        Args:
            source: the piece, in pixels of the frame.
            cell: where it goes, in pixels of the picture; number plates may also lie in what it leaves free of its cell.
            boxes_px: number -> (4,) box in pixels of the frame.
            colours: of the numbers 1, 2, …; repeated if there are fewer.
        """
        target = _fitted(source, cell)
        x0, y0, x1, y1 = source
        piece = self._frame.rgb[y0:y1, x0:x1]
        size = (target[2] - target[0], target[3] - target[1])
        how = cv2.INTER_AREA if size[0] < x1 - x0 else cv2.INTER_CUBIC
        self.pixels[target[1] : target[3], target[0] : target[2]] = cv2.resize(piece, size, interpolation=how)
        mapping = Panel(_as_box(source), _as_box(target), {})
        drawn = {number: _rounded_inside(mapping.in_image(_as_box(box)), target) for number, box in boxes_px.items()}
        self._panels.append(Panel(mapping.source, mapping.target, {str(number): _as_box(box) for number, box in drawn.items()}))
        colour_of = {number: colours[(number - 1) % len(colours)] for number in drawn}
        for number in sorted(drawn, key=lambda n: (-_area(drawn[n]), n)):  # small boxes over large ones
            self._outline(drawn[number], target, colour_of[number])
        for number, box in drawn.items():
            others = [other for n, other in drawn.items() if n != number]
            self._label(number, chip_place(box, others, self.chips, cell), box, colour_of[number])

    def jpeg(self) -> bytes:
        """Return the picture as a JPEG file that says where its pixels come from."""
        _, data = cv2.imencode(".jpg", cv2.cvtColor(self.pixels, cv2.COLOR_RGB2BGR), _JPEG)
        camera = self._frame.camera
        note = Provenance(float(self._frame.timestamp_s), camera.width, camera.height, tuple(self._panels))
        return with_provenance(data.tobytes(), note)

    def _outline(self, box: Rect, target: Rect, colour: Colour) -> None:
        """Draw around a box, not over it; at the border of its panel, over it."""
        edge = _grown(box, _LINE_PX, target)
        inner = (
            max(box[0], edge[0] + _LINE_PX),
            max(box[1], edge[1] + _LINE_PX),
            min(box[2], edge[2] - _LINE_PX),
            min(box[3], edge[3] - _LINE_PX),
        )
        halo = _grown(box, _LINE_PX + _HALO_PX, target)
        _ring(self.pixels, halo, edge, (255, 255, 255))
        _ring(self.pixels, edge, inner, colour)

    def _label(self, number: int, chip: Rect, box: Rect, colour: Colour) -> None:
        if rect_gap(chip, box) > CHIP_PX // 2:
            start, end = _middle(chip), _nearest_point(_middle(chip), box)
            cv2.line(self.pixels, start, end, (255, 255, 255), 4, cv2.LINE_AA)
            cv2.line(self.pixels, start, end, colour, 2, cv2.LINE_AA)
        x0, y0, x1, y1 = chip
        self.pixels[y0:y1, x0:x1] = 255
        self.pixels[y0 + 1 : y1 - 1, x0 + 1 : x1 - 1] = colour
        text = str(number)
        (width, height), _ = cv2.getTextSize(text, _FONT, _FONT_SCALE, _FONT_LINE)
        at = (x0 + (x1 - x0 - width) // 2, y1 - (y1 - y0 - height) // 2)
        cv2.putText(self.pixels, text, at, _FONT, _FONT_SCALE, _contrasting(colour), _FONT_LINE, cv2.LINE_AA)
        self.chips.append(chip)


def window_around(box_px: FloatArray, times: float, least_px: float, most_px: float, width: int, height: int) -> Rect:
    """Return a square around a box (4,), moved into an image, and cut where that is smaller.

    Args:
        box_px: the box.
        times: how many of its longer sides the square is wide.
        least_px: the square is at least so wide.
        most_px: and at most so wide.
        width: of the image.
        height: of the image.
    """
    side = min(max(times * float((box_px[2:] - box_px[:2]).max()), least_px), most_px)
    across, down = min(round(side), width), min(round(side), height)
    middle = 0.5 * (box_px[:2] + box_px[2:])
    x0 = int(np.clip(round(float(middle[0]) - 0.5 * across), 0, width - across))
    y0 = int(np.clip(round(float(middle[1]) - 0.5 * down), 0, height - down))
    return x0, y0, x0 + across, y0 + down


def cells(columns: int, rows: int, side_px: int, gap_px: int = 4) -> list[Rect]:
    """Return square cells row by row, with a gap between them."""
    half = gap_px // 2
    return [
        (c * side_px + half, r * side_px + half, (c + 1) * side_px - half, (r + 1) * side_px - half)
        for r in range(rows)
        for c in range(columns)
    ]


def _fitted(source: Rect, cell: Rect) -> Rect:
    """The largest rectangle of the source's shape in the middle of a cell."""
    width, height = source[2] - source[0], source[3] - source[1]
    scale = min((cell[2] - cell[0]) / width, (cell[3] - cell[1]) / height)
    w, h = max(round(scale * width), 1), max(round(scale * height), 1)
    x0, y0 = (cell[0] + cell[2] - w) // 2, (cell[1] + cell[3] - h) // 2
    return x0, y0, x0 + w, y0 + h


def _rounded_inside(box: Box, target: Rect) -> Rect:
    """A box in whole pixels, inside its panel and large enough to be seen."""
    x0, x1 = _stretched(round(box[0]), round(box[2]), target[0], target[2])
    y0, y1 = _stretched(round(box[1]), round(box[3]), target[1], target[3])
    return x0, y0, x1, y1


def _stretched(low: int, high: int, least: int, most: int) -> tuple[int, int]:
    low, high = max(low, least), min(high, most)
    lacking = max(_LEAST_BOX_PX - (high - low), 0)
    low = max(min(low - lacking // 2, most - _LEAST_BOX_PX), least)
    return low, min(max(high, low + _LEAST_BOX_PX), most)


def _ring(pixels: NDArray[np.uint8], outer: Rect, inner: Rect, colour: Colour) -> None:
    pixels[outer[1] : inner[1], outer[0] : outer[2]] = colour
    pixels[inner[3] : outer[3], outer[0] : outer[2]] = colour
    pixels[outer[1] : outer[3], outer[0] : inner[0]] = colour
    pixels[outer[1] : outer[3], inner[2] : outer[2]] = colour


def _grown(box: Rect, by: int, target: Rect) -> Rect:
    return max(box[0] - by, target[0]), max(box[1] - by, target[1]), min(box[2] + by, target[2]), min(box[3] + by, target[3])


def _contrasting(colour: Colour) -> Colour:
    luminance = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return (0, 0, 0) if luminance > 130 else (255, 255, 255)


def _middle(rect: Rect) -> tuple[int, int]:
    return (rect[0] + rect[2]) // 2, (rect[1] + rect[3]) // 2


def _nearest_point(point: tuple[int, int], box: Rect) -> tuple[int, int]:
    return min(max(point[0], box[0]), box[2] - 1), min(max(point[1], box[1]), box[3] - 1)


def _area(rect: Rect) -> int:
    return (rect[2] - rect[0]) * (rect[3] - rect[1])


def _as_box(rect: Sequence[float] | FloatArray) -> Box:
    x0, y0, x1, y1 = (float(edge) for edge in rect)
    return x0, y0, x1, y1
