"""What a written recording gives back: the detector's own words, bit for bit; the same bytes in every process; clear refusals."""

import errno
import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from seo_slam.backends.recorded_detector import RecordedDetector
from seo_slam.datasets.tum import TumDataset
from seo_slam.errors import DatasetError
from seo_slam.simulation import writing
from seo_slam.simulation.detector import DetectorKnobs
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.simulation.writing import write_recording

SCRIPT = """
import sys
from seo_slam.simulation.recording import SimulatedDesk
SimulatedDesk(seed=5, frames=3, width=96, height=72, level=1.0).write(sys.argv[1])
"""


def small() -> SimulatedDesk:
    return SimulatedDesk(seed=5, frames=3, width=96, height=72, level=1.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small().write(tmp_path_factory.mktemp("written") / "desk")


@pytest.mark.parametrize("knobs", [DetectorKnobs(), DetectorKnobs.at_level(1.0), DetectorKnobs(miss=1.0)])
def test_recorded_detections_are_what_the_simulated_detector_said(tmp_path: Path, knobs: DetectorKnobs) -> None:
    desk = SimulatedDesk(seed=2, frames=4, width=160, height=120)
    desk.detector_knobs = knobs
    replayed = RecordedDetector(desk.write(tmp_path / "desk") / "detections.jsonl")
    frames = TumDataset(tmp_path / "desk")
    assert len(frames) == len(desk) == len(replayed)
    for frame in frames:
        told, said = replayed.detect(frame), desk.detector.detect(frame)
        assert told.labels == said.labels
        assert (told.boxes_px == said.boxes_px).all()
        assert (told.scores == said.scores).all()
        assert told.masks is not None
        assert said.masks is not None
        assert told.masks.shape == said.masks.shape
        assert (told.masks == said.masks).all()
        assert said.masks.any(axis=(1, 2)).all()
        assert bool(len(said)) == (knobs.miss < 1)


def test_a_recording_replays_the_odometry_and_not_the_truth(folder: Path) -> None:
    desk, replayed = small(), TumDataset(folder).trajectory
    assert replayed is not None
    assert np.allclose(replayed.T_world_camera, desk.odometry.T_world_camera, atol=1e-6)
    assert not np.allclose(replayed.T_world_camera[-1], desk.trajectory.T_world_camera[-1], atol=1e-4)


def test_two_processes_write_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    hashed = {**os.environ, "PYTHONHASHSEED": "77"}
    subprocess.run([sys.executable, "-c", SCRIPT, tmp_path / "other"], env=hashed, check=True, timeout=120)
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    assert files == sorted(path.relative_to(tmp_path / "other") for path in (tmp_path / "other").rglob("*") if path.is_file())
    for file in files:
        assert (folder / file).read_bytes() == (tmp_path / "other" / file).read_bytes(), file


def test_the_manifest_says_what_was_made_and_nothing_of_this_machine(folder: Path) -> None:
    text = (folder / "simulation.json").read_text()
    manifest = json.loads(text)
    assert manifest["seed"] == 5
    assert (manifest["level"], manifest["frames"], manifest["width"], manifest["height"]) == (1.0, 3, 96, 72)
    assert manifest["renderer"] == "primitive"
    assert manifest["detector"]["merge"] == 0.35
    assert manifest["sensor"]["drift_m"] == 0.012
    assert manifest["look_alikes"]["hammer"] == ["tool"]
    assert [row["id"] for row in manifest["things"]] == list(range(1, 16))
    assert {"label": "desk"} in manifest["structure"]
    assert manifest["models"] == {}
    assert manifest["packages"]["seo-slam"] == version("seo-slam")
    assert manifest["packages"]["numpy"] == np.__version__
    assert str(folder) not in text
    assert str(Path.home()) not in text


def test_a_full_disk_is_one_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, content: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self))

    monkeypatch.setattr(writing.Path, "write_bytes", full)
    with pytest.raises(DatasetError, match=r"rgb/0.000000.png: the recording cannot be written: No space left on device"):
        small().write(tmp_path / "desk")


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("precious")
    with pytest.raises(DatasetError, match="cannot be"):
        small().write(tmp_path / "file" / "desk")
    assert (tmp_path / "file").read_text() == "precious"


def test_frames_are_written_one_by_one(tmp_path: Path) -> None:
    desk, written = small(), []

    def watched():
        for frame in desk:
            yield frame
            written.append(len(list((tmp_path / "desk" / "rgb").iterdir())))

    write_recording(desk, tmp_path / "desk", watched())
    assert written == [1, 2, 3]
