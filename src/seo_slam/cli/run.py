"""``seo-slam run``: map a recording."""

import json
from collections.abc import Collection, Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seo_slam.cli.agents import asks_chat, with_agents
from seo_slam.cli.believed_poses import believed_poses
from seo_slam.cli.classes import asks_a_model, class_list, keep, place_question, require_kept, with_classes
from seo_slam.cli.progress import with_progress
from seo_slam.config import Component, Config, read_settings
from seo_slam.errors import ConfigError

if TYPE_CHECKING:
    from seo_slam.datasets.recording import Recording
    from seo_slam.records import StepResult
    from seo_slam.run_recording import FinishedRun

_HELP_CLASSES = "Map only these words: a FILE, 'detector' (all it says it knows), or 'place:an office' (--chat-model is asked once)."
_HELP_SET = "Change one setting, e.g. --set keyframes.period_s=0.25; may be given often. `seo-slam doctor --settings` lists them."


def run(
    dataset: Annotated[str, typer.Argument(metavar="DATASET", help="What PATH is: tum, folder, or auto.")],
    path: Annotated[Path, typer.Argument(metavar="PATH", help="Folder of the recording.")],
    out: Annotated[Path, typer.Option(help="Folder to write the result to.")],
    preset: Annotated[str, typer.Option(help="Named configuration.")] = "seo_slam",
    config: Annotated[Path | None, typer.Option(help="TOML or YAML file; its settings win over the preset's.")] = None,
    detector: Annotated[str | None, typer.Option(help="yolox, recorded, none, or module:Class.")] = None,
    weights: Annotated[Path | None, typer.Option(help="Weights of the detector.")] = None,
    score: Annotated[float | None, typer.Option(min=0, max=1, help="Least score of a detection.")] = None,
    detections: Annotated[Path | None, typer.Option(help="JSON lines for --detector recorded; default: detections.jsonl in PATH.")] = None,
    record_detections: Annotated[Path | None, typer.Option(help="Write all detections to this file.")] = None,
    classes: Annotated[str | None, typer.Option(metavar="WHICH", help=_HELP_CLASSES)] = None,
    odometry: Annotated[str | None, typer.Option(help="recorded (default where there are poses), visual, or module:Class.")] = None,
    trajectory: Annotated[Path | None, typer.Option(help="Poses for --odometry recorded (TUM text).")] = None,
    initial_pose: Annotated[
        str | None, typer.Option(help="First camera of --odometry visual: 'tx ty tz qx qy qz qw', or a file with 4x4 numbers.")
    ] = None,
    camera: Annotated[Path | None, typer.Option(help="camera.json with the intrinsics.")] = None,
    fps: Annotated[float | None, typer.Option(min=0.01, help="Frame rate of a plain folder whose images are only numbered.")] = None,
    agents: Annotated[str | None, typer.Option(help="local, chat (language models that see images; --chat-model) or none.")] = None,
    chat_model: Annotated[str | None, typer.Option(help="Model that the agents ask; --agents chat.")] = None,
    chat_url: Annotated[str | None, typer.Option(help="OpenAI-compatible server, up to /v1; default: OpenAI.")] = None,
    key_env: Annotated[str | None, typer.Option(help="Environment variable that holds the server's key.")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help=_HELP_SET)] = None,
    max_frames: Annotated[int | None, typer.Option(min=1, help="Read at most so many frames.")] = None,
    stride: Annotated[int, typer.Option(min=1, help="Read every so many-th frame.")] = 1,
    continue_map: Annotated[Path | None, typer.Option("--continue", metavar="MAP", help="Start from the map of an older run.")] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace a result that is already in --out.")] = False,
    skip_broken: Annotated[bool, typer.Option(help="Leave damaged images out instead of refusing the recording.")] = False,
    print_keyframes: Annotated[bool, typer.Option(help="Print the id of every keyframe once it is committed.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print run.json instead of a summary.")] = False,
) -> None:
    """Map the recording at PATH and write map.json, map.db, trajectory.txt, run.json and report.html to --out."""
    from seo_slam.datasets.open import open_dataset
    from seo_slam.map import Map
    from seo_slam.pipeline import Pipeline
    from seo_slam.run_files import prepare_folder, require_free
    from seo_slam.run_recording import run_recording

    chat = (chat_model, chat_url, key_env)
    chosen = _settings(preset, config, settings or [])
    only_words = asks_a_model(classes) and not asks_chat(chosen, agents)  # the model is asked for words, not by agents
    chosen = with_agents(chosen, agents, *((None, None, None) if only_words else chat))
    options: dict[str, Any] = {"camera_file": camera, "trajectory_file": trajectory, "skip_broken": skip_broken, "fps": fps}
    recording = open_dataset(dataset, path, stride=stride, max_frames=max_frames, **options)
    _warn(recording.warnings)
    chosen = _with_detector(chosen, detector, weights, score, detections, recording.path)
    chosen = _with_odometry(chosen, odometry, initial_pose, recording, replay=trajectory is not None)
    believed = believed_poses(chosen, recording, trajectory)
    _warn(believed)
    ask = place_question(classes, *chat) if classes is not None and asks_a_model(classes) else None
    words = class_list(classes, chosen) if classes is not None and ask is None else None
    chosen = chosen if words is None else with_classes(chosen, words)
    # All that can be wrong with the caller's input has to show before the first byte is written.
    parts = _rehearsed(chosen, recording, replay=trajectory is not None)
    if continue_map is not None and chosen.odometry.name == "visual" and "initial_pose" not in chosen.odometry.options:
        raise ConfigError("--continue with --odometry visual needs --initial-pose: where the first camera is in the map's frame")
    old = Map.load(continue_map) if continue_map is not None else None
    if record_detections is not None:
        _require_recordable(record_detections, _replayed(chosen), out, overwrite)
    if old is not None and old.gravity == "unknown" and chosen.odometry.name == "recorded":
        typer.echo("warning: the map to continue has a world of its own (gravity unknown); recorded poses are of another", err=True)
    require_free(out, overwrite)
    if classes is not None:
        require_kept(classes, out, overwrite)
    if ask is not None:  # and this before the question is paid for
        words = ask()
        rehearsed, chosen = chosen, with_classes(chosen, words)
        if chosen.detector != rehearsed.detector:  # one that takes the words itself
            del parts["detector"]
    folder = prepare_folder(out, overwrite)
    if classes is not None and words is not None:
        keep(words, classes, folder)
    pipeline = Pipeline(chosen, store=_store(chosen, folder), map=old, **parts)
    finished = run_recording(
        with_progress(recording, len(recording), "mapping"),
        pipeline,
        folder,
        dataset=f"{recording.kind} {recording.path.name}",
        record_detections=record_detections,
        warnings=(*recording.warnings, *believed),
        on_step=_print_keyframe if print_keyframes else None,
    )
    typer.echo(
        json.dumps(finished.run, indent=2, sort_keys=True) if as_json else _summary(finished, folder, {*recording.warnings, *believed})
    )


