"""The life of landmarks in simulated rooms that change: ghosts, things that were only hidden, and ids of things that moved.

python benchmarks/life_cycle.py --rooms all --seeds 0-4 --meshes DIR --out DIR
Prints one JSON object, with its definitions and every failure; with --out also life_cycle.json and life_cycle.jsonl (every case).
"""

import argparse
import dataclasses
import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from life_judging import (
    DEFINITIONS,
    Case,
    Left,
    counted,
    judge_ghost,
    judge_hidden,
    judge_moved,
    judge_stayed,
    taken_ids,
)
from life_watch import LifeWatch, Moment, old_places
from run_options import add_options, fail_early
from simulated_runs import (
    Failure,
    Job,
    in_parallel,
    make_recording,
    report_failures,
    run_variants,
    settings_of,
    share,
)

from seo_slam.evaluation.true_objects import TruthObject
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.simulation.world import Thing

PROTOCOL = "life_cycle/1"
KINDS = ("ghosts", "hidden", "stayed", "moved", "took_another_id", "others_took_another_id")
GOOD = {"gone", "kept", "not_mapped", "undecided", "not_seen_again"}
"""Verdicts that are no failure; some are no case either."""


@dataclasses.dataclass(frozen=True, slots=True)
class Done:
    """What a job brings back: for each variant its cases of each kind, and the variants that failed."""

    cases: dict[str, dict[str, list[Case]]]
    failures: list[Failure]


def run_job(job: Job) -> Done:
    """Run all variants of one room and seed, and judge what became of their landmarks."""
    with tempfile.TemporaryDirectory() as folder:  # a frame is looked at twice: by the pipelines and by the watch
        recording = make_recording(job if job.cache else dataclasses.replace(job, cache=folder))
        watch = LifeWatch(recording, job.radius_m, max(config.lifting.max_depth_m for config in job.variants.values()))
        _, failures = run_variants(recording, job, watch.on_keyframe)
    failed = {failure.variant for failure in failures}
    return Done({name: judged(recording, moments, job) for name, moments in watch.moments.items() if name not in failed}, failures)


def judged(recording: SimulatedRecording, moments: Sequence[Moment], job: Job) -> dict[str, list[Case]]:
    """Return all cases of one run, by kind."""
    scene, camera = recording.scene, recording.camera
    smallest_px = recording.detector_knobs.smallest_px * camera.width * camera.height / (640 * 480)
    left = []
    for index, thing in old_places(scene.changes, recording).items():
        change = scene.changes[index]
        left.append(Left(index, change.timestamp_s, change.event, place(thing, moments, change.timestamp_s)))
    moved = [item for item in left if item.event == "moved"]
    changed = {change.thing.id for change in scene.changes}
    staying = [item for item in moments[-1].true.objects if int(item.id) not in changed]
    first_change_s = min((change.timestamp_s for change in scene.changes), default=np.inf)
    own, others = taken_ids(moments, first_change_s, {item.thing_id for item in moved}, changed - {item.thing_id for item in moved})
    found: dict[str, list[Case]] = {
        "ghosts": [judge_ghost(moments, item, job.radius_m) for item in left],
        "hidden": [case for item in staying if (case := judge_hidden(moments, item, smallest_px))],
        "stayed": [case for item in staying if (case := judge_stayed(moments, item))],
        "moved": [judge_moved(moments, item, smallest_px) for item in moved],
        "took_another_id": [case | {"verdict": "took"} for case in own],
        "others_took_another_id": [case | {"verdict": "took"} for case in others],
    }
    labels = {thing.id: thing.label for world in scene.worlds for thing in world.things}
    for case in (case for cases in found.values() for case in cases):
        case |= {"room": job.room, "seed": job.seed, "label": labels[case["thing"]]}
    return found


def place(thing: Thing, moments: Sequence[Moment], timestamp_s: float) -> TruthObject:
    """Return a thing as it was known at the last keyframe before a time: with the surface seen until then, if there was a keyframe."""
    for moment in reversed([m for m in moments if m.timestamp_s < timestamp_s]):
        for item in moment.true.objects:
            if int(item.id) == thing.id:
                return item
    low, high = thing.bounds_world
    return TruthObject(str(thing.id), (thing.label,), thing.p_world[None], float(min(high[0] - low[0], high[1] - low[1])) / 2)


