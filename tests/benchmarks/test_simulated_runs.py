import argparse
import json

import numpy as np
import pytest
from run_options import add_options, frozen_level, jobs_from
from simulated_runs import VARIANTS, Failure, Job, in_parallel, keyframes_of, knobs_of, run_variants

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.config import Config
from seo_slam.errors import ConfigError, SeoSlamError
from seo_slam.pipeline import Pipeline
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.types import NEW, Association

HASHED = Config.from_dict({"embedder": {"name": "hashed"}, "keyframes": {"distance_m": 0.2, "angle_deg": 9.0}})


class Stumbling:
    """An associator that fails on its third keyframe."""

    def __init__(self):
        self.calls = 0

    def associate(self, observations, landmarks, estimate):
        self.calls += 1
        if self.calls == 3:
            raise ZeroDivisionError("stumbled")
        return Association(np.full(len(observations), NEW), np.full(len(observations), np.nan))


def desk():
    return SimulatedDesk(seed=3, frames=14, width=96, height=72, level=0.5)


def parsed(*words):
    parser = argparse.ArgumentParser()
    add_options(parser, variants="RG")
    return parser.parse_args(words)


def test_drawing_keyframes_alone_changes_nothing():
    drawn = desk()
    with Pipeline(HASHED, detector=drawn.detector, odometry=RecordedOdometry(drawn.odometry), embedder=HashedEmbedder()) as whole:
        keyframes = {step.index for step in whole.stream(drawn) if step.is_keyframe}
    pipelines, failures = run_variants(desk(), Job("desk", 3, 0.5, {"ours": HASHED}))
    assert not failures
    assert keyframes == keyframes_of(drawn.odometry, HASHED.keyframes)
    assert len(keyframes) < len(drawn)
    ours, theirs = pipelines["ours"].result(), whole.result()
    np.testing.assert_array_equal(ours.trajectory.T_world_camera, theirs.trajectory.T_world_camera)
    assert ours.map.landmarks
    for mine, other in zip(ours.map.landmarks, theirs.map.landmarks, strict=True):
        np.testing.assert_array_equal(mine.position_m, other.position_m)
        assert mine.labels == other.labels


def test_a_variant_that_fails_leaves_the_others_alone():
    broken = HASHED.updated({"associator": {"name": f"{__name__}:Stumbling"}}, "test")
    pipelines, (failure,) = run_variants(desk(), Job("desk", 3, 0.5, {"broken": broken, "ours": HASHED}))
    assert list(pipelines) == ["ours"]
    assert (failure.variant, failure.error) == ("broken", "ZeroDivisionError: stumbled")
    assert "in associate" in failure.traceback


def halved(job):
    if job.seed == 1:
        raise ConfigError("no place for the bin")
    return job.seed / 2


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_the_order_of_the_jobs_and_failures_apart(processes, capsys):
    jobs = [Job("SM1", seed, 1.0, {}) for seed in (4, 1, 2)]
    results, failures = in_parallel(halved, jobs, processes, "rooms")
    assert results == [2.0, 1.0]
    assert [(f.room, f.seed, f.error) for f in failures] == [("SM1", 1, "ConfigError: no place for the bin")]
    assert "in halved" in failures[0].traceback
    assert isinstance(failures[0], Failure)
    assert "SM1 seed 1 failed" in capsys.readouterr().err


def test_options_become_jobs():
    given = parsed("--rooms", "LG1,SM1", "--seeds", "0-1,7", "--level", "0.5", "--knob", "detector.phantom_spots=2", "--no-changes")
    jobs = jobs_from(given)
    assert [(job.room, job.seed) for job in jobs] == [(room, seed) for room in ("LG1", "SM1") for seed in (0, 1, 7)]
    assert not jobs[0].changes
    knobs = knobs_of(jobs[0], "detector")
    assert knobs.phantom_spots == 2
    assert isinstance(knobs.phantom_spots, int)
    assert knobs.relabel == pytest.approx(0.11)
    assert knobs_of(jobs[0], "sensor").drift_m == pytest.approx(0.006)


def test_variants_are_presets_and_may_be_added_from_a_file(tmp_path):
    (tmp_path / "mine.toml").write_text('[associator]\nname = "nearest"\n')
    words = ["--variants", ",".join(VARIANTS), "--add", f"mine={tmp_path / 'mine.toml'}", "--set", "map.separate_frames=9"]
    given = parsed("--level", "1", *words)
    variants = jobs_from(given)[0].variants
    assert list(variants) == [*VARIANTS, "mine"]
    assert variants["mine"].associator.name == "nearest"
    assert {config.map.separate_frames for config in variants.values()} == {9}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--rooms", "SM1,XL9"], "'XL9', wanted all, or some of SM1"),
        (["--seeds", "3-1"], "'3-1', wanted like 0-4"),
        (["--seeds", "-"], "wanted like 0-4"),
        (["--variants", "RG,RG+A+B"], r"'RG\+A\+B', wanted some of RG, RG\+D"),
        (["--variants", ""], "got none"),
        (["--add", "mine"], "wanted NAME=FILE"),
        (["--add", "RG=some.toml"], "not taken"),
        (["--knob", "detector.mis=0"], r"wanted one of detector\.miss"),
        (["--knob", "detector.miss=-1"], "0 or more"),
        (["--knob", "detector.miss=lots"], "0 or more"),
        (["--set", "map.stable=1"], "map.stable"),
        (["--level", "-0.5"], "level"),
        (["--size", "320"], "320x240"),
        (["--size", "8x8"], "32 pixels"),
        (["--jobs", "0"], "at least 1"),
        (["--frames", "1"], "at least 2"),
        (["--radius", "0"], "above 0"),
        (["--meshes", "no/such/folder"], "no/such/folder"),
    ],
)
def test_a_wrong_option_is_told_before_anything_is_drawn(words, message):
    with pytest.raises(SeoSlamError, match=message):
        jobs_from(parsed("--level", "1", *words))


def test_the_level_is_the_frozen_one(tmp_path):
    with pytest.raises(ConfigError, match="give --level"):
        frozen_level(tmp_path / "detector_level.json")
    (tmp_path / "detector_level.json").write_text(json.dumps({"level": 0.62}))
    assert frozen_level(tmp_path / "detector_level.json") == 0.62
