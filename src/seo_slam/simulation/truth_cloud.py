"""Writes labelled points as a PLY file with the words of its labels beside it."""

import json
from pathlib import Path

import numpy as np

from seo_slam.errors import DatasetError
from seo_slam.evaluation.labelled_points import LabelledCloud

TRUTH_CLOUD_FILE = "truth_cloud.ply"
"""Its name in the folder of a recording."""

_ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("instance", "<i4"), ("label", "<i4")])


def write_labelled_cloud(path: Path, cloud: LabelledCloud) -> Path:
    """Write what ``datasets.labelled_cloud.read_labelled_cloud`` reads: binary PLY, and the words in a JSON file of the same name.

    Returns:
        ``path``.

    Raises:
        DatasetError: it cannot be written.
    """
    rows = np.zeros(len(cloud), dtype=_ROW)
    for axis, name in enumerate("xyz"):
        rows[name] = cloud.p_world[:, axis]
    rows["instance"], rows["label"] = cloud.instance_ids, cloud.class_ids
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment labelled points, frame world, metres; words of the labels in {path.with_suffix('.json').name}",
        f"element vertex {len(rows)}",
        *(f"property float {axis}" for axis in "xyz"),
        "property int instance",
        "property int label",
        "end_header",
    ]
    words = {str(number): word for number, word in enumerate(cloud.class_names)}
    try:
        path.write_bytes("\n".join(header).encode() + b"\n" + rows.tobytes())
        path.with_suffix(".json").write_text(json.dumps(words, indent=1) + "\n", encoding="utf-8", newline="\n")
    except OSError as error:
        raise DatasetError(f"{path}: cannot be written: {error.strerror or error}") from error
    return path
