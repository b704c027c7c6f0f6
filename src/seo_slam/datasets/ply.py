"""Points of a PLY file, text or binary: each property of its vertices as an array."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seo_slam.errors import DatasetError
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray

_TYPES = {
    **{name: kind for names, kind in ((("char", "int8"), "i1"), (("uchar", "uint8"), "u1"), (("short", "int16"), "i2")) for name in names},
    **{
        name: kind for names, kind in ((("ushort", "uint16"), "u2"), (("int", "int32"), "i4"), (("uint", "uint32"), "u4")) for name in names
    },
    **{name: kind for names, kind in ((("float", "float32"), "f4"), (("double", "float64"), "f8")) for name in names},
}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 1 << 20


@dataclass(frozen=True, slots=True, eq=False)
class Ply:
    """What was read of a PLY file.

    Attributes:
        vertices: property -> (N,) values, of the type that the file says, in the machine's byte order.
        comments: the header's comments.
    """

    vertices: Mapping[str, NDArray[Any]]
    comments: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Header:
    order: str
    count: int
    fields: tuple[tuple[str, str], ...]
    comments: tuple[str, ...]
    has_more: bool
    size: int


def read_ply(path: Path) -> Ply:
    """Read the vertices of a PLY file; other elements, such as faces, may follow them and are not looked at.

    Raises:
        DatasetError: it cannot be read, is no PLY file, is cut off or longer than its header says, or its vertices come after another
            element, hold lists, or, as text, a number that is none of the property's type.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None
    header = _header(data, path)
    return Ply(_of_text(data, header, path) if not header.order else _of_binary(data, header, path), header.comments)


def _header(data: bytes, path: Path) -> _Header:
    if not data.startswith((b"ply\n", b"ply\r\n")):
        raise DatasetError(f"{path}: not a PLY file: it does not begin with a line 'ply'")
    end = data.find(b"\nend_header", 0, _LONGEST_HEADER)
    size = data.find(b"\n", end + 1) + 1 if end >= 0 else 0
    if size == 0:
        raise DatasetError(f"{path}: the header of the PLY file does not end")
    order, elements, fields, comments = None, [], [], []
    for number, line in enumerate(data[:end].decode("utf-8", "replace").splitlines()[1:], 2):
        words = line.split()
        match words:
            case ["format", name, _] if name in _FORMATS:
                order = _FORMATS[name]
            case ["comment" | "obj_info", *_]:
                comments.append(line.partition(" ")[2])
            case ["element", name, count] if count.isdigit():
                elements.append((name, int(count)))
            case ["property", kind, name] if kind in _TYPES and elements:
                fields += [(name, _TYPES[kind])] if len(elements) == 1 else []
            case ["property", "list", _, _, _] if len(elements) > 1:
                pass  # of what follows the vertices
            case ["property", "list", *_]:
                raise DatasetError(f"{path}:{number}: vertices hold a list; wanted numbers only")
            case []:
                pass
            case _:
                raise DatasetError(f"{path}:{number}: {line[:60]!r} is not a line of a PLY header")
    if order is None:
        raise DatasetError(f"{path}: the header names no format; wanted {', '.join(_FORMATS)}")
    if not elements or elements[0][0] != "vertex" or not fields:
        raise DatasetError(f"{path}: the first element is {elements[0][0] if elements else 'none'!r}, wanted 'vertex' with its properties")
    if len({name for name, _ in fields}) < len(fields):
        raise DatasetError(f"{path}: a property of the vertices is there twice")
    return _Header(order, elements[0][1], tuple(fields), tuple(comments), len(elements) > 1, size)


def _of_binary(data: bytes, header: _Header, path: Path) -> dict[str, NDArray[Any]]:
    row = np.dtype([(name, header.order + kind) for name, kind in header.fields])
    got, wanted = len(data) - header.size, header.count * row.itemsize
    if got < wanted:
        raise DatasetError(f"{path}: cut off: {got} bytes of points, wanted {wanted} for {header.count}")
    if got > wanted and not header.has_more:
        raise DatasetError(f"{path}: {got} bytes of points, more than the {wanted} that its header says")
    rows = np.frombuffer(data, dtype=row, count=header.count, offset=header.size)
    native = "<" if sys.byteorder == "little" else ">"
    return {name: rows[name].astype(native + kind) for name, kind in header.fields}


def _of_text(data: bytes, header: _Header, path: Path) -> dict[str, NDArray[Any]]:
    first_line = data[: header.size].count(b"\n") + 1
    lines = [(n, line) for n, line in enumerate(data[header.size :].splitlines(), first_line) if line.strip()]
    if len(lines) < header.count:
        raise DatasetError(f"{path}: cut off: {len(lines)} lines of points, wanted {header.count}")
    if len(lines) > header.count and not header.has_more:
        raise DatasetError(f"{path}:{lines[header.count][0]}: more lines than the {header.count} points that its header says")
    columns: list[list[bytes]] = []
    for number, line in lines[: header.count]:
        columns.append(line.split())
        if len(columns[-1]) != len(header.fields):
            raise DatasetError(f"{path}:{number}: got {len(columns[-1])} numbers, wanted {len(header.fields)}")
    out: dict[str, NDArray[Any]] = {}
    for k, (name, kind) in enumerate(header.fields):
        try:
            numbers = np.array([row[k] for row in columns], dtype="S").astype(np.float64)
        except ValueError as error:
            raise DatasetError(f"{path}: property {name!r}: {error}") from None
        out[name], fits = _as_type(numbers, kind)
        if not fits.all():
            row = int(np.argmin(fits))
            wanted = f"wanted a number of type {out[name].dtype}, as the header says"
            raise DatasetError(f"{path}:{lines[row][0]}: property {name!r} is {columns[row][k].decode('ascii', 'replace'):.40}, {wanted}")
    return out


def _as_type(numbers: FloatArray, kind: str) -> tuple[NDArray[Any], BoolArray]:
    """The numbers (N,) as another type, and which of them that type can hold; fractions may be rounded, whole numbers not changed."""
    with np.errstate(invalid="ignore", over="ignore"):
        cast = numbers.astype(kind)
    fits = cast == numbers if cast.dtype.kind in "iu" else np.isfinite(cast) == np.isfinite(numbers)
    return cast, np.asarray(fits, dtype=np.bool_)
