import json

import cv2
import numpy as np
import pytest
from small_recording import CAMERA, distances, picture, write_folder, write_image, write_tum

from seo_slam.camera import Camera
from seo_slam.datasets.alignment import measure_alignment
from seo_slam.datasets.camera_files import FREIBURG_CAMERAS, write_camera_file
from seo_slam.datasets.check_camera import check_camera
from seo_slam.datasets.check_images import check_depth
from seo_slam.datasets.checks import check_recording
from seo_slam.datasets.trajectory_files import read_trajectory, write_trajectory
from seo_slam.datasets.tum import TumDataset
from seo_slam.errors import ConfigError
from seo_slam.geometry import inverse
from seo_slam.records import Trajectory
from seo_slam.types import Frame


def found(report, level, topic=None):
    return [f"{f.what} -> {f.fix}" for f in report.findings if f.level == level and topic in (None, f.topic)]


@pytest.fixture
def real(shared, tmp_path):
    """A copy of some 80 frames of the real recording, images as links, to be broken."""
    source, folder = shared / "data/tum_fr1_xyz", tmp_path / "tum_fr1_copy"
    folder.mkdir()
    for name in ("rgb", "depth"):
        (folder / name).symlink_to(source / name)
        lines = (source / f"{name}.txt").read_text().splitlines()
        (folder / f"{name}.txt").write_text("\n".join(lines[:120]) + "\n")
    (folder / "groundtruth.txt").write_text((source / "groundtruth.txt").read_text())
    return folder


def change_poses(folder, change, seconds=0.0):
    trajectory = read_trajectory(folder / "groundtruth.txt")
    poses = np.array([change(T) for T in trajectory.T_world_camera])
    write_trajectory(folder / "groundtruth.txt", Trajectory(trajectory.timestamps_s + seconds, poses))


# --- sane recordings -----------------------------------------------------------------------------------------------------


def test_the_real_recording_is_sane(shared):
    report = check_recording(shared / "data/tum_fr1_xyz")
    assert (report.kind, report.level) == ("tum", "ok"), report.findings
    assert report.facts["frames"] == 397
    assert report.facts["frames_with_pose"] == 397
    assert report.facts["image_size_px"] == "640x480"
    assert 14 < report.facts["rate_hz"] < 15.5
    assert 0.8 < report.facts["median_depth_m"] < 1.2
    assert abs(report.facts["alignment_shift_x_px"]) <= 4
    assert report.facts["poses_explain_depth_share"] > 0.6
    json.loads(report.model_dump_json())


def test_the_recording_with_missing_files_is_warned_of_and_no_more(shared):
    report = check_recording(shared / "data/tum_fr1_desk_9frames")
    assert report.level == "warning"
    assert report.facts["missing_files"] == 1190
    assert all("do not exist" in what for what in found(report, "warning"))


def test_small_recordings_of_both_kinds(tmp_path):
    assert check_recording(write_tum(tmp_path / "t")).level == "ok"
    report = check_recording(write_folder(tmp_path / "f"))
    assert report.kind == "folder"
    assert [what for what in found(report, "warning") if "30 images a second" not in what] == []


# --- broken recordings ---------------------------------------------------------------------------------------------------


def test_what_is_no_recording(tmp_path):
    assert "no such folder" in found(check_recording(tmp_path / "nowhere"), "error", "layout")[0]
    assert "found nothing" in found(check_recording(tmp_path), "error", "layout")[0]
    with pytest.raises(ConfigError, match="unknown kind of recording 'bag'"):
        check_recording(tmp_path, "bag")


def test_every_fault_is_reported_not_only_the_first(tmp_path):
    write_tum(tmp_path)
    (tmp_path / "rgb.txt").write_text("100.0 rgb/100.000.png\n99.0 rgb/100.100.png\n")
    (tmp_path / "depth.txt").write_text("100.0\n")
    (tmp_path / "groundtruth.txt").write_text("100 0 0 0 0 0 0 5\n")
    (tmp_path / "camera.json").write_text(json.dumps({**CAMERA, "fz": 3}))
    errors = found(check_recording(tmp_path), "error")
    for part in ("rgb.txt:2: the stamp goes backwards", "depth.txt:1: got 1 columns", "groundtruth.txt:1: quaternion", "fz: Extra"):
        assert sum(part in what for what in errors) == 1, (part, errors)


