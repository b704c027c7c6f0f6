"""The folder that a run leaves: map.json, map.db, trajectory.txt, run.json, report.html."""

import json
import os
import platform
import resource
import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from seo_slam.datasets.trajectory_files import write_trajectory
from seo_slam.errors import ConfigError
from seo_slam.run_result import RunResult

RUN_SCHEMA = "seo_slam.run/1"
# classes.txt is none of them: it is the user's to edit and to give to the next run.
RESULT_FILES = (
    "map.json",
    "clouds.ply",
    "features.npz",
    "map.db",
    "map.db-wal",
    "map.db-shm",
    "trajectory.txt",
    "run.json",
    "report.html",
    "evaluation.html",
)
_PACKAGES = (
    "seo-slam",
    "numpy",
    "scipy",
    "gtsam",
    "lap",
    "opencv-contrib-python-headless",
    "onnxruntime",
    "sentence-transformers",
    "torch",
)


def require_free(folder: str | Path, overwrite: bool) -> None:
    """Check that a folder can take a result, as far as that shows without writing anything.

    Raises:
        ConfigError: it holds a result and ``overwrite`` is not set, it is a file, or it is in no folder that may be written to.
    """
    out = Path(folder)
    try:
        if out.exists() and not out.is_dir():
            raise ConfigError(f"{out}: is a file, wanted a folder for the result")
        present = _present(out)
        if present and not overwrite:
            raise ConfigError(f"{out}: already holds a result ({', '.join(present)}); give --overwrite to replace it, or another --out")
        there = next(one for one in (out.absolute(), *out.absolute().parents) if one.exists())
        if not there.is_dir():
            raise ConfigError(f"{out}: cannot be written: {there} is a file")
        if not os.access(there, os.W_OK | os.X_OK):
            raise ConfigError(f"{out}: cannot be written: {there} may not be written to")
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written: {error.strerror or error}") from error


def prepare_folder(folder: str | Path, overwrite: bool) -> Path:
    """Make the folder of a result, before anything is computed.

    Raises:
        ConfigError: it holds a result and ``overwrite`` is not set, it is a file, or it cannot be written.
    """
    require_free(folder, overwrite)
    out = Path(folder)
    try:
        out.mkdir(parents=True, exist_ok=True)
        probe = out / ".write_test"
        probe.write_bytes(b"")
        probe.unlink()
        for name in _present(out):
            (out / name).unlink()
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written: {error.strerror or error}") from error
    return out


def _present(folder: Path) -> list[str]:
    return [name for name in RESULT_FILES if (folder / name).exists()]


def write_result(folder: Path, result: RunResult, run: Mapping[str, Any]) -> None:
    """Write map.json, trajectory.txt and run.json; map.db is written by the store while the run goes on."""
    result.map.save(folder)
    write_trajectory(folder / "trajectory.txt", result.trajectory)
    temporary = folder / "run.json.part"
    temporary.write_text(json.dumps(run, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    os.replace(temporary, folder / "run.json")


def describe_run(result: RunResult, *, dataset: str, config: Mapping[str, Any], complete: bool) -> dict[str, Any]:
    """Return the content of run.json: counts, seconds a stage, what agents did, peak memory, versions, configuration, seeds.

    Args:
        result: of the run.
        dataset: what was read, for people.
        config: the settings in force.
        complete: False when the run was interrupted; the result is then valid for what was seen.
    """
    return {
        "schema": RUN_SCHEMA,
        "dataset": dataset,
        "complete": complete,
        "counts": {
            "frames": result.frames,
            "keyframes": result.keyframes,
            "lost_frames": result.lost_frames,
            "detections": result.detections,
            "observations": result.observations,
            "landmarks_stable": len(result.map.landmarks),
            "landmarks_tentative": len(result.map.tentative),
        },
        "seconds_per_stage": {stage: dict(values) for stage, values in result.seconds.items()},
        "warnings": [{"message": text, "count": n} for text, n in sorted(result.warnings.items(), key=lambda w: (-w[1], w[0]))],
        "events": [
            {"keyframe": k, "kind": e.kind, "landmark": e.landmark_id, "detail": e.detail, "source": e.source, "other": e.other_id}
            for k, e in result.events
        ],
        **({"agents": dict(result.agents)} if result.agents else {}),
        "peak_memory_mb": peak_memory_mb(),
        "embedder": result.map.embedder,
        "versions": versions(),
        "config": dict(config),
    }


def peak_memory_mb() -> float:
    """Peak resident memory of this process so far, in MiB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 2**10


def versions() -> dict[str, str]:
    """Versions of Python, the platform and the packages that shape a result; those not installed are left out."""
    found = {"python": platform.python_version(), "platform": f"{platform.system()} {platform.machine()}"}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
