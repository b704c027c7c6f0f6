"""SEO-SLAM's Table II in simulation, protocol landmarks/1: how well the maps of several variants match what is in six rooms.

python benchmarks/semantic_mapping.py --rooms all --seeds 0-4 --meshes DIR --variants RG,RG+D,RG+D+L --out DIR
Prints one JSON object; with --out also semantic_mapping.json, semantic_mapping.md and runs.jsonl (every run, who matched and who did not).
"""

import argparse
import dataclasses
import json
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from run_options import add_options, fail_early
from simulated_runs import (
    VARIANTS,
    Failure,
    Job,
    in_parallel,
    make_recording,
    mean_and_std,
    report_failures,
    run_variants,
    seconds_per_keyframe,
    settings_of,
)

from seo_slam.evaluation.ceilings import ORACLE, geometry_ceiling, oracle_ceiling, share_of_way
from seo_slam.evaluation.labels import LabelRule
from seo_slam.evaluation.landmarks import evaluate_landmarks
from seo_slam.evaluation.scores import ENOUGH_KEYFRAMES, LANDMARKS_PROTOCOL, LandmarksResult
from seo_slam.evaluation.trajectory import ape
from seo_slam.evaluation.true_objects import Truth
from seo_slam.evaluation.truth import truth_from
from seo_slam.pipeline import Pipeline
from seo_slam.simulation.simulated_recording import SimulatedRecording

Row = dict[str, Any]

FIGURES = (
    "f1",
    "precision",
    "recall",
    "false_positives",
    "duplicates",
    "ghosts",
    "false",
    "landmarks",
    "matched",
    "objects",
    "f1_visible",
    "objects_visible",
    "ape_rmse_m",
    "seconds_per_keyframe",
)
"""What is averaged over runs."""

COUNTED = {
    "objects": "G: objects present when the recording ends",
    "landmarks": "stable ones, at the end",
    "visible": f"G: those objects that were in view for {ENOUGH_KEYFRAMES} keyframes or more; a landmark of another present object counts "
    "neither way",
    "false_positives": "landmarks without an object: duplicates, ghosts and false ones",
    "seconds_per_keyframe": "all stages but drawing; variants share one text model in a process, so that the first one pays for new words",
    "std": "sample standard deviation over the runs",
}

CEILING_VARIANT = "RG+D+L"
"""The ceilings are computed on its map."""

CEILINGS = {"geometry": geometry_ceiling, "oracle": oracle_ceiling}
CEILING_RULES = {"geometry": "labels ignored", "oracle": ORACLE}


@dataclasses.dataclass(frozen=True, slots=True)
class Done:
    """What a job brings back: a row a variant, and the variants that failed."""

    rows: list[Row]
    failures: list[Failure]


def run_job(job: Job) -> Done:
    """Run all variants of one room and seed on the same frames, and score them."""
    started = time.perf_counter()
    recording = make_recording(job)
    pipelines, failures = run_variants(recording, job)
    truth = truth_from(recording.truth, job.name)
    rows = [scored(name, pipeline, recording, truth, job) for name, pipeline in pipelines.items()]
    for row in rows:
        row["job_seconds"] = round(time.perf_counter() - started, 3)
    return Done(rows, failures)


def scored(variant: str, pipeline: Pipeline, recording: SimulatedRecording, truth: Truth, job: Job) -> Row:
    """Return all that is known of one run."""
    result = pipeline.result()
    found = (*result.map.landmarks, *result.map.tentative)  # the odometry begins at a true pose: the map's world is the true one
    score = evaluate_landmarks(found, truth, LabelRule.exact(), job.radius_m)
    row = {
        "room": job.room,
        "seed": job.seed,
        "variant": variant,
        "level": job.level,
        **score.as_dict(),
        **of_visible(score),
        "ape_rmse_m": ape(result.trajectory, recording.trajectory).rmse_m,
        "keyframes": result.keyframes,
        "detections": result.detections,
        "seconds_per_keyframe": seconds_per_keyframe(pipeline),
        "embedder": result.map.embedder,
        "warnings": dict(result.warnings),
        "events": event_counts(result.events),
        "agents": result.agents,
        "timeline": recording.truth["timeline"],
    }
    if variant == CEILING_VARIANT:
        ceilings = {name: ceiling(found, truth, job.radius_m) for name, ceiling in CEILINGS.items()}
        row["ceilings"] = {name: {**ceiling.score.as_dict(), **of_visible(ceiling)} for name, ceiling in ceilings.items()}
    return row


