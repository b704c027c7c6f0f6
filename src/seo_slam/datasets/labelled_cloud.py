"""Labelled point clouds of users: the truth that a segmentation is scored against."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seo_slam.datasets.ply import Ply, read_ply
from seo_slam.errors import DatasetError
from seo_slam.evaluation.labelled_points import UNLABELLED, LabelledCloud
from seo_slam.types import IntArray

INSTANCE_PROPERTIES = ("instance", "object_id", "instance_id", "objectId")
"""Names that a vertex property may have which says the thing a point belongs to; the first that is there is taken."""

LABEL_PROPERTIES = ("label", "class", "class_id", "semantic")
"""The same of the class."""


def read_labelled_cloud(path: Path) -> LabelledCloud:
    """Read a PLY file, text or binary, whose vertices have x, y, z in metres and an instance and a label, both whole numbers.

    Negative numbers mean that nobody said. Words for the labels are in a JSON file of the same name beside it (``room.json`` beside
    ``room.ply``): ``{"7": "chair", …}``, or a list of words whose places are the numbers; several numbers may have one word. Without such
    a file the class of number 7 is called "class 7".

    Raises:
        DatasetError: a file cannot be read or is damaged, a property is missing or no whole number, or a label has no word.
        EvaluationError: there are no points, or one that is not finite.
    """
    ply = read_ply(path)
    missing = [axis for axis in "xyz" if axis not in ply.vertices]
    if missing:
        raise DatasetError(f"{path}: vertices have no {', '.join(missing)}; they have {', '.join(ply.vertices)}")
    numbers = _whole_numbers(ply, LABEL_PROPERTIES, path)
    used = np.unique(numbers[numbers >= 0])
    words = _words_for(used, path.with_suffix(".json"))
    names = tuple(dict.fromkeys(words))
    class_of = np.array([names.index(word) for word in words], dtype=np.int64)
    class_ids = np.full(len(numbers), UNLABELLED, dtype=np.int64)
    class_ids[numbers >= 0] = class_of[np.searchsorted(used, numbers[numbers >= 0])]
    instances = _whole_numbers(ply, INSTANCE_PROPERTIES, path)
    p_world = np.column_stack([ply.vertices[axis].astype(np.float64) for axis in "xyz"])
    return LabelledCloud(p_world, np.where(instances < 0, UNLABELLED, instances), class_ids, names)


def _whole_numbers(ply: Ply, names: tuple[str, ...], path: Path) -> IntArray:
    name = next((name for name in names if name in ply.vertices), None)
    if name is None:
        raise DatasetError(f"{path}: vertices have no {names[0]!r} (nor {', '.join(names[1:])}); they have {', '.join(ply.vertices)}")
    values: NDArray[np.generic] = ply.vertices[name]
    return values.astype(np.int64) if values.dtype.kind in "iu" else _rounded(values.astype(np.float64), name, path)


def _rounded(values: NDArray[np.float64], name: str, path: Path) -> IntArray:
    # programs that know only floating-point scalars write whole numbers as 7.0
    odd = ~(np.abs(values) < 2**53) | (values != np.round(values))
    if odd.any():
        raise DatasetError(f"{path}: {name!r} of point {int(np.argmax(odd))} is {values[np.argmax(odd)]}, wanted a whole number")
    return values.astype(np.int64)


def _words_for(numbers: IntArray, path: Path) -> list[str]:
    """The word of each number (N,)."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        return [f"class {number}" for number in numbers]
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path}: cannot be read: {error}") from None
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise DatasetError(f"{path}:{error.lineno}: not JSON: {error.msg}") from None
    if isinstance(content, list):
        content = {str(number): word for number, word in enumerate(content)}
    if not isinstance(content, dict):
        raise DatasetError(f"{path}: got {type(content).__name__}, wanted an object of number: word, or a list of words")
    out = []
    for number in numbers.tolist():
        word = content.get(str(number))
        if not isinstance(word, str) or not word.strip():
            raise DatasetError(
                f"{path}: label {number} has {'no word' if word is None else repr(word)[:40]}, wanted a word for every label"
            )
        out.append(word.strip())
    return out
