"""What to say where poses that drift are taken as true."""

from pathlib import Path
from typing import TYPE_CHECKING

from seo_slam.config import Config
from seo_slam.datasets.trajectory_files import ODOMETRY_FILE

if TYPE_CHECKING:
    from seo_slam.datasets.recording import Recording


def believed_poses(config: Config, recording: "Recording", trajectory: Path | None = None) -> tuple[str, ...]:
    """Return a warning if the smoother believes its poses and they are estimates: of a robot's odometry.txt, or of visual odometry.

    Which poses are a robot's odometry is told by the name of their file alone: poses that drift in a file of another name are not warned
    of, and true ones in an ``odometry.txt`` are.

    Args:
        config: the settings in force, odometry chosen.
        recording: what is mapped.
        trajectory: the file of ``--trajectory``.
    """
    if config.smoother.name != "given_poses":
        return ()
    if config.odometry.name == "visual":
        source, cure = "visual odometry", "give true poses (--trajectory FILE)"
    elif config.odometry.name == "recorded" and _file(config, recording, trajectory) == ODOMETRY_FILE:
        true = recording.groundtruth or "FILE"
        source, cure = ODOMETRY_FILE, f"give true poses (--trajectory {true})"
    else:
        return ()
    return (
        f"the smoother given_poses takes poses as true, and those of {source} are estimates that drift: things come out double and in the "
        f"wrong place; take --preset dualmap_estimated_poses (or --set smoother.name=gtsam), or {cure}",
    )


def _file(config: Config, recording: "Recording", trajectory: Path | None) -> str:
    """Name of the file whose poses are replayed; "" if they are from none."""
    given = trajectory or config.odometry.options.get("trajectory") or recording.odometry
    return Path(given).name if isinstance(given, str | Path) else ""
