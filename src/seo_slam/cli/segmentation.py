"""``seo-slam eval segmentation``: score the clouds of a map against labelled points."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seo_slam.errors import DatasetError, EvaluationError

if TYPE_CHECKING:
    from seo_slam.evaluation.labelled_points import LabelledCloud
    from seo_slam.evaluation.segmentation_scores import SegmentationResult
    from seo_slam.map import Map
    from seo_slam.types import Landmark


def segmentation(
    map_folder: Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a result, with clouds.ply.")],
    truth_path: Annotated[
        Path, typer.Option("--truth", metavar="FILE.ply|FOLDER", help="Labelled points, or a recording's folder with truth_cloud.ply.")
    ],
    protocol: Annotated[str, typer.Option(help="dualmap, hovsg, conceptgraphs, several with commas, or all.")] = "dualmap",
    embedder: Annotated[str, typer.Option(metavar="NAME", help="Embeds class names; default: the map's own.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """MIoU, FmIoU, mAcc and ODR of a map's stable landmarks (protocols segmentation/dualmap, /hovsg, /conceptgraphs)."""
    from seo_slam.evaluation.class_words import ClassWords
    from seo_slam.evaluation.segmentation import evaluate_segmentation, objects_of
    from seo_slam.evaluation.segmentation_protocols import protocols_named
    from seo_slam.map import Map, embedder_of
    from seo_slam.run_files import versions

    protocols = protocols_named(protocol)
    loaded = Map.load(map_folder)
    landmarks = _with_clouds(loaded, map_folder)
    truth = _truth(truth_path)
    model = embedder or loaded.embedder
    if not model:
        raise EvaluationError(f"{map_folder}: the map does not say which embedder made it; give --embedder NAME")
    results = evaluate_segmentation(objects_of(landmarks), truth, ClassWords.of(truth.class_names, embedder_of(model)), protocols)
    if as_json:
        content = {
            "results": {result.protocol.name: result.as_dict() for result in results},
            "objects": [_object_row(row, [result.called_by_name[n] for result in results]) for n, row in enumerate(landmarks)],
            "map": str(map_folder),
            "truth": str(truth_path),
            "truth_points": len(truth),
            "landmarks": "stable ones",
            "features": "of the map" if any(row.embedding.any() for row in landmarks) else "of the labels: the map holds none",
            "scenes": 1,
            "versions": versions(),
        }
        typer.echo(json.dumps(content, indent=1))
    else:
        typer.echo("\n\n".join("\n".join(_lines(result)) for result in results))


def _with_clouds(loaded: "Map", map_folder: Path) -> tuple["Landmark", ...]:
    """The stable landmarks; each must have its points."""
    without = [row.id for row in loaded.landmarks if not len(row.cloud_world)]
    if without:
        count = len(loaded.landmarks)
        what = "no landmark" if len(without) == count else f"{count - len(without)} of {count} landmarks, not {without[0]},"
        raise EvaluationError(f"{map_folder}: {what} has a cloud; wanted a map made with clouds (--preset dualmap) and its clouds.ply")
    return loaded.landmarks


def _truth(path: Path) -> "LabelledCloud":
    from seo_slam.datasets.labelled_cloud import read_labelled_cloud
    from seo_slam.simulation.truth_cloud import TRUTH_CLOUD_FILE

    if not path.is_dir():
        return read_labelled_cloud(path)
    file = path / TRUTH_CLOUD_FILE
    if not file.is_file():
        raise DatasetError(
            f"{path}: holds no {TRUTH_CLOUD_FILE}; `seo-slam simulate NAME --truth-cloud` writes one, or give a labelled PLY file"
        )
    cloud = read_labelled_cloud(file)
    return replace(cloud, visible_keyframes=_visible(path / "truth.json", cloud))


def _visible(file: Path, cloud: "LabelledCloud") -> dict[int, int] | None:
    """Thing -> keyframes that saw it, from a recording's true objects; what is not among them is structure, and always in view."""
    from seo_slam.evaluation.scores import ENOUGH_KEYFRAMES
    from seo_slam.evaluation.truth import read_truth

    if not file.is_file():
        return None
    counted = {item.id: item.visible_keyframes for item in read_truth(file).objects if item.visible_keyframes is not None}
    return {number: counted.get(str(number), ENOUGH_KEYFRAMES) for number in cloud.instances} if counted else None


def _object_row(landmark: "Landmark", called: Sequence[str]) -> dict[str, Any]:
    return {"landmark": landmark.id, "label": landmark.label, "points": len(landmark.cloud_world), "called": list(called)}


def _lines(result: "SegmentationResult") -> list[str]:
    counts, protocol = result.counts, result.protocol
    dropped = [name for name, gone in zip(result.class_names, result.dropped, strict=True) if gone]
    of = "visible" if counts.visible is not None else "true"
    lines = [
        f"protocol {protocol.name}: {protocol.neighbours} nearest, mean over {protocol.mean_over} classes, "
        f"dropped {', '.join(map(_printable, dropped)) or 'none'}; embedder {result.embedder}",
        f"mIoU {result.miou:.4f}  FmIoU {result.fmiou:.4f}  mAcc {result.macc:.4f}  ODR {_ratio(counts.odr)}  covered {result.covered:.3f}",
        f"{counts.predicted} objects ({counts.predicted_dropped} of dropped classes left out) for "
        f"{counts.visible if counts.visible is not None else counts.objects} {of} things ({counts.objects} in all): "
        f"{counts.matched} things found, {counts.duplicates} duplicates, {counts.of_dropped} on dropped classes, "
        f"{counts.of_nothing} on no one thing; {counts.missed} missed, {counts.swallowed} of them within another object",
    ]
    names = [_printable(row.name) for row in result.per_class]
    wide = max(len(name) for name in ("class", *names))
    lines.append(f"{'class':<{wide}}  IoU    recall  true     predicted")
    for name, row in zip(names, result.per_class, strict=True):
        recall = "-" if row.recall is None else f"{row.recall:.3f}"
        lines.append(f"{name:<{wide}}  {row.iou:.3f}  {recall:<6}  {row.true_points:<7}  {row.predicted_points}")
    return lines


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _printable(name: str) -> str:
    """A name comes from a file: it must not steer the terminal."""
    return "".join(c if c.isprintable() else "?" for c in name)
