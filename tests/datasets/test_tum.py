import json
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_recording import CAMERA, HEIGHT, WIDTH, distances, picture, write_image, write_tum

from seo_slam.camera import Camera
from seo_slam.datasets.camera_files import FREIBURG_CAMERAS, find_camera, known_camera, write_camera_file
from seo_slam.datasets.stamps import associate
from seo_slam.datasets.tum import TumDataset
from seo_slam.errors import ConfigError, DatasetError


def edit_line(path, number, text):
    lines = path.read_text().splitlines()
    lines[number - 1] = text
    path.write_text("\n".join(lines) + "\n")


def test_the_real_recording_pairs_as_published(shared):
    folder = shared / "data/tum_fr1_xyz"
    recording = TumDataset(folder)
    published = [line.split() for line in (folder / "associations.txt").read_text().splitlines()]
    assert [(p.rgb.name, p.depth.name) for p in recording.pairs] == [(r[1][4:], r[3][6:]) for r in published]
    assert recording.camera == FREIBURG_CAMERAS["freiburg1"]
    assert recording.depth_scale == 5000
    assert recording.warnings == ()
    assert recording.groundtruth == folder / "groundtruth.txt"
    assert recording.odometry is None
    assert len(recording.trajectory) == 3000
    frame = recording.frame(100)
    assert frame.timestamp_s == recording.pairs[100].timestamp_s
    raw = cv2.imread(str(recording.pairs[100].depth), cv2.IMREAD_UNCHANGED)
    np.testing.assert_allclose(frame.depth_m, raw / 5000, atol=1e-6)
    assert 0.5 < np.median(frame.depth_m[frame.depth_m > 0]) < 2


def test_a_recording_that_lists_more_than_it_has_says_so_and_goes_on(shared):
    recording = TumDataset(shared / "data/tum_fr1_desk_9frames")
    assert len(recording) == len(list(recording)) == 9
    assert len(recording.missing) == 604 + 586
    assert any("604 of the 613 images in rgb.txt do not exist" in warning for warning in recording.warnings)
    assert any("586 of the 595 images in depth.txt" in warning for warning in recording.warnings)


def test_stride_and_max_frames(shared):
    recording = TumDataset(shared / "data/tum_fr1_xyz", stride=7, max_frames=5)
    assert [pair.index for pair in recording.pairs] == [0, 7, 14, 21, 28]
    assert [frame.index for frame in recording] == [0, 7, 14, 21, 28]
    for bad in ({"stride": 0}, {"max_frames": 0}, {"depth_scale": -1.0}):
        with pytest.raises(ConfigError, match=next(iter(bad))):
            TumDataset(shared / "data/tum_fr1_xyz", **bad)


def test_one_frame_is_in_memory_at_a_time(shared):
    recording = TumDataset(shared / "data/tum_fr1_xyz", max_frames=30)
    next(iter(recording))
    tracemalloc.start()
    for frame in recording:
        del frame
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10e6  # a frame is 2.2 MB


def test_colours_are_red_first_and_depth_is_in_metres(tmp_path):
    write_tum(tmp_path)
    write_image(tmp_path / "rgb/100.000.png", np.full((HEIGHT, WIDTH, 3), (255, 0, 0), dtype=np.uint8))  # blue, for OpenCV
    frame = TumDataset(tmp_path).frame(0)
    assert frame.rgb[0, 0].tolist() == [0, 0, 255]
    assert frame.depth_m.dtype == np.float32
    assert sorted(np.unique(frame.depth_m)) == [1.0, 2.0]
    assert TumDataset(tmp_path, depth_scale=1000).frame(0).depth_m.max() == 10.0


# --- association ---------------------------------------------------------------------------------------------------------


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(0, 400), unique=True, max_size=30), st.lists(st.integers(0, 400), unique=True, max_size=30))
def test_association_is_greedy_nearest_first(first, second):
    a, b = np.sort(first) / 1000.0, np.sort(second) / 1000.0 + 0.0003
    candidates = sorted((abs(x - y), i, j) for i, x in enumerate(a) for j, y in enumerate(b) if abs(x - y) < 0.02)
    taken_a, taken_b, expected = set(), set(), []
    for _, i, j in candidates:
        if i not in taken_a and j not in taken_b:
            taken_a.add(i)
            taken_b.add(j)
            expected.append((i, j))
    pairs = associate(a, b, 0.02)
    gaps = np.sort(np.abs(a[pairs[:, 0]] - b[pairs[:, 1]]))
    np.testing.assert_allclose(gaps, sorted(abs(a[i] - b[j]) for i, j in expected), atol=1e-12)
    assert len(set(pairs[:, 0])) == len(set(pairs[:, 1])) == len(pairs)


def test_no_association_says_how_far_the_nearest_are(tmp_path):
    write_tum(tmp_path)
    lines = [f"{500 + i}.000 depth/{100.005 + 0.1 * i:.3f}.png" for i in range(5)]
    (tmp_path / "depth.txt").write_text("\n".join(lines))
    with pytest.raises(DatasetError, match=r"no colour and depth image within 20 ms.*nearest are 399\.600 s apart"):
        TumDataset(tmp_path)