def _warn(warnings: Iterable[str]) -> None:
    for warning in warnings:
        typer.echo(f"warning: {warning}", err=True)


def _settings(preset: str, file: Path | None, assignments: list[str]) -> Config:
    if file is None:
        return Config.preset(preset).with_settings(assignments)
    return Config.preset(preset).updated(read_settings(file), str(file)).with_settings(assignments)


def _rehearsed(config: Config, recording: "Recording", replay: bool) -> dict[str, Any]:
    """Make a pipeline that writes nowhere of note; return the parts that are dear to make, to be used again."""
    from seo_slam.pipeline import Pipeline

    if config.detector.name == "none":
        typer.echo("warning: no detector, so the map will hold no things; give --detector", err=True)
    odometry = config.odometry
    if odometry.name == "recorded" and (replay or "trajectory" not in odometry.options):
        odometry = Component(name="recorded", options={**odometry.options, "trajectory": recording.trajectory})
    with TemporaryDirectory() as folder, Pipeline(config, odometry=odometry, store=_store(config, Path(folder))) as pipeline:
        if hasattr(pipeline.parts.detector, "check_against"):
            pipeline.parts.detector.check_against(recording.camera)
        return {name: getattr(pipeline.parts, name) for name in ("detector", "odometry", "embedder")}


def _store(config: Config, folder: Path) -> Component:
    """The result's map.db, with the options of the configuration."""
    if config.store.name not in ("memory", "sqlite") or "path" in config.store.options:
        raise ConfigError(
            f"store: got {config.store.name!r} with options {config.store.options}; seo-slam run keeps its map in map.db of --out "
            "(store.name=sqlite), Pipeline(store=…) any other way"
        )
    return Component(name="sqlite", options={**config.store.options, "path": folder / "map.db"})