def test_bad_images_are_all_counted_and_the_rest_is_still_checked(tmp_path):
    write_tum(tmp_path)
    write_image(tmp_path / "depth/100.105.png", (distances(1) // 256).astype(np.uint8))
    (tmp_path / "rgb/100.200.png").write_bytes(b"")
    write_image(tmp_path / "rgb/100.300.png", picture(3)[:30])
    report = check_recording(tmp_path)
    (what,) = found(report, "error")
    assert what.startswith("3 of 5 pairs cannot be used")
    assert all(part in what for part in ("8-bit depth", "empty file", "is 64x30, wanted 64x48"))
    assert report.facts["median_depth_m"] == 2.0


def test_no_intrinsics_does_not_stop_the_other_checks(tmp_path):
    report = check_recording(write_tum(tmp_path, camera=False))
    (what,) = found(report, "error")
    assert "no intrinsics" in what
    assert report.facts["frames_with_pose"] == 5
    assert report.facts["median_depth_m"] == 2.0
    write_camera_file(tmp_path / "other.json", Camera(60.0, 60.0, 31.5, 23.5, 64, 48), 5000.0)
    assert check_recording(tmp_path, camera_file=tmp_path / "other.json").level == "ok"


def test_streams_on_different_clocks(tmp_path):
    write_tum(tmp_path)
    (tmp_path / "depth.txt").write_text("".join(f"{7 + 0.1 * i:.3f} depth/{100.005 + 0.1 * i:.3f}.png\n" for i in range(5)))
    assert "nearest are 92.600 s apart" in found(check_recording(tmp_path), "error", "images")[0]


def test_gaps_in_time(tmp_path):
    write_tum(tmp_path, frames=12)
    for name in ("rgb", "depth"):
        lines = (tmp_path / f"{name}.txt").read_text().splitlines()
        (tmp_path / f"{name}.txt").write_text("\n".join(lines[:4] + lines[11:]) + "\n")
    assert "1 gaps in time, the longest 0.80 s after frame 2" in found(check_recording(tmp_path), "warning", "stamps")[0]


@pytest.mark.parametrize(
    ("factor", "offset", "words"),
    [(1e9, 0, "write the pose stamps in seconds, not nano"), (1e3, 0, "not milliseconds"), (1, 5000, "images and poses need one clock")],
)
def test_poses_on_another_clock(tmp_path, factor, offset, words):
    write_tum(tmp_path)
    trajectory = read_trajectory(tmp_path / "groundtruth.txt")
    moved = Trajectory(trajectory.timestamps_s * factor + offset, trajectory.T_world_camera)
    write_trajectory(tmp_path / "groundtruth.txt", moved)
    (what,) = found(check_recording(tmp_path), "error")
    assert "no frame has a pose" in what
    assert words in what


def test_poses_that_cover_a_part_and_jump(tmp_path):
    write_tum(tmp_path, frames=20)
    rows = [f"{100 + 0.05 * k:.3f} {0.0 if k < 12 else 2.0} 0 0 0 0 0 1" for k in range(21)]
    (tmp_path / "odometry.txt").write_text("\n".join(rows) + "\n")
    warnings = found(check_recording(tmp_path), "warning", "poses")
    assert any("9 of 20 frames have no pose" in what for what in warnings)
    assert any("1 jumps: 2.00 m and 0 degrees in 0.100 s at frame 6" in what for what in warnings)


# --- intrinsics ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera", FREIBURG_CAMERAS.values(), ids=FREIBURG_CAMERAS)
def test_real_intrinsics_are_plausible(camera):
    assert [f.level for f in check_camera(camera, "here", (640, 480))] == ["ok"]


@pytest.mark.parametrize(
    ("camera", "level", "words"),
    [
        (Camera(300.0, 300.0, 160.0, 120.0, 320, 240), "error", "multiply fx, fy, cx and cy by 2"),
        (Camera(1000.0, 1000.0, 640.0, 360.0, 640, 480), "error", "intrinsics of 1280x720"),
        (Camera(260.0, 260.0, 160.0, 120.0, 640, 480), "warning", "intrinsics of 320x240 images: multiply fx, fy, cx and cy by 2"),
        (Camera(500.0, 500.0, 320.0, 400.0, 640, 480), "warning", "far from the middle"),
        (Camera(50.0, 50.0, 320.0, 240.0, 640, 480), "warning", "field of view of 162 degrees"),
        (Camera(500.0, 650.0, 320.0, 240.0, 640, 480), "warning", "differ by more than 7 %"),
        (Camera(300.0, 300.0, 320.0, 240.0, 640, 480, (-0.4, 0, 0, 0, 0)), "warning", "cannot be undone"),
    ],
)
def test_wrong_intrinsics(camera, level, words):
    findings = check_camera(camera, "camera.json", (640, 480))
    assert any(f.level == level and words in f.what + f.fix for f in findings), findings


# --- depth unit ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stated", "words"),
    [(1000.0, "Kinect with depth_scale 5000"), (25000.0, "Kinect with depth_scale 5000")],
)
def test_a_wrong_depth_scale_shows_without_poses(shared, stated, words):
    recording = TumDataset(shared / "data/tum_fr1_desk_9frames", depth_scale=stated)
    findings = check_depth(list(recording), stated, {})
    assert findings[0].level == "warning"
    assert words in findings[0].what + findings[0].fix


def test_depth_that_is_absent_or_in_millimetres():
    camera = Camera(60.0, 60.0, 31.5, 23.5, 64, 48)

    def frame(depth):
        return Frame(0.0, picture(0), depth.astype(np.float32), camera)

    assert check_depth([frame(np.zeros((48, 64)))], 1000.0, {})[0].level == "error"
    millimetres = check_depth([frame(np.full((48, 64), 1500.0))], None, {})
    assert (millimetres[0].level, "millimetres" in millimetres[0].fix) == ("error", True)
    sparse = np.where(np.random.default_rng(0).random((48, 64)) < 0.2, 1.5, 0.0)
    assert "% of the pixels have no depth" in check_depth([frame(sparse)], 1000.0, {})[0].what


@pytest.mark.parametrize(("metres", "words"), [(20.0, "farther than RGB-D"), (0.2, "nearer than RGB-D")])
def test_depth_no_camera_sees(metres, words):
    frame = Frame(0.0, picture(0), np.full((48, 64), metres, dtype=np.float32), Camera(60.0, 60.0, 31.5, 23.5, 64, 48))
    (finding,) = check_depth([frame], 1000.0, {})
    assert words in finding.what
    assert "would put it at" in finding.fix


@pytest.mark.parametrize("scale", [1000.0, 25000.0])
def test_poses_tell_the_depth_scale(real, scale):
    write_camera_file(real / "camera.json", FREIBURG_CAMERAS["freiburg1"], scale)
    errors = found(check_recording(real), "error", "depth")
    assert len(errors) == 1
    assert errors[0].endswith("set depth_scale to 5000")


# --- poses and depth -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [(inverse, "T_camera_world"), (lambda T: T @ np.diag([1.0, -1.0, -1.0, 1.0]), "axes of OpenGL")],
    ids=["inverted", "opengl"],
)
def test_poses_in_another_convention_are_recognised(real, change, words):
    change_poses(real, change)
    (what,) = found(check_recording(real), "error")
    assert words in what


