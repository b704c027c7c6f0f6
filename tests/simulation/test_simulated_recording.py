"""The simulated desk as a recording: truth, files, bytes."""

import hashlib
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from seo_slam.errors import ConfigError, DatasetError
from seo_slam.simulation.recording import SimulatedDesk


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.rglob("*")) if path.is_file()
    }


def small(seed: int = 0, level: float = 0.5) -> SimulatedDesk:
    return SimulatedDesk(seed=seed, frames=3, width=96, height=72, level=level)


def test_same_seed_same_bytes(tmp_path: Path) -> None:
    small().write(tmp_path / "a")
    small().write(tmp_path / "b")
    small(seed=1).write(tmp_path / "c")
    first = digests(tmp_path / "a")
    assert first == digests(tmp_path / "b")
    assert len(first) == 2 * 3 + 8
    assert all(
        first[name] != digest
        for name, digest in digests(tmp_path / "c").items()
        if not name.endswith(("camera.json", "rgb.txt", "depth.txt"))
    )


def test_files_hold_what_the_frames_held(tmp_path: Path) -> None:
    desk = small()
    folder = desk.write(tmp_path / "desk")
    lines = [json.loads(line) for line in (folder / "detections.jsonl").read_text().splitlines()]
    stamps = [row.split() for row in (folder / "rgb.txt").read_text().splitlines() if not row.startswith("#")]
    scale = json.loads((folder / "camera.json").read_text())["depth_scale"]
    for frame, line, (stamp, name) in zip(small(), lines, stamps, strict=True):
        assert float(stamp) == line["timestamp_s"] == frame.timestamp_s
        assert (cv2.imread(str(folder / name))[:, :, ::-1] == frame.rgb).all()
        depth = cv2.imread(str(folder / "depth" / f"{stamp}.png"), cv2.IMREAD_UNCHANGED)
        assert depth.dtype == np.uint16
        assert ((depth / scale).astype(np.float32) == frame.depth_m).all()
        detections = desk.detector.detect(frame)
        assert line["boxes_px"] == detections.boxes_px.tolist()
        assert line["labels"] == list(detections.labels)
    assert json.loads((folder / "truth.json").read_text()) == desk.truth


@pytest.mark.parametrize("name", ["groundtruth.txt", "odometry.txt"])
def test_trajectories_are_written_in_tum_order(tmp_path: Path, name: str) -> None:
    from seo_slam.geometry import rotation_from_quaternion

    desk = small(level=1.0)
    folder = desk.write(tmp_path / "desk")
    expected = desk.trajectory if name == "groundtruth.txt" else desk.odometry
    rows = np.loadtxt(folder / name)
    assert rows.shape == (3, 8)
    for row, T in zip(rows, expected.T_world_camera, strict=True):
        assert row[1:4] == pytest.approx(T[:3, 3], abs=1e-8)
        x, y, z, w = row[4:]
        assert np.allclose(rotation_from_quaternion([w, x, y, z]), T[:3, :3], atol=1e-7)


def test_truth_names_every_thing_with_both_centres() -> None:
    desk = small()
    assert set(desk.truth) == {"objects", "timeline"}
    assert desk.truth["timeline"] == []
    assert len(desk.truth["objects"]) == 15
    for entry in desk.truth["objects"]:
        low, high, centre = (np.array(entry[key]) for key in ("aabb_min", "aabb_max", "center"))
        assert entry["label"] in entry["accepted_labels"]
        assert np.allclose(centre, (low + high) / 2, atol=2e-6)
        surface = np.array(entry["surface_center"])
        assert (surface >= low - 1e-5).all()
        assert (surface <= high + 1e-5).all()
    json.dumps(desk.truth)


def test_every_thing_is_in_view_at_some_time() -> None:
    for seed in range(3):
        desk = SimulatedDesk(seed=seed, frames=6, width=160, height=120, level=0.0)
        seen = {label for frame in desk for label in desk.detector.detect(frame).labels}
        assert seen == {thing.label for thing in desk.world.things}


def test_frames_are_stamped_at_15_hz() -> None:
    frames = list(small())
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert [frame.timestamp_s for frame in frames] == pytest.approx([0, 1 / 15, 2 / 15], abs=1e-6)


def test_refuses_a_folder_with_content(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(DatasetError, match="wanted a new or empty folder"):
        small().write(tmp_path)
    with pytest.raises(DatasetError, match="wanted a new or empty folder"):
        small().write(tmp_path / "mine.txt")


@pytest.mark.parametrize(("options", "message"), [({"frames": 1}, "frames"), ({"width": 8}, "image size"), ({"level": -1.0}, "level")])
def test_bad_arguments(options: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        SimulatedDesk(**options)
