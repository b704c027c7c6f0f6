"""What everything but detector and odometry costs a keyframe, against the detector, in one run. Prints one JSON object.

python benchmarks/pipeline_cost.py RECORDING WEIGHTS [--score 0.35] [--runs 3]
"""

import argparse
import json
import statistics
import tempfile
from pathlib import Path

from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.backends.yolox_detector import YoloxDetector
from seo_slam.config import Component
from seo_slam.datasets.open import open_dataset
from seo_slam.pipeline import Pipeline
from seo_slam.run_files import peak_memory_mb, prepare_folder, versions
from seo_slam.run_recording import run_recording

MAPPING_STAGES = ("observe", "associate", "smooth", "map", "store", "report")


def one_run(path: str, weights: str, score: float) -> dict[str, float]:
    """Median milliseconds of every stage of one run."""
    recording = open_dataset("auto", path)
    with tempfile.TemporaryDirectory() as folder:
        out = prepare_folder(folder, overwrite=False)
        pipeline = Pipeline(
            detector=YoloxDetector(weights, score=score, threads=1),
            odometry=RecordedOdometry(recording.trajectory),
            store=Component(name="sqlite", options={"path": Path(out) / "map.db"}),
        )
        finished = run_recording(recording, pipeline, out, dataset=recording.path.name)
    return {stage: 1e3 * values["p50"] for stage, values in finished.run["seconds_per_stage"].items()}


def main() -> None:
    """Run, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording")
    parser.add_argument("weights")
    parser.add_argument("--score", type=float, default=0.35)
    parser.add_argument("--runs", type=int, default=3)
    given = parser.parse_args()
    runs = [one_run(given.recording, given.weights, given.score) for _ in range(given.runs)]
    rows = [
        {
            "detector_ms": run["detect"],
            "mapping_ms": sum(run[stage] for stage in MAPPING_STAGES),
            "ratio": sum(run[stage] for stage in MAPPING_STAGES) / run["detect"],
            "reading_images_ms": run["read"],
            "stages_ms": {stage: round(run[stage], 3) for stage in MAPPING_STAGES},
        }
        for run in runs
    ]
    print(
        json.dumps(
            {
                "what": "median milliseconds a keyframe; mapping is all but detector, odometry and reading of images",
                "recording": Path(given.recording).name,
                "score": given.score,
                "runs": rows,
                "median_ratio": statistics.median(row["ratio"] for row in rows),
                "peak_memory_mb": peak_memory_mb(),
                "versions": versions(),
            },
            indent=1,
        )
    )


if __name__ == "__main__":
    main()
