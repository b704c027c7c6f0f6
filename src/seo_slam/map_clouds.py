"""The file clouds.ply: the points of all landmarks of a map, binary, for reading back and for any 3D viewer."""

import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from seo_slam.datasets.ply import read_ply
from seo_slam.errors import DatasetError, MapError, MapFormatError
from seo_slam.geometry import FloatArray
from seo_slam.map_document import write_atomically

CLOUDS_FILE = "clouds.ply"
"""Its name in the folder of a map."""

_ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("landmark", "<i4")])
_CHECKSUM = "crc32 "


def write_clouds(path: Path, clouds: Mapping[int, FloatArray]) -> None:
    """Write the points (M, 3) of landmarks, world frame, metres; the same clouds give the same bytes.

    Vertices are float x, y, z and int landmark, by rising id; a landmark without points leaves no trace. Numbers are single precision: a
    micrometre at ten metres. A comment holds the checksum of the points.

    Raises:
        MapError: a cloud is not (M, 3) or not finite, an id does not fit, or the file cannot be written.
    """
    ids = sorted(clouds)
    for landmark_id in ids:
        points = clouds[landmark_id]
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise MapError(f"{path}: the cloud of landmark {landmark_id} is {points.shape}, wanted finite (M, 3)")
        if not 0 <= landmark_id < 2**31:
            raise MapError(f"{path}: got landmark {landmark_id}, wanted 0..{2**31 - 1}")
    rows = np.zeros(sum(len(clouds[i]) for i in ids), dtype=_ROW)
    if len(rows):
        points = np.concatenate([clouds[i] for i in ids])
        for axis, name in enumerate("xyz"):
            rows[name] = points[:, axis]
        rows["landmark"] = np.repeat(ids, [len(clouds[i]) for i in ids])
    data = rows.tobytes()
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment seo_slam clouds, frame world, metres",
        f"comment {_CHECKSUM}{zlib.crc32(data):08x}",
        f"element vertex {len(rows)}",
        *(f"property float {axis}" for axis in "xyz"),
        "property int landmark",
        "end_header",
    ]
    write_atomically(path, "\n".join(header).encode() + b"\n" + data)


def read_clouds(path: Path) -> dict[int, FloatArray]:
    """Read what ``write_clouds`` wrote, or a viewer saved of it: landmark id -> (M, 3) float64, world frame, metres.

    Raises:
        MapFormatError: missing, no PLY file, cut off, changed since it was written (where a checksum is left), without x, y, z or landmark,
            or with points that are not finite or of no landmark.
    """
    try:
        ply = read_ply(path)
    except DatasetError as error:
        raise MapFormatError(str(error)) from error
    lacking = [name for name in _ROW.names or () if name not in ply.vertices]
    if lacking:
        raise MapFormatError(f"{path}: vertices have no {', '.join(lacking)}; wanted x, y, z and landmark")
    ids = ply.vertices["landmark"]
    bad = ~np.logical_and.reduce([np.isfinite(ply.vertices[axis]) for axis in "xyz"])
    if ids.dtype.kind not in "iu" or (ids < 0).any():
        raise MapFormatError(f"{path}: 'landmark' must be whole numbers from 0 on")
    if bad.any():
        raise MapFormatError(f"{path}: point {int(np.argmax(bad))} is not finite")
    points = np.column_stack([ply.vertices[axis].astype(np.float64) for axis in "xyz"])  # only now: casting some NaN warns
    rows = np.zeros(len(ids), dtype=_ROW)
    for name in _ROW.names or ():
        rows[name] = ply.vertices[name]
    noted = [comment.removeprefix(_CHECKSUM) for comment in ply.comments if comment.startswith(_CHECKSUM)]
    if noted and noted[0] != f"{zlib.crc32(rows.tobytes()):08x}":
        raise MapFormatError(f"{path}: damaged: the points do not have the checksum {noted[0]} that was noted when they were written")
    order = np.argsort(ids, kind="stable")
    names, starts = np.unique(ids[order], return_index=True)
    return {int(name): part for name, part in zip(names, np.split(points[order], starts[1:]), strict=True)} if len(ids) else {}