def test_a_colour_image_without_depth_is_left_out_with_a_warning(tmp_path):
    write_tum(tmp_path)
    edit_line(tmp_path / "depth.txt", 4, "100.250 depth/100.205.png")
    recording = TumDataset(tmp_path)
    assert len(recording) == 4
    assert any("1 of 5 colour images have no depth image within 20 ms" in warning for warning in recording.warnings)
    assert len(TumDataset(tmp_path, max_time_difference_s=0.06)) == 5


# --- bad lists -----------------------------------------------------------------------------------------------------------


def test_missing_folder_and_missing_lists(tmp_path):
    with pytest.raises(DatasetError, match=r"nowhere: no such folder"):
        TumDataset(tmp_path / "nowhere")
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match="is a file, wanted the folder"):
        TumDataset(tmp_path / "file")
    with pytest.raises(DatasetError, match=r"no rgb.txt; wanted the TUM layout.*found file"):
        TumDataset(tmp_path)


@pytest.mark.parametrize(
    ("name", "line", "message"),
    [
        ("rgb.txt", "100.1", r"rgb.txt:3: got 1 columns, wanted 2 \(timestamp filename\)"),
        ("depth.txt", "100.105 depth/100.105.png extra", r"depth.txt:3: got 3 columns"),
        ("rgb.txt", "later rgb/100.100.png", r"rgb.txt:3: 'later' is not a number"),
        ("rgb.txt", "nan rgb/100.100.png", r"rgb.txt:3: got nan"),
        ("rgb.txt", "99.0 rgb/100.100.png", r"rgb.txt:3: the stamp goes backwards"),
        ("depth.txt", "100.005 depth/100.105.png", r"depth.txt:3: the stamp repeats"),
    ],
)
def test_a_bad_line_of_a_list_is_named(tmp_path, name, line, message):
    write_tum(tmp_path)
    edit_line(tmp_path / name, 3, line)
    with pytest.raises(DatasetError, match=message):
        TumDataset(tmp_path)


def test_no_listed_image_exists(tmp_path):
    write_tum(tmp_path)
    for file in (tmp_path / "depth").iterdir():
        file.unlink()
    with pytest.raises(DatasetError, match=r"depth.txt: none of the 5 images it lists exists, for example .*100.005.png"):
        TumDataset(tmp_path)


def test_bad_poses_are_found_at_opening(tmp_path):
    write_tum(tmp_path)
    edit_line(tmp_path / "groundtruth.txt", 5, "100.05 0 0 0 nan 0 0 1")
    with pytest.raises(DatasetError, match=r"groundtruth.txt:5: got nan"):
        TumDataset(tmp_path)


def test_frames_outside_the_poses_are_counted(tmp_path):
    write_tum(tmp_path)
    (tmp_path / "odometry.txt").write_text("100.05 0 0 0 0 0 0 1\n100.35 0 0 0 0 0 0 1\n")
    recording = TumDataset(tmp_path)
    assert len(recording.trajectory) == 2
    assert any("2 of 5 frames lie outside the poses" in warning for warning in recording.warnings)


# --- bad images ----------------------------------------------------------------------------------------------------------


