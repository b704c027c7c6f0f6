"""DualMap's Tables I, III and IV in simulation: mIoU, FmIoU, mAcc and ODR of its concrete map, under three protocols.

python benchmarks/segmentation.py --worlds house,apartment --seeds 0-4 --meshes DIR --variants all --out DIR
Prints one JSON object; with --out also segmentation.json and segmentation.md, and runs.jsonl with every object and every true thing.
All figures are of a simulated detector, segmenter and image encoder.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from run_options import LEVEL_FILE, frozen_level, seeds_from, size_from
from segmentation_runs import HOMES, VARIANTS, WORLDS, Done, Scored, SegmentationJob, run_job
from simulated_runs import Failure, commit, in_parallel, mean_and_std, report_failures

from seo_slam.config import Config
from seo_slam.errors import ConfigError, SeoSlamError
from seo_slam.evaluation.segmentation_protocols import PROTOCOLS
from seo_slam.evaluation.segmentation_scores import COUNTED, over_scenes
from seo_slam.run_files import versions
from seo_slam.simulation.image_encoder import OBJECT_ANGLE_DEG, VIEW_ANGLE_DEG
from seo_slam.simulation.inventories import ROOMS
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.sensors import require_level

GROUPS = {"rooms": ROOMS, "homes": HOMES}
COUNTS = ("predicted", "matched", "duplicates", "missed", "swallowed", "of_dropped", "of_nothing", "rightly_called")


def options() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", default="homes", help=f"homes, rooms, all, or some of {','.join(WORLDS)}")
    parser.add_argument("--seeds", default="0-4", help="like 0-4 or 0,3,7")
    parser.add_argument("--variants", default="full", help=f"all, or some of {', '.join(VARIANTS)}")
    parser.add_argument("--preset", default="dualmap", help="dualmap takes poses as given; dualmap_estimated_poses estimates them")
    parser.add_argument("--odometry", default="true", choices=("true", "drifting"), help="what the pipeline is given")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="settings", help="for all variants; may be repeated"
    )
    parser.add_argument("--meshes", metavar="DIR", help="folder of meshes; without: primitives (the house needs it)")
    parser.add_argument("--level", type=float, help=f"of detector's and sensors' errors; default: that of {LEVEL_FILE.name}")
    parser.add_argument("--object-angle", type=float, default=OBJECT_ANGLE_DEG, help="of the simulated image encoder, degrees")
    parser.add_argument("--view-angle", type=float, default=VIEW_ANGLE_DEG, help="likewise")
    parser.add_argument("--frames", type=int, help="default: six a second")
    parser.add_argument("--size", default="320x240", metavar="WxH")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder for the result's files")
    parser.add_argument("--cache", metavar="DIR", type=Path, help="folder of drawn frames; default: renders in --out")
    return parser


def jobs_from(given: argparse.Namespace) -> list[SegmentationJob]:
    """Return a job for each world and seed.

    Raises:
        ConfigError: an unknown world, variant, preset or setting, or a wrong number.
        DatasetError: no meshes in the folder that is named.
    """
    worlds = _named("worlds", given.worlds, WORLDS, {**GROUPS, "all": WORLDS})
    names = _named("variants", given.variants, tuple(VARIANTS), {"all": tuple(VARIANTS)})
    if given.jobs < 1 or (given.frames is not None and given.frames < 2):
        raise ConfigError(f"--jobs, --frames: got {given.jobs} and {given.frames}, wanted at least 1 and 2")
    if "house" in worlds and not given.meshes:
        raise ConfigError("--worlds: the house needs --meshes DIR")
    if given.meshes:
        MeshLibrary(given.meshes)
    base = Config.preset(given.preset)
    variants = {name: (VARIANTS[name], base.with_settings([*VARIANTS[name].settings, *given.settings])) for name in names}
    cache = given.cache or (given.out / "renders" if given.out else None)
    return [
        SegmentationJob(
            room=world,
            seed=seed,
            level=require_level(frozen_level() if given.level is None else given.level),
            variants=variants,
            meshes=given.meshes,
            frames=given.frames,
            size_px=size_from(given.size),
            cache=None if cache is None else str(cache),
            odometry=given.odometry,
            object_angle_deg=given.object_angle,
            view_angle_deg=given.view_angle,
        )
        for world in worlds
        for seed in seeds_from(given.seeds)
    ]


def summary(jobs: Sequence[SegmentationJob], scored: Sequence[Scored], failures: Sequence[Failure], preset: str) -> dict[str, Any]:
    """Return the JSON object."""
    job = jobs[0]
    worlds = list(dict.fromkeys(job.room for job in jobs))
    names = [name for name in job.variants if any(run.variant == name for run in scored)]
    first = scored[0].results if scored else ()
    return {
        "benchmark": "segmentation",
        "preset": preset,
        "worlds": worlds,
        "seeds": list(dict.fromkeys(job.seed for job in jobs)),
        "level": job.level,
        "odometry": job.odometry,
        "image_encoder": f"simulated encoder, {job.object_angle_deg:g} degrees an object and {job.view_angle_deg:g} a view",
        "detector_and_segmenter": "simulated",
        "embedder": first[0].embedder if first else None,
        "templates": list(first[0].templates) if first else None,
        "truth": f"surfaces in view on keyframes, true poses, one point a {job.voxel_m:g} m voxel; scenes do not change",
        "shapes": "meshes" if job.meshes else "primitives",
        "size_px": list(job.size_px),
        "frames": job.frames or "six a second; rooms 200",
        "stride": "keyframes of the default settings",
        "protocols": {name: protocol.as_dict() for name, protocol in PROTOCOLS.items()},
        "counted": COUNTED,
        "variants": {name: _of_variant([run for run in scored if run.variant == name], worlds) for name in names},
        "failures": [{"world": f.room, "seed": f.seed, "variant": f.variant, "error": f.error} for f in failures],
        "settings": {name: config.model_dump(mode="json") for name, (_, config) in job.variants.items()},
        "versions": versions(),
        "commit": commit(),
    }


def _of_variant(runs: Sequence[Scored], worlds: Sequence[str]) -> dict[str, Any]:
    return {**_figures(runs), "per_world": {world: _figures(own) for world in worlds if (own := [r for r in runs if r.job.room == world])}}


def _figures(runs: Sequence[Scored]) -> dict[str, Any]:
    by_protocol = {}
    for index, name in enumerate(PROTOCOLS):
        results = [run.results[index] for run in runs]
        spread = {key: mean_and_std(getattr(result, key) for result in results) for key in ("miou", "fmiou", "macc")}
        odr = mean_and_std(result.counts.odr for result in results if result.counts.odr is not None)
        by_protocol[name] = {**over_scenes(results).as_dict(), "over_scenes": {**spread, "odr": odr}}
        by_protocol[name]["counts"] = {key: sum(getattr(result.counts, key) or 0 for result in results) for key in ("visible", *COUNTS)}
    return {
        "runs": len(runs),
        "protocols": by_protocol,
        "seconds_per_keyframe": mean_and_std(run.row["seconds_per_keyframe"] for run in runs),
        "ape_rmse_m": mean_and_std(run.row["ape_rmse_m"] for run in runs),
    }


def table(result: dict[str, Any]) -> str:
    """Return the figures as Markdown."""
    heads = ("variant", "protocol", "mIoU", "FmIoU", "mAcc", "ODR", "abs(ODR - 1)", "G", *COUNTS)
    lines = [
        f"DualMap's concrete map, level {result['level']:g}, {result['odometry']} odometry, {result['image_encoder']}.",
        "",
        f"| {' | '.join(heads)} |",
        "|---" * len(heads) + "|",
    ]
    for name, variant in result["variants"].items():
        for protocol, row in variant["protocols"].items():
            scores = " | ".join(f"{row[key]:.3f}" for key in ("miou", "fmiou", "macc", "odr", "odr_error"))
            numbers = " | ".join(str(row["counts"][key]) for key in ("visible", *COUNTS))
            lines.append(f"| {name} | {protocol.removeprefix('segmentation/')} | {scores} | {numbers} |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, print and write; return the exit status."""
    parser = options()
    given = parser.parse_args(arguments)
    try:
        jobs = jobs_from(given)
        if given.out:
            given.out.mkdir(parents=True, exist_ok=True)
    except (SeoSlamError, OSError) as error:
        parser.error(str(error))
    done, failures = in_parallel(run_job, jobs, given.jobs, "segmentation")  # type: ignore[type-var]  # jobs have room, seed and name
    scored = [run for part in done for run in part.scored]
    failures += [failure for part in done for failure in part.failures]
    result = summary(jobs, scored, failures, given.preset)
    if given.out:
        _write(given.out, result, done)
    report_failures(failures)
    print(json.dumps(result))
    return 1 if failures else 0


def _write(folder: Path, result: dict[str, Any], done: Sequence[Done]) -> None:
    (folder / "segmentation.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (folder / "segmentation.md").write_text(table(result), encoding="utf-8")
    lines = [json.dumps(run.row) for part in done for run in part.scored]
    (folder / "runs.jsonl").write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def _named(option: str, text: str, known: Sequence[str], groups: dict[str, Sequence[str]]) -> list[str]:
    found: list[str] = []
    for word in (part.strip() for part in text.split(",") if part.strip()):
        if word not in known and word not in groups:
            raise ConfigError(f"--{option}: got {word!r}, wanted some of {', '.join((*groups, *known))}")
        found += groups.get(word, (word,))
    if not found:
        raise ConfigError(f"--{option}: got none, wanted some of {', '.join((*groups, *known))}")
    return list(dict.fromkeys(found))


if __name__ == "__main__":
    sys.exit(main())
