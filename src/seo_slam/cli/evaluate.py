"""``seo-slam eval``: score a trajectory or a map against what is true."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import seo_slam
from seo_slam.cli.segmentation import segmentation
from seo_slam.errors import ConfigError

if TYPE_CHECKING:
    from seo_slam.evaluation.labels import LabelRule
    from seo_slam.evaluation.scores import LandmarksResult, RadiusScore
    from seo_slam.evaluation.trajectory import ApeResult, RpeResult
    from seo_slam.records import Trajectory

app = typer.Typer(no_args_is_help=True, help="Score a trajectory or a map against what is true.")

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
_NARROW_M = 0.05


@app.command("trajectory")
def trajectory(
    estimate: Annotated[Path, typer.Argument(metavar="EST", help="Estimated trajectory, TUM format.")],
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="True trajectory, TUM format.")],
    rpe_step_s: Annotated[float | None, typer.Option("--rpe-step", help="Also give the relative error over this many seconds.")] = None,
    as_json: AsJson = False,
) -> None:
    """Absolute pose error after SE(3) alignment (protocol ape/1)."""
    from seo_slam.datasets.trajectory_files import read_trajectory
    from seo_slam.evaluation.trajectory import ape, rpe

    estimated, true = read_trajectory(estimate), read_trajectory(truth)
    result = ape(estimated, true)
    relative = rpe(estimated, true, step_s=rpe_step_s) if rpe_step_s is not None else None
    if as_json:
        content = {**result.as_dict(), "estimate": str(estimate), "truth": str(truth)}
        if relative:
            content["rpe"] = relative.as_dict()
        _print_json(content)
    else:
        typer.echo("\n".join(_trajectory_lines(result, relative)))


@app.command("landmarks")
def landmarks(
    map_folder: Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a result, or its map.json or map.db.")],
    truth_file: Annotated[Path, typer.Argument(metavar="TRUTH", help="True objects, JSON.")],
    radius_m: Annotated[float, typer.Option("--radius", help="Matching radius, metres.")] = 0.2,
    labels: Annotated[
        str, typer.Option("--labels", help="When labels agree: exact, synonyms:FILE or geometry (labels ignored).")
    ] = "exact",
    align_files: Annotated[
        tuple[Path, Path] | None,
        typer.Option("--align", metavar="EST TRUTH", help="Move the map by the SE(3) that aligns these two trajectories."),
    ] = None,
    truth_count: Annotated[
        int | None, typer.Option("--truth-count", metavar="G", min=1, help="A count of true objects of your own, scored beside the others.")
    ] = None,
    report: Annotated[Path | None, typer.Option(metavar="FILE.html", help="Write a page with truth and map side by side.")] = None,
    svg: Annotated[Path | None, typer.Option(metavar="FILE.svg", help="Write the picture of truth and map alone.")] = None,
    as_json: AsJson = False,
) -> None:
    """Precision, recall and F1 of a map's stable landmarks (protocol landmarks/1)."""
    from seo_slam.evaluation.landmarks import evaluate_landmarks, moved
    from seo_slam.evaluation.truth import read_truth
    from seo_slam.map import Map

    rule = _label_rule(labels)
    truth = read_truth(truth_file)
    loaded = Map.load(map_folder)
    found = (*loaded.landmarks, *loaded.tentative)
    aligned: ApeResult | None = None
    if align_files:
        from seo_slam.datasets.trajectory_files import read_trajectory
        from seo_slam.evaluation.trajectory import ape

        aligned = ape(read_trajectory(align_files[0]), read_trajectory(align_files[1]))
        found = moved(found, aligned.T_truth_estimate)
    result = evaluate_landmarks(found, truth, rule, radius_m, truth_count)
    if report or svg:
        path = _path_of(map_folder, aligned)
        title = f"{map_folder.resolve().name} against {truth_file.name}"
        _draw(report, svg, landmarks=found, truth=truth, result=result, trajectory=path, title=title)
    if as_json:
        content = {**result.as_dict(), "map": str(map_folder), "truth": str(truth_file)}
        content["alignment"] = aligned.as_dict() if aligned else None
        _print_json(content)
    else:
        written = [f"written: {file}" for file in (report, svg) if file is not None]
        typer.echo("\n".join([*_landmark_lines(result, aligned), *written]))


app.command("segmentation")(segmentation)


def _path_of(map_folder: Path, aligned: "ApeResult | None") -> "Trajectory | None":
    """The way of the camera that lies beside the map, in the true world; None where there is none."""
    from seo_slam.datasets.trajectory_files import read_trajectory
    from seo_slam.records import Trajectory

    file = (map_folder if map_folder.is_dir() else map_folder.parent) / "trajectory.txt"
    if not file.is_file():
        return None
    path = read_trajectory(file)
    return Trajectory(path.timestamps_s, aligned.T_truth_estimate @ path.T_world_camera) if aligned else path


def _draw(report: Path | None, svg: Path | None, **scored: Any) -> None:
    from seo_slam.report.evaluation_page import write_evaluation
    from seo_slam.report.page import write_whole
    from seo_slam.report.truth_svg import truth_svg

    for option, file in (("--report", report), ("--svg", svg)):
        try:
            if file is None:
                continue
            if file is report:
                write_evaluation(file, **scored)
            else:
                write_whole(file, truth_svg(**scored))
        except OSError as error:
            raise ConfigError(f"{option} {file}: cannot be written: {error.strerror or error}") from error