def test_poses_that_explain_nothing_are_warned_of(real):
    change_poses(real, lambda T: T, seconds=2.0)
    assert any("within" not in what and "of the depth" in what for what in found(check_recording(real), "warning", "poses"))


# --- alignment -----------------------------------------------------------------------------------------------------------


def shifted(depth_m, x, y):
    return np.roll(depth_m, (y, x), (0, 1))


def zoomed(depth_m, factor):
    h, w = depth_m.shape
    return cv2.warpAffine(depth_m, cv2.getRotationMatrix2D((w / 2, h / 2), 0, factor), (w, h), flags=cv2.INTER_NEAREST)


@pytest.fixture(scope="module")
def images(shared):
    return [(f.rgb, f.depth_m) for f in TumDataset(shared / "data/tum_fr1_xyz", stride=40)]


@pytest.mark.parametrize(("x", "y"), [(0, 0), (20, 0), (-12, 16), (30, -24)])
def test_a_shift_of_depth_is_measured(images, x, y):
    found = measure_alignment([(rgb, shifted(depth_m, x, y)) for rgb, depth_m in images])
    np.testing.assert_allclose(found.shift_px, (-x, -4 - y), atol=4)  # this recording is off by 4 px as published
    assert found.strength > 0.3
    assert found.zoom == 1.0


@pytest.mark.parametrize(("factor", "undo"), [(0.9, 1.1), (1.1, 0.9), (0.82, 1.2)])
def test_another_field_of_view_is_measured(images, factor, undo):
    found = measure_alignment([(rgb, zoomed(depth_m, factor)) for rgb, depth_m in images])
    assert found.zoom == undo
    assert found.strength_zoomed > 1.15 * found.strength


def test_depth_of_other_frames_or_mirrored_fits_nowhere(images):
    mixed = measure_alignment([(images[i][0], images[i - 3][1]) for i in range(len(images))])
    mirrored = measure_alignment([(rgb, np.ascontiguousarray(depth_m[:, ::-1])) for rgb, depth_m in images])
    for found in (mixed, mirrored):
        assert max(found.strength, found.strength_zoomed) < 0.2


def test_flat_depth_says_nothing(images):
    assert measure_alignment([(rgb, np.ones_like(depth_m)) for rgb, depth_m in images]) is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: shifted(d, 24, 0), "moved by (-2"),
        (lambda d: zoomed(d, 0.9), "scaled by 1.1"),
        (lambda d: np.ascontiguousarray(d[:, ::-1]), "do not lie on colour edges"),
    ],
    ids=["shift", "zoom", "mirror"],
)
def test_bad_registration_is_warned_of(real, change, words):
    (real / "depth").rename(real / "links")
    for line in (real / "depth.txt").read_text().splitlines():
        if not line.startswith("#"):
            name = line.split()[1].removeprefix("depth/")
            write_image(real / "depth" / name, change(cv2.imread(str(real / "links" / name), cv2.IMREAD_UNCHANGED)))
    (what,) = found(check_recording(real), "warning", "alignment")
    assert words in what