def summary(jobs: Sequence[Job], done: Sequence[Done], failures: Sequence[Failure]) -> dict[str, Any]:
    """Return the JSON object."""
    stated = settings_of(jobs)
    names = [name for name in jobs[0].variants if any(name in item.cases for item in done)]
    cases = {name: {kind: [case for item in done for case in item.cases.get(name, {}).get(kind, [])] for kind in KINDS} for name in names}
    return {
        "protocol": PROTOCOL,
        **{key: value for key, value in stated.items() if key not in ("settings", "versions", "commit")},
        "definitions": DEFINITIONS,
        "variants": {
            name: {
                **shares(found),
                "per_room": {room: shares(only(found, lambda case, room=room: case["room"] == room)) for room in stated["rooms"]},
                "failed_cases": only(found, lambda case: case["verdict"] not in GOOD),
            }
            for name, found in cases.items()
        },
        "failures": [dataclasses.asdict(failure) for failure in failures],
        "settings": stated["settings"],
        "versions": stated["versions"],
        "commit": stated["commit"],
    }


def only(cases: Mapping[str, Sequence[Case]], wanted: Callable[[Case], bool]) -> dict[str, list[Case]]:
    """Return the cases that are wanted, by kind."""
    return {kind: [case for case in some if wanted(case)] for kind, some in cases.items()}


def shares(cases: Mapping[str, Sequence[Case]]) -> dict[str, Any]:
    """Return counts and shares of each kind."""
    ghosts, hidden, stayed, moved = (counted(cases[kind]) for kind in ("ghosts", "hidden", "stayed", "moved"))
    gone, decided = ghosts.get("gone", 0), ghosts.get("gone", 0) + ghosts.get("ghost", 0)
    undecided = [case for case in cases["ghosts"] if case["verdict"] == "undecided"]
    took_over = [case for case in cases["ghosts"] if case["verdict"] == "gone" and case["taken_over_by"] is not None]
    seconds = sorted(case["gone_after_s"] for case in cases["ghosts"] if case.get("gone_after_s") is not None)
    kept = moved.get("kept", 0)
    again = kept + moved.get("other_id", 0) + moved.get("not_mapped_again", 0)
    return {
        "ghosts": {
            "cases": decided,
            "gone": gone,
            "share_gone": share(gone, decided),
            "taken_over": len(took_over),
            "undecided": len(undecided),
            "undecided_but_gone_at_the_end": sum(not case["standing"] for case in undecided),
            "not_mapped": ghosts.get("not_mapped", 0),
            "median_seconds_until_gone": float(np.median(seconds)) if seconds else None,
        },
        "hidden": fates(hidden),
        "stayed": fates(stayed),
        "moved": {
            "cases": again,
            "kept": kept,
            "share_kept": share(kept, again),
            "other_id": moved.get("other_id", 0),
            "not_mapped_again": moved.get("not_mapped_again", 0),
            "not_mapped": moved.get("not_mapped", 0),
            "not_seen_again": moved.get("not_seen_again", 0),
            "took_another_id": len(cases["took_another_id"]),
            "others_took_another_id": len(cases["others_took_another_id"]),
        },
    }


def fates(verdicts: Mapping[str, int]) -> dict[str, Any]:
    """Return counts and shares of landmarks of things that stayed."""
    total, removed, lost = sum(verdicts.values()), verdicts.get("removed", 0), verdicts.get("lost", 0)
    return {"cases": total, "removed": removed, "share_removed": share(removed, total), "lost": lost, "share_lost": share(lost, total)}


def write_files(out: Path, result: Mapping[str, Any], done: Sequence[Done]) -> None:
    """Write life_cycle.json and life_cycle.jsonl."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "life_cycle.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    found = [(name, kind, case) for item in done for name, cases in item.cases.items() for kind in KINDS for case in cases[kind]]
    rows = [{"variant": name, "kind": kind, **case} for name, kind, case in found]
    (out / "life_cycle.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, judge, print; return 1 if a run failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, variants="RG+D+L")
    given = parser.parse_args(arguments)
    jobs = fail_early(parser, given)
    done, failures = in_parallel(run_job, jobs, given.jobs, "rooms")
    failures = failures + [failure for item in done for failure in item.failures]
    result = summary(jobs, done, failures)
    if given.out:
        write_files(given.out, result, done)
    print(json.dumps(result, indent=1))
    report_failures(failures)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