def bad_images(folder):
    """What may be wrong with the third pair: how to break it, and what the error says."""
    rgb, depth = folder / "rgb/100.200.png", folder / "depth/100.205.png"
    return {
        "8-bit depth": (lambda: write_image(depth, (distances(2) // 256).astype(np.uint8)), "100.205.png: got 8-bit depth"),
        "coloured depth": (lambda: write_image(depth, picture(2)), "100.205.png: got 3 channels"),
        "depth of another size": (lambda: write_image(depth, distances(2)[::2]), "100.205.png: is 64x24, wanted 64x48"),
        "colour of another size": (lambda: write_image(rgb, picture(2)[:, :32]), "100.200.png: is 32x48, wanted 64x48"),
        "cut off": (lambda: rgb.write_bytes(rgb.read_bytes()[:-20]), "100.200.png: cut off in the middle"),
        "empty": (lambda: depth.write_bytes(b""), "100.205.png: empty file"),
        "no image": (lambda: depth.write_bytes(b"hello, this is text"), "100.205.png: neither PNG nor JPEG"),
        "cut off header": (lambda: depth.write_bytes(depth.read_bytes()[:20]), "100.205.png: damaged PNG header"),
    }


@pytest.mark.parametrize("what", list(bad_images(Path())))
def test_a_bad_image_is_refused_at_opening_or_left_out_if_asked(tmp_path, what):
    write_tum(tmp_path)
    break_it, message = bad_images(tmp_path)[what]
    break_it()
    with pytest.raises(DatasetError, match=f"frame 2: .*{message}"):
        TumDataset(tmp_path)
    recording = TumDataset(tmp_path, skip_broken=True)
    assert [frame.index for frame in recording] == [0, 1, 3, 4]
    assert any("1 of 5 image pairs are left out as damaged" in warning for warning in recording.warnings)


def test_an_image_damaged_inside_is_named_when_its_frame_comes(tmp_path, capfd):
    write_tum(tmp_path)
    depth = tmp_path / "depth/100.205.png"
    content = bytearray(depth.read_bytes())
    start = content.index(b"IDAT") + 4
    content[start : start + 12] = b"\x00" * 12
    depth.write_bytes(content)
    recording = TumDataset(tmp_path)
    with pytest.raises(DatasetError, match=r"frame 2 \(t=100.200000\): .*100.205.png: the depth image does not decode"):
        list(recording)
    assert [frame.index for frame in TumDataset(tmp_path, skip_broken=True)] == [0, 1, 3, 4]


def test_all_images_bad_is_an_error_even_if_asked_to_skip(tmp_path):
    write_tum(tmp_path, camera=False)
    small = Camera(60.0, 60.0, 15.5, 11.5, 32, 24)
    with pytest.raises(DatasetError, match=r"none of 5 image pairs can be used.*is 64x48, wanted 32x24"):
        TumDataset(tmp_path, camera=small, skip_broken=True)


def test_jpeg_colour_is_read_and_a_cut_one_refused(tmp_path):
    write_tum(tmp_path)
    for file in sorted((tmp_path / "rgb").glob("*.png")):
        write_image(file.with_suffix(".jpg"), cv2.imread(str(file)))
        file.unlink()
    (tmp_path / "rgb.txt").write_text((tmp_path / "rgb.txt").read_text().replace(".png", ".jpg"))
    assert len(list(TumDataset(tmp_path))) == 5
    jpeg = tmp_path / "rgb/100.100.jpg"
    jpeg.write_bytes(jpeg.read_bytes()[:-300])
    with pytest.raises(DatasetError, match=r"frame 1: .*100.100.jpg: cut off"):
        TumDataset(tmp_path)


# --- intrinsics ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "header", "expected"),
    [
        ("rgbd_dataset_freiburg2_desk", "", "freiburg2"),
        ("tum_fr3_office", "", "freiburg3"),
        ("mine", "# file: 'rgbd_dataset_freiburg1_xyz.bag'", "freiburg1"),
        ("from2017", "# color images", None),
        ("afr1", "", None),
    ],
)
def test_known_cameras_are_told_by_name_or_header(tmp_path, name, header, expected):
    folder = tmp_path / name
    folder.mkdir()
    (folder / "rgb.txt").write_text(header + "\n0 a.png\n")
    assert known_camera(folder) == (FREIBURG_CAMERAS[expected] if expected else None)


def test_no_intrinsics_says_what_to_write(tmp_path):
    write_tum(tmp_path, camera=False)
    with pytest.raises(DatasetError, match=r'no intrinsics.*Write .*camera.json.*\{"fx": 525.0'):
        TumDataset(tmp_path)


def test_a_camera_file_wins_over_the_folder_and_that_over_known_ones(tmp_path):
    folder = tmp_path / "rgbd_dataset_freiburg1_tiny"
    write_tum(folder)
    assert TumDataset(folder).camera.fx == 60.0
    write_camera_file(tmp_path / "other.json", Camera(70.0, 70.0, 31.5, 23.5, WIDTH, HEIGHT, (0.1, 0, 0, 0, 0)), 2500.0)
    recording = TumDataset(folder, camera_file=tmp_path / "other.json")
    assert (recording.camera.fx, recording.camera.distortion[0], recording.depth_scale) == (70.0, 0.1, 2500.0)
    given = TumDataset(folder, camera=Camera(80.0, 80.0, 31.5, 23.5, WIDTH, HEIGHT))
    assert (given.camera.fx, given.depth_scale) == (80.0, 5000.0)
    (folder / "camera.json").unlink()
    with pytest.raises(DatasetError, match=r"is 64x48, wanted 640x480, the camera's \(published TUM intrinsics\)"):
        TumDataset(folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "camera.json:1: not JSON"),
        ("[]", "camera.json: file: "),
        (json.dumps({**CAMERA, "fz": 1}), "fz: Extra inputs"),
        (json.dumps({k: v for k, v in CAMERA.items() if k != "cx"}), "cx: Field required"),
        (json.dumps({**CAMERA, "fx": -1}), "fx: .*greater than 0"),
        (json.dumps({**CAMERA, "distortion": [1, 2]}), "distortion: .*2 terms"),
        (json.dumps({**CAMERA, "cy": "middle"}), "cy: "),
        (json.dumps({**CAMERA, "cy": float("nan")}), "cy: .*finite number"),
    ],
)
def test_a_bad_camera_file_is_refused(tmp_path, text, message):
    (tmp_path / "camera.json").write_text(text)
    with pytest.raises(DatasetError, match=message):
        find_camera(tmp_path)


def test_a_camera_file_with_four_distortion_terms_or_none(tmp_path):
    for terms, expected in (([0.1, 0.2, 0.3, 0.4], (0.1, 0.2, 0.3, 0.4, 0.0)), ([], (0.0,) * 5)):
        (tmp_path / "camera.json").write_text(json.dumps({**CAMERA, "distortion": terms}))
        assert find_camera(tmp_path)[0].distortion == expected