def of_visible(result: LandmarksResult) -> Row:
    """Return F1 and G of the objects that were in view for long enough."""
    score = result.score.visible
    return {"f1_visible": score.f1 if score else 0.0, "objects_visible": score.objects if score else 0}


def event_counts(events: Sequence[tuple[int, Any]]) -> dict[str, int]:
    """Return how often each kind of event happened."""
    kinds = [event.kind for _, event in events]
    return {kind: kinds.count(kind) for kind in sorted(set(kinds))}


def summary(jobs: Sequence[Job], rows: Sequence[Row], failures: Sequence[Failure]) -> dict[str, Any]:
    """Return the JSON object."""
    stated = settings_of(jobs)
    names = [name for name in jobs[0].variants if any(row["variant"] == name for row in rows)]
    rooms = stated["rooms"]
    variants = {name: variant_summary([row for row in rows if row["variant"] == name], rooms) for name in names}
    ceilings = ceiling_summary([row for row in rows if "ceilings" in row], rooms)
    return {
        "protocol": LANDMARKS_PROTOCOL,
        **{key: value for key, value in stated.items() if key not in ("settings", "versions", "commit")},
        "label_rule": "exact",
        "odometry": "drifting, as recorded; true poses only score",
        "counted": COUNTED,
        "presets": {name: VARIANTS.get(name, "added") for name in jobs[0].variants},
        "embedder": sorted({row["embedder"] for row in rows}),
        "variants": variants,
        "ceilings": ceilings,
        "comparison": comparison(variants, ceilings, rooms),
        "failures": [dataclasses.asdict(failure) for failure in failures],
        "settings": stated["settings"],
        "versions": stated["versions"],
        "commit": stated["commit"],
    }


def variant_summary(rows: Sequence[Row], rooms: Sequence[str]) -> dict[str, Any]:
    """Return means and deviations of one variant, over all runs and a room, and what became of each class of objects in all runs."""
    radii = [entry["radius_m"] for entry in rows[0]["sweep"]]
    return {
        "runs": len(rows),
        **figures(rows, FIGURES),
        "f1_by_radius": {f"{r:g}": mean_and_std(row["sweep"][k]["f1"] for row in rows) for k, r in enumerate(radii)},
        "per_room": per_room(rows, rooms, FIGURES),
        "per_class": classes(rows),
    }


def figures(rows: Sequence[Row], keys: Sequence[str]) -> dict[str, Any]:
    """Return mean and deviation of each key."""
    return {key: mean_and_std(row[key] for row in rows) for key in keys}


def per_room(rows: Sequence[Row], rooms: Sequence[str], keys: Sequence[str]) -> dict[str, Any]:
    """Return mean and deviation of each key in each room."""
    by_room = {room: [row for row in rows if row["room"] == room] for room in rooms}
    return {room: {"runs": len(some), **figures(some, keys)} for room, some in by_room.items() if some}


