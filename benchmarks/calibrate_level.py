"""Find the level of detector and sensor errors at which RG does as well as in the paper, and freeze it in detector_level.json.

python benchmarks/calibrate_level.py --meshes DIR --cache DIR [--jobs N] [--again]
The level is the only thing that is fitted, and it is fitted once: on RG's mean F1 over six rooms and seeds 0-4. Prints the file's content.
"""

import argparse
import datetime
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from run_options import LEVEL_FILE, add_options, fail_early
from semantic_mapping import evaluate
from simulated_runs import Failure, Job, mean_and_std, report_failures, settings_of

TARGET_F1 = 0.635
"""Mean of RG's six rooms in the paper's Table II: .53 .60 .71 .79 .62 .56."""

TOLERANCE = 0.02
GOOD_ENOUGH = 0.005
"""Nearer than this, another evaluation is not worth its time."""

MOST_EVALUATIONS = 6
STEP = 0.01
"""Levels are rounded to this."""

Evaluation = dict[str, Any]


class Stopped(Exception):  # noqa: N818  # no error of this search: runs failed
    """Runs failed: a level found without them would be another one."""

    def __init__(self, failures: Sequence[Failure]) -> None:
        self.failures = failures
        super().__init__(f"{len(failures)} runs failed")


def search(mean_f1: Callable[[float], float], first: float) -> list[tuple[float, float]]:
    """Return (level, mean F1) of all evaluations, in order: bisection, once levels with too high and too low F1 are known.

    Args:
        mean_f1: of a level; it falls as the level rises.
        first: level to begin with.
    """
    low, high, level = 0.0, None, first
    tried: list[tuple[float, float]] = []
    while len(tried) < MOST_EVALUATIONS:
        f1 = mean_f1(level)
        tried.append((level, f1))
        if abs(f1 - TARGET_F1) <= GOOD_ENOUGH:
            break
        if f1 > TARGET_F1:
            low = level
        else:
            high = level
        following = round(2.0 * level if high is None else (low + high) / 2, 2)
        if following in {level for level, _ in tried} or following < STEP:
            break
        level = following
    return tried


def evaluation_of(jobs: Sequence[Job], level: float, processes: int) -> Evaluation:
    """Return RG's mean F1 at a level, over all and a room.

    Raises:
        Stopped: a run failed.
    """
    rows, failures = evaluate([replace(job, level=level) for job in jobs], processes, f"level {level:g}")
    if failures:
        raise Stopped(failures)
    rooms = list(dict.fromkeys(job.room for job in jobs))
    per_room = {room: round(mean_and_std(row["f1"] for row in rows if row["room"] == room)["mean"], 4) for room in rooms}
    return {"level": level, "rg_f1": mean_and_std(row["f1"] for row in rows), "per_room": per_room}


def main(arguments: Sequence[str] | None = None) -> int:
    """Search, write, print; return 1 if a run failed or no level is near enough."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, variants="RG")
    parser.set_defaults(level=0.5)
    parser.add_argument("--again", action="store_true", help=f"replace {LEVEL_FILE.name}")
    parser.add_argument("--file", type=Path, default=LEVEL_FILE, help=f"default: {LEVEL_FILE.name}")
    given = parser.parse_args(arguments)
    jobs = fail_early(parser, given)
    if given.variants != "RG" or given.add or given.knob or given.level <= 0:
        parser.error("the level is that of RG with all knobs at their level: no other variant, no knob; --level: where to begin")
    if given.file.exists() and not given.again:
        parser.error(f"{given.file} is there: the level is chosen once; give --again if you must")
    evaluations: list[Evaluation] = []

    def mean_f1(level: float) -> float:
        evaluations.append(evaluation_of(jobs, level, given.jobs))
        print(f"level {level:g}: RG mean F1 {evaluations[-1]['rg_f1']['mean']:.4f}", file=sys.stderr)
        return float(evaluations[-1]["rg_f1"]["mean"])

    try:
        tried = search(mean_f1, given.level)
    except Stopped as stopped:
        report_failures(stopped.failures)
        return 1
    level, f1 = min(tried, key=lambda pair: abs(pair[1] - TARGET_F1))
    if abs(f1 - TARGET_F1) > TOLERANCE:
        print(json.dumps(evaluations, indent=1), file=sys.stderr)
        print(f"no level found: the nearest mean F1 is {f1:.4f} at level {level:g}, wanted {TARGET_F1} +- {TOLERANCE}", file=sys.stderr)
        return 1
    stated = settings_of(jobs)
    content = {
        "level": level,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "commit": stated["commit"],
        "rg_mean_f1": f1,
        "target_f1": TARGET_F1,
        "tolerance": TOLERANCE,
        **{key: stated[key] for key in ("rooms", "seeds", "frames", "size_px", "shapes", "scene_changes", "radius_m")},
        "evaluations": evaluations,
        "settings": stated["settings"]["RG"],
        "versions": stated["versions"],
    }
    text = json.dumps(content, indent=1) + "\n"
    given.file.write_text(text, encoding="utf-8")
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
