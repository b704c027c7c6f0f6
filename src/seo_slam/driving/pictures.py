"""Pictures of drives."""

from pathlib import Path

from seo_slam.driving.run_trial import TrialResult
from seo_slam.errors import ConfigError, DatasetError
from seo_slam.evaluation.navigation import SUCCESS_M
from seo_slam.map import Map
from seo_slam.report.navigation_svg import Search, navigation_svg


def require_svg(path: str | Path) -> Path:
    """Return the path of a picture.

    Raises:
        ConfigError: it does not end in .svg, or its folder is not there.
    """
    target = Path(path)
    if target.suffix.lower() != ".svg":
        raise ConfigError(f"{target}: got a picture of type {target.suffix or 'none'}, wanted a name that ends in .svg")
    if not target.parent.is_dir():
        raise ConfigError(f"{target}: there is no folder {target.parent}")
    return target


def write_picture(mapped: Map, result: TrialResult, path: str | Path, title: str = "") -> Path:
    """Write a picture of a drive over the map that it began with.

    Raises:
        ConfigError: see ``require_svg``; or the map has no abstract map.
        DatasetError: the file cannot be written.
    """
    target = require_svg(path)
    if mapped.abstract is None:
        raise ConfigError("picture: got a map without an abstract map")
    search = Search(
        abstract_map=mapped.abstract,
        driven_world=result.xy_world,
        planned=[(attempt.candidate.anchor_id, attempt.path_world) for attempt in result.outcome.attempts if attempt.reached],
        title=title or f"{result.trial.query}: {result.outcome.ending.replace('_', ' ')}",
        subtitle=result.outcome.reason,
        target_world=result.target_world,
        believed_world=result.outcome.target_world,
        success_m=SUCCESS_M,
    )
    try:
        target.write_text(navigation_svg(search), encoding="utf-8")
    except OSError as error:
        raise DatasetError(f"{target}: cannot be written: {error.strerror or error}") from error
    return target