def classes(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the per-class tables of many runs, added up; landmarks that name no class of their truth come last."""
    total: dict[str | None, Counter[str]] = {}
    for entry in (entry for row in rows for entry in row["per_class"]):
        counts = {key: value for key, value in entry.items() if key != "label"}
        total.setdefault(entry["label"], Counter()).update(counts)
    return [{"label": label, **total[label]} for label in sorted(total, key=lambda label: (label is None, label or ""))]


def ceiling_summary(rows: Sequence[Row], rooms: Sequence[str]) -> dict[str, Any]:
    """Return what the map of one variant could score at best."""
    if not rows:
        return {}
    keys = ("f1", "precision", "recall", "f1_visible")
    out: dict[str, Any] = {"of": CEILING_VARIANT}
    for name, rule in CEILING_RULES.items():
        found = [{"room": row["room"], **row["ceilings"][name]} for row in rows]
        out[name] = {"label_rule": rule, **figures(found, keys), "per_room": per_room(found, rooms, keys)}
    return out


def comparison(variants: Mapping[str, Any], ceilings: Mapping[str, Any], rooms: Sequence[str]) -> dict[str, Any]:
    """Return how the variants differ, a room and on the mean.

    Against the first one: false positives as its share, and F1 less its F1. For what builds on the variant of the ceilings also the
    share of the way from there to the oracle.
    """
    if len(variants) < 2:
        return {}
    base, *others = variants
    compared: dict[str, Any] = {"base": base}
    for place in (*rooms, "mean"):
        found = {name: at(value, place) for name, value in variants.items()}
        if not found[base]:
            continue
        base_false = found[base]["false_positives"]["mean"]
        compared[place] = {
            name: {
                "false_positives_ratio": round(found[name]["false_positives"]["mean"] / base_false, 4) if base_false else None,
                "f1_difference": round(found[name]["f1"]["mean"] - found[base]["f1"]["mean"], 4),
            }
            for name in others
            if found[name]
        }
        for name in (name for name in compared[place] if name.startswith(f"{CEILING_VARIANT}+") and ceilings):
            f1 = [entry["f1"]["mean"] for entry in (found[CEILING_VARIANT], found[name], at(ceilings["oracle"], place))]
            compared[place][name]["share_of_way_to_oracle"] = share_of_way(*f1)
    return compared


def at(value: Mapping[str, Any], place: str) -> Mapping[str, Any]:
    """Return the figures of a room, or those over all runs; empty where there are none."""
    return value if place == "mean" else value["per_room"].get(place, {})


def table(result: Mapping[str, Any]) -> str:
    """Return the result as Markdown, laid out like the paper's Table II."""
    variants, changed = result["variants"], result["knobs"]["changed"]
    lines = [
        "# Semantic mapping in simulated rooms",
        "",
        f"Protocol {result['protocol']}, radius {result['radius_m']:g} m, labels {result['label_rule']}, level {result['level']:g}"
        f"{', ' + ', '.join(changed) if changed else ''}, {result['frames']} frames of {result['size_px'][0]}x{result['size_px'][1]}, "
        f"{result['shapes']}, seeds {', '.join(map(str, result['seeds']))}, scene changes {'on' if result['scene_changes'] else 'off'}, "
        f"embedder {', '.join(result['embedder'])}, commit {result['commit']}.",
        "Mean ± sample standard deviation over seeds; the last rows over all runs. G: objects present at the end.",
        "Orderings and differences between variants may be claimed, absolute figures may not.",
        "",
        "| data set | G | method | P | R | F1 | F1 visible | landmarks | false positives | duplicates | ghosts | APE (m) |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for room in result["rooms"]:
        lines += [table_row(room, name, value["per_room"][room]) for name, value in variants.items() if room in value["per_room"]]
    lines += [table_row("mean", name, value) for name, value in variants.items()]
    for name, rule in CEILING_RULES.items() if result["ceilings"] else ():
        ceiling = result["ceilings"][name]
        shown = " | ".join(plus_minus(ceiling[key], 3) for key in ("precision", "recall", "f1", "f1_visible"))
        lines.append(f"| mean | | ceiling of {CEILING_VARIANT}: {rule} | {shown} | | | | | |")
    if result["failures"]:
        lines += ["", f"{len(result['failures'])} failed: " + ", ".join(f"{f['room']} seed {f['seed']}" for f in result["failures"])]
    return "\n".join(lines) + "\n"


def table_row(place: str, name: str, value: Mapping[str, Any]) -> str:
    """Return one row of the table."""
    ratios = " | ".join(plus_minus(value[key], 3) for key in ("precision", "recall", "f1", "f1_visible"))
    numbers = " | ".join(plus_minus(value[key], 1) for key in ("landmarks", "false_positives", "duplicates", "ghosts"))
    return f"| {place} | {value['objects']['mean']:.4g} | {name} | {ratios} | {numbers} | {plus_minus(value['ape_rmse_m'], 3)} |"


def plus_minus(value: Mapping[str, float], digits: int) -> str:
    """Return mean ± deviation."""
    return f"{value['mean']:.{digits}f} ± {value['std']:.{digits}f}"


def write_files(out: Path, result: Mapping[str, Any], rows: Sequence[Row]) -> None:
    """Write semantic_mapping.json, semantic_mapping.md and runs.jsonl."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "semantic_mapping.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (out / "semantic_mapping.md").write_text(table(result), encoding="utf-8")
    (out / "runs.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")


def evaluate(jobs: Sequence[Job], processes: int, title: str = "rooms") -> tuple[list[Row], list[Failure]]:
    """Do all jobs; return a row a run in the order of rooms, seeds and variants, and what failed."""
    done, failures = in_parallel(run_job, jobs, processes, title)
    return [row for item in done for row in item.rows], failures + [failure for item in done for failure in item.failures]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, score, print; return 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, variants="RG,RG+D,RG+D+L")
    given = parser.parse_args(arguments)
    jobs = fail_early(parser, given)
    rows, failures = evaluate(jobs, given.jobs)
    result = summary(jobs, rows, failures)
    if given.out:
        write_files(given.out, result, rows)
    print(json.dumps(result, indent=1))
    report_failures(failures)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