def _with_detector(
    config: Config, name: str | None, weights: Path | None, score: float | None, detections: Path | None, recording: Path
) -> Config:
    chosen = Component(name=name) if name is not None and name != config.detector.name else config.detector
    extra: dict[str, Any] = {}
    if weights is not None:
        extra["weights"] = str(weights)
    if detections is not None:
        if chosen.name != "recorded":
            raise ConfigError(f"--detections goes with --detector recorded, got --detector {chosen.name}")
        extra["path"] = str(detections)
    if chosen.name == "yolox" and "weights" not in {**chosen.options, **extra}:
        raise ConfigError("--detector yolox needs --weights FILE (a YOLOX model in ONNX form)")
    if chosen.name == "recorded" and "path" not in {**chosen.options, **extra}:
        extra["path"] = str(_own_detections(recording))
    if score is not None:
        extra["score"] = score
    return config.model_copy(update={"detector": Component(name=chosen.name, options={**chosen.options, **extra})})


def _own_detections(recording: Path) -> Path:
    """Return the file of detections that came with a recording."""
    file = recording / "detections.jsonl"
    if not file.is_file():
        raise ConfigError(
            f"--detector recorded: {recording} has no {file.name}; give --detections FILE (JSON lines, as --record-detections writes them)"
        )
    return file


def _replayed(config: Config) -> Path | None:
    """The file that the recorded detector reads, if that is the detector."""
    path = config.detector.options.get("path")
    return Path(path) if config.detector.name == "recorded" and path is not None else None


def _with_odometry(config: Config, name: str | None, initial_pose: str | None, recording: "Recording", replay: bool) -> Config:
    from seo_slam.datasets.initial_pose import read_initial_pose

    if name is None:
        name = config.odometry.name
        if name == "recorded" and not config.odometry.options and recording.trajectory is None:
            name = "visual"
    if replay and name != "recorded":
        raise ConfigError(f"--trajectory goes with --odometry recorded, got --odometry {name}")
    options = dict(config.odometry.options) if name == config.odometry.name else {}
    if name == "recorded" and "trajectory" not in options and recording.trajectory is None:
        raise ConfigError(f"--odometry recorded: {recording.path} has no odometry.txt or groundtruth.txt; give --trajectory FILE")
    if initial_pose is not None:
        if name == "recorded":
            raise ConfigError("--initial-pose goes with --odometry visual: recorded poses already say where the first camera is")
        options["initial_pose"] = read_initial_pose(initial_pose).tolist()
    return config.model_copy(update={"odometry": Component(name=name, options=options)})


def _require_recordable(file: Path, replayed: Path | None, out: Path, overwrite: bool) -> None:
    """Raise ``ConfigError`` unless detections can be written there, and nothing is lost by it."""
    if replayed is not None and file.resolve() == replayed.resolve():
        raise ConfigError(f"--record-detections {file}: is the file that --detector recorded reads; give another")
    if file.is_file() and file.stat().st_size and not overwrite:
        raise ConfigError(f"--record-detections {file}: already holds something; give --overwrite to replace it, or another file")
    _require_writable(file, out)


def _require_writable(file: Path, out: Path) -> None:
    """Raise ``ConfigError`` unless the file can be made; one that goes into the result's folder waits for that to be made."""
    if file.resolve().parent == out.resolve() and not file.is_dir():
        return
    try:
        present = file.exists()
        with file.open("ab"):
            pass
        if not present:
            file.unlink()
    except OSError as error:
        raise ConfigError(f"--record-detections {file}: cannot be written: {error.strerror or error}") from error


def _print_keyframe(step: "StepResult") -> None:
    if step.keyframe_id is not None:
        typer.echo(f"keyframe {step.keyframe_id}")


def _summary(finished: "FinishedRun", folder: Path, told: Collection[str]) -> str:
    counts = finished.run["counts"]
    lines = [
        f"{counts['frames']} frames, {counts['keyframes']} keyframes, {counts['lost_frames']} lost; "
        f"{counts['landmarks_stable']} landmarks ({counts['landmarks_tentative']} more seen too seldom to be trusted)"
    ]
    if not finished.complete:
        lines.insert(0, "interrupted: the result holds what was seen until then")
    width = max((len(landmark.label or "?") for landmark in finished.result.map.landmarks), default=1)  # agents give long names
    for landmark in finished.result.map.landmarks:
        x, y, z = landmark.position_m
        lines.append(f"  {landmark.id:4d}  {landmark.label or '?':<{width}} {x:7.2f} {y:7.2f} {z:7.2f} m   seen {landmark.observations} x")
    lines += [
        f"warning: {warning['message']} ({warning['count']} x)" for warning in finished.run["warnings"] if warning["message"] not in told
    ]
    lines.append(f"report: {folder / 'report.html'}")
    return "\n".join(lines)