def _label_rule(text: str) -> "LabelRule":
    from seo_slam.evaluation.labels import LabelRule
    from seo_slam.evaluation.truth import read_synonyms

    kind, _, file = text.partition(":")
    if kind == "synonyms" and file:
        return LabelRule.synonyms(read_synonyms(file), file)
    if text == "exact":
        return LabelRule.exact()
    if text == "geometry":
        return LabelRule.geometry()
    raise ConfigError(f"--labels: got {text!r}, wanted exact, synonyms:FILE or geometry")


def _print_json(content: dict[str, Any]) -> None:
    typer.echo(json.dumps({**content, "seo_slam_version": seo_slam.__version__}, indent=1))


def _trajectory_lines(result: "ApeResult", relative: "RpeResult | None") -> list[str]:
    lines = [
        f"protocol {result.protocol}: translation part after SE(3) alignment, no scale; truth interpolated, "
        f"nearest true stamp within {result.association_s * 1e3:g} ms",
        f"compared {result.compared} of {result.estimates} estimated poses",
    ]
    for name, value in (("rmse", result.rmse_m), ("mean", result.mean_m), ("median", result.median_m), ("max", result.max_m)):
        lines.append(f"  {name:<8}{value:.6f} m")
    if relative:
        lines.append(
            f"protocol {relative.protocol}: over {relative.step}, {relative.compared} steps: "
            f"rmse {relative.rmse_m:.6f} m, {relative.rmse_deg:.4f} degrees; max {relative.max_m:.6f} m, {relative.max_deg:.4f} degrees"
        )
    return lines + _narrow_path(result)


def _landmark_lines(result: "LandmarksResult", aligned: "ApeResult | None") -> list[str]:
    score = result.score
    lines = [
        f"protocol {result.protocol}, radius {result.radius_m:g} m (or half the smaller horizontal extent), labels {result.label_rule}",
        f"G = {score.objects} objects present when the recording ends; {score.landmarks} stable landmarks "
        f"({result.tentative} tentative or lost left out)",
    ]
    if aligned:
        lines.append(f"map moved by the SE(3) of two trajectories ({aligned.compared} poses compared, rmse {aligned.rmse_m:.4f} m)")
        lines += _narrow_path(aligned)
    lines.append(
        f"precision {score.precision:.3f}  recall {score.recall:.3f}  F1 {score.f1:.3f}  false positives {score.false_positives}: "
        f"duplicates {result.duplicates}, ghosts {result.ghosts}, false {result.false}"
    )
    lines += ["", *_count_lines(score), "", *_sweep_lines(result.sweep), "", *_class_lines(result)]
    lines += ["", f"matched ({len(result.matched)})"]
    lines += [
        f"  {pair.object_id} ({pair.object_label}) = landmark {pair.landmark_id} ({_printable(pair.label)}), {pair.distance_m:.3f} m"
        for pair in result.matched
    ]
    lines.append(f"missing ({len(result.missing)})")
    for gone in result.missing:
        near = (
            f"; nearest is landmark {gone.nearest_landmark_id} ({_printable(gone.nearest_label)}), {gone.nearest_m:.3f} m"
            if gone.nearest_label is not None
            else ""
        )
        lines.append(f"  {gone.object_id} ({gone.object_label}){near}")
    lines.append(f"extra ({len(result.extra)})")
    for item in result.extra:
        what = f"{item.kind} of {item.of}" if item.of else f"nearest is {item.nearest_object_id}, {item.nearest_m:.3f} m"
        x, y, z = item.position_m
        lines.append(f"  landmark {item.landmark_id} ({_printable(item.label)}) at {x:.2f} {y:.2f} {z:.2f}: {what}")
    return lines


def _count_lines(score: "RadiusScore") -> list[str]:
    counts = [("all objects", score), ("in view for 5 keyframes", score.visible), ("as given", score.given)]
    lines = ["G                        objects  landmarks  matched  precision  recall  F1"]
    for name, row in counts:
        if row is not None:
            numbers = f"{row.objects:<8} {row.landmarks:<10} {row.matched:<8} {row.precision:<10.3f} {row.recall:<7.3f} {row.f1:.3f}"
            lines.append(f"{name:<24} {numbers}")
    return lines


def _sweep_lines(sweep: Sequence["RadiusScore"]) -> list[str]:
    in_view = sweep[0].visible is not None
    lines = ["radius  matched  precision  recall  F1" + ("     F1, in view" if in_view else "")]
    for row in sweep:
        text = f"{row.radius_m:<7g} {row.matched:<8} {row.precision:<10.3f} {row.recall:<7.3f} {row.f1:.3f}"
        lines.append(text + (f"  {row.visible.f1:.3f}" if row.visible else ""))
    return lines


def _class_lines(result: "LandmarksResult") -> list[str]:
    names = ["(no class of the truth)" if row.label is None else _printable(row.label) for row in result.per_class]
    wide = max(len(name) for name in ["class", *names])
    lines = [f"{'class':<{wide}}  objects  matched  missing  duplicates  ghosts  false"]
    for name, row in zip(names, result.per_class, strict=True):
        lines.append(f"{name:<{wide}}  {row.objects:<8} {row.matched:<8} {row.missing:<8} {row.duplicates:<11} {row.ghosts:<7} {row.false}")
    return lines


def _printable(label: str) -> str:
    """A label comes from a detector or a language model: it must not steer the terminal."""
    return "".join(c if c.isprintable() else "?" for c in label)


def _narrow_path(result: "ApeResult") -> list[str]:
    if result.spread_m[1] >= _NARROW_M:
        return []
    return [
        f"note: the path is nearly a line (spread {result.spread_m[0]:.3f} and {result.spread_m[1]:.3f} m), "
        "so the rotation about it is poorly known"
    ]
