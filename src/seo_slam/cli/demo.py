"""``seo-slam demo``: map a simulated desk; needs no data, no network and no extras."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seo_slam.cli.progress import with_progress
from seo_slam.config import Component, Config

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from seo_slam.evaluation.scores import LandmarksResult
    from seo_slam.run_result import RunResult


def demo(
    out: Annotated[Path, typer.Option(help="Folder to write the result to.")] = Path("seo_slam_demo"),
    seed: Annotated[int, typer.Option(min=0, help="Another desk, another walk, other mistakes.")] = 0,
    frames: Annotated[int, typer.Option(min=2, help="How many frames, at 15 a second.")] = 90,
    level: Annotated[float, typer.Option(min=0, help="How imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.")] = 0.5,
    overwrite: Annotated[bool, typer.Option(help="Replace a result that is already in --out.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the score as JSON instead of a table.")] = False,
) -> None:
    """Map a simulated desk, compare the map with what is really there, and write a report. Takes well under a minute."""
    from seo_slam.backends.recorded_odometry import RecordedOdometry
    from seo_slam.datasets.trajectory_files import write_trajectory
    from seo_slam.evaluation.landmarks import evaluate_landmarks
    from seo_slam.evaluation.truth import read_truth
    from seo_slam.pipeline import Pipeline
    from seo_slam.report.evaluation_page import write_evaluation
    from seo_slam.run_files import prepare_folder
    from seo_slam.run_recording import run_recording
    from seo_slam.simulation.recording import SimulatedDesk

    desk = SimulatedDesk(seed=seed, frames=frames, level=level)
    folder = prepare_folder(out, overwrite)
    (folder / "truth.json").write_text(json.dumps(desk.truth, indent=1) + "\n", encoding="utf-8")
    write_trajectory(folder / "groundtruth.txt", desk.trajectory)
    pipeline = Pipeline(
        Config(seed=seed),
        detector=desk.detector,
        odometry=RecordedOdometry(desk.odometry),
        store=Component(name="sqlite", options={"path": folder / "map.db"}),
    )
    name = f"simulated desk, seed {seed}, level {level:g}"
    finished = run_recording(with_progress(desk, len(desk), "mapping"), pipeline, folder, dataset=name)
    found = finished.result.map
    landmarks, truth = (*found.landmarks, *found.tentative), read_truth(folder / "truth.json")
    score = evaluate_landmarks(landmarks, truth)
    page = folder / "evaluation.html"
    write_evaluation(page, landmarks=landmarks, truth=truth, result=score, trajectory=finished.result.trajectory, title=name)
    typer.echo(json.dumps(score.as_dict(), indent=1) if as_json else _summary(finished.result, score, desk.truth, folder))


def _summary(result: "RunResult", score: "LandmarksResult", truth: dict[str, Any], folder: Path) -> str:
    landmarks = {landmark.id: landmark for landmark in result.map.landmarks}
    found = {match.object_id: match for match in score.matched}
    rows = [("on the desk", "found as", "at x, y, z (m)", "error")]
    for item in truth["objects"]:
        match = found.get(str(item["id"]))
        if match is None:
            rows.append((item["label"], "not found", "", ""))
            continue
        place = _place(landmarks[match.landmark_id].position_m)
        rows.append((item["label"], match.label, place, f"{100 * match.distance_m:.1f} cm"))
    rows += [("(nothing)", extra.label, _place(extra.position_m), extra.kind) for extra in score.extra]
    s = score.score
    lines = [
        f"{result.frames} frames, {result.keyframes} keyframes, {result.detections} detections, {len(landmarks)} landmarks",
        "",
        *_aligned(rows),
        "",
        f"precision {s.precision:.2f}, recall {s.recall:.2f}, F1 {s.f1:.2f} ({score.protocol}, within {100 * score.radius_m:.0f} cm)",
        "The detector is simulated and makes mistakes on purpose: it misses things, mistakes them, and sees things that are not there.",
        "",
        f"look at     {folder / 'report.html'}, and truth and map side by side: {folder / 'evaluation.html'}",
        f'find        seo-slam query {folder} "something to drink from"',
        f'ask         seo-slam ask {folder} "I am thirsty, where is a cup?"',
        f"score       seo-slam eval landmarks {folder} {folder / 'truth.json'}",
        f"            seo-slam eval trajectory {folder / 'trajectory.txt'} {folder / 'groundtruth.txt'}",
        "your data   seo-slam check PATH, then seo-slam run auto PATH --out DIR",
    ]
    return "\n".join(lines)


def _place(position_m: "Iterable[float]") -> str:
    return ", ".join(f"{value:.2f}" for value in position_m)


def _aligned(rows: "Sequence[tuple[str, ...]]") -> list[str]:
    """Each column as wide as its longest cell, two blanks between them: agents give long names."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
