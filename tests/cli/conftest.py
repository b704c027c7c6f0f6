"""What several tests of the command line need: to run it in this process, and detections of the real recording, made once."""

import sys

import pytest

from seo_slam.backends.recorded_detector import DetectionRecorder
from seo_slam.backends.yolox_detector import YoloxDetector
from seo_slam.cli import app as application
from seo_slam.datasets.tum import TumDataset

FRAMES = 60


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the command line in this process; return its exit status, output and errors."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["seo-slam", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            application.main()
        out, err = capsys.readouterr()
        return ended.value.code or 0, out, err

    return call


@pytest.fixture(scope="session")
def detections_file(shared, tmp_path_factory):
    """Recorded detections of the first 60 frames of the real recording, by the real detector."""
    path = tmp_path_factory.mktemp("detections") / "detections.jsonl"
    detector = YoloxDetector(weights=shared / "models/yolox_nano/yolox_nano.onnx", score=0.25)
    with DetectionRecorder(path) as recorder:
        for frame in TumDataset(shared / "data/tum_fr1_xyz", max_frames=FRAMES):
            recorder.record(frame, detector.detect(frame))
    return path
