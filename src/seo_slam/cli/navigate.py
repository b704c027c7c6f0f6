"""``seo-slam navigate``: send a simulated robot for something, and see where it goes."""

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seo_slam.cli.progress import with_progress
from seo_slam.cli.simulate import image_size
from seo_slam.errors import ConfigError, MapError

if TYPE_CHECKING:
    from seo_slam.config import Config
    from seo_slam.driving.run_trial import TrialResult
    from seo_slam.map import Map
    from seo_slam.simulation.home import SimulatedHome

NOT_FOUND = 1
"""Exit status of a search that did not end before the thing."""

GROUPS = ("navigation", "planner", "abstraction", "layout")
"""Settings that ``--set`` takes: all that the robot's search and ways, and its abstract map, have."""

_HELP_SET = f"Change one setting of {', '.join(GROUPS)}, e.g. --set navigation.attempts=5; may be given often."


class Moved(StrEnum):
    """What happened to the thing since the home was mapped."""

    IN_ANCHOR = "in_anchor"
    CROSS_ANCHOR = "cross_anchor"


class Senses(StrEnum):
    """What the robot maps with on its way."""

    DUALMAP = "dualmap"
    TRUE = "true"


class Strategy(StrEnum):
    """Where the next candidate comes from."""

    UPDATED = "updated"
    ORIGINAL = "original"
    RANDOM = "random"


def navigate(
    map_path: Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a result with an abstract map of the world, or its map.json.")],
    text: Annotated[str, typer.Argument(help='What to look for: "the cup", or "the cup in the kitchen".')],
    world: Annotated[str, typer.Option(help="house, or apartment:SEED, the one that was mapped.")],
    meshes: Annotated[Path | None, typer.Option(help="Folder of models with manifests; the house needs it.")] = None,
    moved: Annotated[Moved | None, typer.Option(help="The thing was moved since: on its furniture, or to another.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Another start, another place that the thing was moved to.")] = 0,
    level: Annotated[float, typer.Option(help="How imperfect depth and detector are: 0 perfect, 1 a poor day.")] = 0.5,
    senses: Annotated[Senses, typer.Option(help="dualmap: the pipeline; true: it is told what it sees.")] = Senses.DUALMAP,
    strategy: Annotated[
        Strategy | None, typer.Option(help="Next candidate from the map as updated, as it was, or random.", show_default="updated")
    ] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Size of the robot's images, pixels.")] = "320x240",
    out: Annotated[Path | None, typer.Option(help="Picture of the search, an .svg file.")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help=_HELP_SET)] = None,
    make_map: Annotated[bool, typer.Option("--make-map", help="If MAP holds none: map the world first, on a tour. Takes minutes.")] = False,
) -> None:
    """Drive a simulated robot to what TEXT names in MAP. Exit status 0: it stopped before it; 1: it did not."""
    from seo_slam.driving.errand import errand, moves_in_words
    from seo_slam.driving.home_map import require_map_of
    from seo_slam.driving.homes import home_named
    from seo_slam.driving.mappers import mapper_named
    from seo_slam.driving.pictures import require_svg, write_picture
    from seo_slam.driving.run_trial import DriveOptions, run_trial
    from seo_slam.map import MAP_FILE, Map, embedder_of

    if out is not None:
        require_svg(out)
    chosen = _settings(settings or [], strategy)
    folder = map_path.parent if map_path.name == MAP_FILE and not map_path.is_dir() else map_path  # as Map.load takes it
    is_there = map_path.is_file() or (folder / MAP_FILE).exists()
    mapped = None if make_map and not is_there else _with_abstract(Map.load(map_path), map_path)
    home = home_named(world, level, meshes, image_size(size))
    if mapped is None:
        mapped = _made_map(home, folder, senses, chosen)
    else:
        require_map_of(mapped, home)
    embedder = embedder_of(mapped.embedder)
    trial = errand(home, text, None if moved is None else moved.value, seed, mapped.abstract.rooms if mapped.abstract else ())
    x, y = trial.start_xy
    typer.echo(f"{home.name}, level {level:g}: {text!r}, from x={x:.2f} y={y:.2f}")
    for line in moves_in_words(home.world, trial):
        typer.echo(f"moved       {line}")
    result = run_trial(
        home,
        mapped,
        trial,
        make_mapper=mapper_named(senses.value),
        embedder=embedder,
        settings=chosen.navigation,
        options=DriveOptions(planner=chosen.planner, abstraction=chosen.abstraction, layout=chosen.layout),
        drive=seed,
    )
    typer.echo(_told(result))
    if out is not None:
        typer.echo(f"picture     {write_picture(mapped, result, out)}")
    if not (result.drive.is_success if trial.target_ids else result.outcome.found):
        raise typer.Exit(NOT_FOUND)


def _with_abstract(mapped: "Map", path: Path) -> "Map":
    if mapped.abstract is None:
        raise MapError(f"{path}: holds no abstract map (anchors and layout), wanted a map made with the preset dualmap")
    return mapped


def _settings(assignments: list[str], strategy: Strategy | None) -> "Config":
    """The settings of a search; --strategy wins."""
    from seo_slam.config import Config

    for text in assignments:
        group, dot, _ = text.strip().partition(".")
        if not dot or group not in GROUPS:
            raise ConfigError(f"--set {text}: wanted a setting of {', '.join(GROUPS)}, for example navigation.attempts=5")
    given = [] if strategy is None else [f"navigation.strategy={strategy.value}"]
    return Config().with_settings([*assignments, *given])


def _made_map(home: "SimulatedHome", folder: Path, senses: Senses, chosen: "Config") -> "Map":
    from seo_slam import registry
    from seo_slam.driving.home_map import MappingSettings, map_home
    from seo_slam.driving.mappers import mapper_named

    def progress(frames: range) -> Iterator[int]:
        return with_progress(frames, len(frames), "mapping")

    settings = MappingSettings(chosen.abstraction, chosen.layout)
    return map_home(home, mapper_named(senses.value), registry.create("embedder", "auto"), settings, folder, progress)


def _told(result: "TrialResult") -> str:
    """What was tried and how it ended, in lines."""
    drive, outcome = result.drive, result.outcome
    lines, places = [], 0
    for attempt in outcome.attempts:
        places += attempt.reached
        place = f"place {places}" if attempt.reached else "not come to"
        wanted = attempt.candidate
        why = f", for the {wanted.because}" if wanted.volatile else ""
        where = _printable(f"{attempt.anchor_name or 'on no furniture'}{why} ({wanted.score:.2f})")
        lines.append(f"{place:<11} {where}: {_printable(attempt.reason)}")
    lines.append(f"{outcome.ending.replace('_', ' '):<11} {_printable(outcome.reason)}")
    if result.target_world is None:
        lines.append("truth       nothing in this world has that name")
    else:
        sight = "in sight" if drive.in_sight else "not in sight"
        verdict = "" if drive.failure is None else f": {drive.failure}"
        lines.append(f"truth       it is {drive.distance_m:.2f} m away, {sight}{verdict}")
    touched = {0: "no collision", 1: "1 collision"}.get(drive.collisions, f"{drive.collisions} collisions")
    shortest = f", shortest way {drive.shortest_m:.1f} m" if result.target_world is not None else ""
    lines.append(f"way         {drive.driven_m:.1f} m in {drive.steps} frames{shortest}, {touched}")
    return "\n".join(lines)


def _printable(text: str) -> str:
    # Labels come from a detector or a language model: they must not steer the terminal.
    return "".join(c if c.isprintable() else "?" for c in text)
