"""Lines of the small text files of a recording, with their numbers, so that every complaint can name file and line."""

from pathlib import Path

import numpy as np

from seo_slam.errors import DatasetError
from seo_slam.geometry import FloatArray


def read_fields(path: Path) -> list[tuple[int, list[str]]]:
    """Return ``(line number, fields)`` of every line that is neither blank nor a comment (``#``); commas count as spaces.

    Raises:
        DatasetError: the file is missing or is not text.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DatasetError(f"{path}: not a text file ({error.reason} at byte {error.start})") from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None
    numbered = ((i, line.replace(",", " ").split()) for i, line in enumerate(text.splitlines(), 1))
    return [(i, fields) for i, fields in numbered if fields and not fields[0].startswith("#")]


def to_number(field: str, where: str) -> float:
    """Return a finite number.

    Raises:
        DatasetError: it is none; ``where`` is "file:line".
    """
    try:
        value = float(field)
    except ValueError:
        raise DatasetError(f"{where}: {field!r} is not a number") from None
    if not np.isfinite(value):
        raise DatasetError(f"{where}: got {field}, wanted finite numbers")
    return value


def read_numbers(path: Path, columns: tuple[int, ...], wanted: str) -> tuple[FloatArray, list[int]]:
    """Return the rows (N, C) of a file of numbers and the line number of each.

    Args:
        path: the file.
        columns: how many numbers a row may have; all rows have as many as the first.
        wanted: what a row means, for the message.

    Raises:
        DatasetError: missing file, another number of columns, not a finite number.
    """
    lines = read_fields(path)
    rows: list[list[float]] = []
    for number, fields in lines:
        allowed = (len(rows[0]),) if rows else columns
        if len(fields) not in allowed:
            raise DatasetError(f"{path}:{number}: got {len(fields)} columns, wanted {' or '.join(map(str, allowed))} ({wanted})")
        rows.append([to_number(field, f"{path}:{number}") for field in fields])
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(rows[0]) if rows else columns[0]), [number for number, _ in lines]
