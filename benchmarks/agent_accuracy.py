"""Where agents stop helping: RG+D+L+A against RG+D+L as the simulated models get worse, protocol landmarks/1.

python benchmarks/agent_accuracy.py --rooms all --seeds 0-4 --meshes DIR --accuracies 0.6,0.7,0.8,0.9,1.0 --out DIR
Prints one JSON object; with --out also agent_accuracy.json and agent_accuracy.md. All three agents have the stated accuracy.
"""

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from typing import Any

from run_options import add_options, fail_early
from semantic_mapping import Row, evaluate, variant_summary
from simulated_models import ModelKnobs
from simulated_runs import Failure, Job, report_failures, settings_of

from seo_slam.evaluation.scores import LANDMARKS_PROTOCOL

BASE, WITH_AGENTS = "RG+D+L", "RG+D+L+A"

ALLOWED_LOSS = 0.01
"""Agents that are of no use may cost so much F1 on the mean."""


def jobs_at(accuracy: float | None, jobs: Sequence[Job]) -> list[Job]:
    """Return the jobs with agents of an accuracy; without agents for None."""
    name = BASE if accuracy is None else WITH_AGENTS
    return [
        dataclasses.replace(job, variants={name: job.variants[name]}, models=dataclasses.replace(job.models, accuracy=accuracy))
        for job in jobs
    ]


def summary(jobs: Sequence[Job], rows: dict[float | None, list[Row]], failures: Sequence[Failure]) -> dict[str, Any]:
    """Return the JSON object."""
    stated = settings_of(jobs_at(1.0, jobs))
    base = variant_summary(rows[None], stated["rooms"])
    swept = [
        {"accuracy": accuracy, **compared(variant_summary(found, stated["rooms"]), base)}
        for accuracy, found in rows.items()
        if accuracy is not None
    ]
    helping = [entry["accuracy"] for entry in swept if entry["f1_difference"] > 0]
    return {
        "protocol": LANDMARKS_PROTOCOL,
        **{key: value for key, value in stated.items() if key not in ("settings", "versions", "commit", "models")},
        "models": ModelKnobs(None, jobs[0].models.latency_s, jobs[0].models.in_flight).as_dict()
        | {"accuracy": "swept, the same for all roles"},
        "base": {"variant": BASE, **shortened(base)},
        "sweep": swept,
        "helps_from_accuracy": min(helping) if helping else None,
        "never_hurts_by_more_than_allowed": all(entry["f1_difference"] >= -ALLOWED_LOSS for entry in swept),
        "failures": [dataclasses.asdict(failure) for failure in failures],
        "versions": stated["versions"],
        "commit": stated["commit"],
    }


def shortened(value: dict[str, Any]) -> dict[str, Any]:
    """Return the figures that matter here, over all runs and by room."""
    keys = ("f1", "precision", "recall", "false_positives")
    rooms = {room: {key: figures[key] for key in keys} for room, figures in value["per_room"].items()}
    return {"runs": value["runs"], **{key: value[key] for key in keys}, "per_room": rooms}


def compared(value: dict[str, Any], base: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of an accuracy, and what they are beside those without agents."""
    by_room = {room: round(figures["f1"]["mean"] - base["per_room"][room]["f1"]["mean"], 4) for room, figures in value["per_room"].items()}
    difference = round(value["f1"]["mean"] - base["f1"]["mean"], 4)
    return {**shortened(value), "f1_difference": difference, "f1_difference_by_room": by_room}


def table(result: dict[str, Any]) -> str:
    """Return the result as Markdown."""
    lines = ["| accuracy of the simulated models | F1 | false positives | F1 less that of RG+D+L | worst room |", "|---|---|---|---|---|"]
    base = result["base"]
    lines.append(f"| no agents | {base['f1']['mean']:.3f} ± {base['f1']['std']:.3f} | {base['false_positives']['mean']:.2f} | | |")
    for entry in result["sweep"]:
        room, worst = min(entry["f1_difference_by_room"].items(), key=lambda item: item[1])
        lines.append(
            f"| {entry['accuracy']:g} | {entry['f1']['mean']:.3f} ± {entry['f1']['std']:.3f} | {entry['false_positives']['mean']:.2f} "
            f"| {entry['f1_difference']:+.3f} | {room} {worst:+.3f} |"
        )
    return "\n".join(lines) + "\n"


def accuracies_from(text: str) -> list[float]:
    """Return the accuracies that a text like 0.6,0.8 names.

    Raises:
        ValueError: one is no number from 0 to 1.
    """
    found = [float(part) for part in text.split(",")]
    if not all(0 <= accuracy <= 1 for accuracy in found):
        raise ValueError(f"--accuracies: got {text!r}, wanted numbers from 0 to 1")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, score, print; return 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, variants=f"{BASE},{WITH_AGENTS}")
    parser.add_argument("--accuracies", default="0.6,0.7,0.8,0.9,1.0", help="of all three agents, swept")
    given = parser.parse_args(arguments)
    try:
        swept = accuracies_from(given.accuracies)
    except ValueError as error:
        parser.error(str(error))
    jobs = fail_early(parser, given)
    rows: dict[float | None, list[Row]] = {}
    failures: list[Failure] = []
    for accuracy in (None, *swept):
        rows[accuracy], failed = evaluate(
            jobs_at(accuracy, jobs), given.jobs, "no agents" if accuracy is None else f"accuracy {accuracy:g}"
        )
        failures += failed
    result = summary(jobs, rows, failures)
    if given.out:
        (given.out / "agent_accuracy.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        (given.out / "agent_accuracy.md").write_text(table(result), encoding="utf-8")
    print(json.dumps(result, indent=1))
    report_failures(failures)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
