"""A map in other formats: CSV for tables, PLY for 3D viewers."""

import colorsys
import csv
import io
import json
import zlib
from collections.abc import Sequence

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.map import Map
from seo_slam.types import Landmark

CSV_COLUMNS = (
    "id", "label", "weight", "x_m", "y_m", "z_m", "sigma_x_m", "sigma_y_m", "sigma_z_m", "size_x_m", "size_y_m", "size_z_m",
    "observations", "first_seen_s", "last_seen_s", "state", "existence", "category",
)  # fmt: skip

# Corners of a box as signs of its half size; the triangles of its sides, seen from outside counter-clockwise.
_CORNERS = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
_TRIANGLES = (
    (0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5),
)  # fmt: skip
_LEAST_SIDE_M = 0.01


def to_csv(source: Map, tentative: bool = False) -> str:
    """Return one line a landmark, by rising id, under a line with ``CSV_COLUMNS``; world frame, metres, seconds.

    ``weight`` is that of ``label``, or else of ``category``, among all labels seen; ``sigma_*_m`` are standard deviations of the position.

    Args:
        source: the map.
        tentative: also landmarks that are not stable: tentative or lost.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for row in _chosen(source, tentative):
        sigma_m = np.sqrt(np.diag(row.covariance_m2))
        numbers = [repr(round(float(x), 9) + 0.0) for x in (*row.position_m, *sigma_m, *row.size_m)]
        weight = round(row.labels.get(row.label, row.labels.get(row.category, 0.0)), 9)
        stamps = (row.first_seen_s, row.last_seen_s)
        tail = (row.observations, *stamps, row.state, round(row.existence, 9), row.category)
        writer.writerow((row.id, row.label, weight, *numbers, *tail))
    return out.getvalue()


def to_ply(source: Map, tentative: bool = False) -> str:
    """Return a coloured box a landmark as an ASCII PLY mesh, world frame, metres; the same label has the same colour.

    A box is 8 vertices and 12 triangles, which MeshLab, CloudCompare, Blender and Open3D all open; a side is at least 1 cm, so that
    nothing vanishes. Each vertex carries its landmark's id as the scalar ``landmark_id``, and a comment a landmark tells its label.

    Args:
        source: the map.
        tentative: also landmarks that are not stable: tentative or lost.
    """
    rows = _chosen(source, tentative)
    lines = [
        "ply",
        "format ascii 1.0",
        f"comment seo_slam map, frame world, metres, gravity {source.gravity}",
        # JSON keeps a label on one line and in ASCII, whatever it holds.
        *(f"comment landmark {row.id} {json.dumps(row.label)}" for row in rows),
        f"element vertex {8 * len(rows)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {channel}" for channel in ("red", "green", "blue")),
        "property int landmark_id",
        f"element face {len(_TRIANGLES) * len(rows)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    for row in rows:
        tail = " ".join(str(c) for c in label_color(row.label)) + f" {row.id}"
        lines += [f"{x:.6f} {y:.6f} {z:.6f} {tail}" for x, y, z in box_corners(row)]
    lines += [f"3 {8 * i + a} {8 * i + b} {8 * i + c}" for i in range(len(rows)) for a, b, c in _TRIANGLES]
    return "\n".join(lines) + "\n"


def box_corners(landmark: Landmark) -> FloatArray:
    """Return the (8, 3) corners of a landmark's box, world frame, metres; its sides are at least 1 cm."""
    return np.asarray(landmark.position_m + 0.5 * np.maximum(landmark.size_m, _LEAST_SIDE_M) * _CORNERS, dtype=np.float64)


def label_color(label: str) -> tuple[int, int, int]:
    """Return a colour, 0..255 each of red, green, blue, that depends on nothing but the label; grey for none."""
    if not label:
        return (128, 128, 128)
    code = zlib.crc32(label.encode("utf-8", "replace"))
    r, g, b = colorsys.hsv_to_rgb((code & 0xFFFF) / 0x10000, 0.55 + 0.35 * ((code >> 16) & 1), 0.95 - 0.2 * ((code >> 17) & 1))
    return (round(255 * r), round(255 * g), round(255 * b))


def _chosen(source: Map, tentative: bool) -> Sequence[Landmark]:
    rows = (*source.landmarks, *source.tentative) if tentative else source.landmarks
    return sorted(rows, key=lambda row: row.id)
