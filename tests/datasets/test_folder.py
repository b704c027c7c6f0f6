import shutil

import numpy as np
import pytest
from small_recording import CAMERA, distances, picture, write_folder, write_image, write_tum

from seo_slam.datasets.folder import FolderDataset
from seo_slam.datasets.open import detect_kind, open_dataset
from seo_slam.datasets.tum import TumDataset
from seo_slam.errors import ConfigError, DatasetError


def matrix(x):
    T = np.eye(4)
    T[0, 3] = x
    return T


def test_numbered_images_are_paired_and_stamped_by_rate(tmp_path):
    write_folder(tmp_path)
    recording = FolderDataset(tmp_path)
    np.testing.assert_allclose([p.timestamp_s for p in recording.pairs], np.arange(5) / 30)
    assert any("30 images a second" in warning for warning in recording.warnings)
    np.testing.assert_allclose([p.timestamp_s for p in FolderDataset(tmp_path, fps=10).pairs], np.arange(5) / 10)
    assert FolderDataset(tmp_path, fps=10).warnings == ()
    frame = recording.frame(2)
    assert (frame.depth_m[20, 15], frame.depth_m[0, 0]) == (1.0, 2.0)
    assert recording.trajectory is None


def test_numbers_are_ordered_as_numbers_and_gaps_keep_their_time(tmp_path):
    for i in (2, 10, 9):
        write_image(tmp_path / f"color/{i}.jpg", picture(i))
        write_image(tmp_path / f"depth/{i}.png", distances(i))
    write_folder(tmp_path / "x")
    shutil.copy(tmp_path / "x/camera.json", tmp_path)
    recording = FolderDataset(tmp_path, fps=10)
    assert [p.rgb.name for p in recording.pairs] == ["2.jpg", "9.jpg", "10.jpg"]
    np.testing.assert_allclose([p.timestamp_s for p in recording.pairs], [0, 0.7, 0.8])


def test_stamps_come_from_a_file(tmp_path):
    write_folder(tmp_path)
    stamps = tmp_path / "timestamps.txt"
    stamps.write_text("5.0\n5.1\n5.3\n5.4\n5.5\n")
    assert [p.timestamp_s for p in FolderDataset(tmp_path).pairs] == [5.0, 5.1, 5.3, 5.4, 5.5]
    stamps.write_text("5.0\n5.1\n")
    with pytest.raises(DatasetError, match=r"timestamps.txt: holds 2 stamps, wanted 5"):
        FolderDataset(tmp_path)
    stamps.write_text("5.0\n5.1\n5.1\n5.4\n5.5\n")
    with pytest.raises(DatasetError, match=r"timestamps.txt:3: the stamp repeats or goes backwards"):
        FolderDataset(tmp_path)


@pytest.mark.parametrize(("unit", "digits"), [(1e3, 13), (1e6, 16), (1e9, 19)])
def test_names_that_are_stamps_in_small_units(tmp_path, unit, digits):
    start = 1_700_000_000
    for i in range(3):
        write_image(tmp_path / f"rgb/{int((start + i) * unit):0{digits}d}.png", picture(i))
        write_image(tmp_path / f"depth/{int((start + i) * unit + 0.01 * unit):0{digits}d}.png", distances(i))
    write_folder(tmp_path / "x")
    shutil.copy(tmp_path / "x/camera.json", tmp_path)
    recording = FolderDataset(tmp_path)
    np.testing.assert_allclose([p.timestamp_s for p in recording.pairs], [start, start + 1, start + 2], atol=1e-6)


def test_a_tum_recording_without_its_lists_reads_the_same(tmp_path):
    write_tum(tmp_path)
    listed = list(TumDataset(tmp_path))
    for name in ("rgb.txt", "depth.txt"):
        (tmp_path / name).unlink()
    plain = list(open_dataset("auto", tmp_path))
    assert [f.timestamp_s for f in plain] == [f.timestamp_s for f in listed]
    assert all((a.rgb == b.rgb).all() and (a.depth_m == b.depth_m).all() for a, b in zip(plain, listed, strict=True))


def test_poses_one_file_a_frame_or_one_row_a_frame(tmp_path):
    write_folder(tmp_path)
    (tmp_path / "pose").mkdir()
    for i in (0, 1, 3, 4):
        np.savetxt(tmp_path / f"pose/frame{i:04d}.txt", matrix(i))
    trajectory = FolderDataset(tmp_path, fps=10).trajectory
    np.testing.assert_allclose(trajectory.timestamps_s, [0, 0.1, 0.3, 0.4])
    np.testing.assert_allclose(trajectory.T_world_camera[:, 0, 3], [0, 1, 3, 4])
    shutil.rmtree(tmp_path / "pose")
    for columns in (16, 12):
        np.savetxt(tmp_path / "poses.txt", [matrix(i).ravel()[:columns] for i in range(5)])
        np.testing.assert_allclose(FolderDataset(tmp_path).trajectory.T_world_camera[:, 0, 3], np.arange(5))
    (tmp_path / "groundtruth.txt").write_text("0 7 0 0 0 0 0 1\n1 7 0 0 0 0 0 1\n")
    assert FolderDataset(tmp_path).trajectory.T_world_camera[0, 0, 3] == 7


def test_bad_poses_are_named(tmp_path):
    write_folder(tmp_path)
    poses = tmp_path / "poses.txt"
    np.savetxt(poses, [matrix(i).ravel() for i in range(4)])
    with pytest.raises(DatasetError, match=r"poses.txt: holds 4 poses, wanted 5"):
        FolderDataset(tmp_path)
    np.savetxt(poses, [(matrix(i) * (1 if i < 3 else 1.1)).ravel() for i in range(5)])
    with pytest.raises(DatasetError, match=r"poses.txt:4: .*not a rigid transform"):
        FolderDataset(tmp_path)
    poses.write_text("1 0 0 0 0 0 0 1\n")
    with pytest.raises(DatasetError, match=r"poses.txt:1: got 8 columns, wanted 16 or 12"):
        FolderDataset(tmp_path)
    poses.unlink()
    (tmp_path / "poses").mkdir()
    with pytest.raises(DatasetError, match="holds no pose file"):
        FolderDataset(tmp_path)
    np.savetxt(tmp_path / "poses/0002.txt", matrix(1)[:3])
    with pytest.raises(DatasetError, match=r"0002.txt: got 3 rows"):
        FolderDataset(tmp_path)
    np.savetxt(tmp_path / "poses/0002.txt", np.full((4, 4), -np.inf))
    with pytest.raises(DatasetError, match=r"0002.txt:1: got -inf"):
        FolderDataset(tmp_path)


def test_depth_as_npy(tmp_path):
    write_folder(tmp_path)
    shutil.rmtree(tmp_path / "depth")
    (tmp_path / "depth").mkdir()
    for i in range(5):
        metres = (distances(i) / 5000).astype(np.float32)
        metres[0, :3] = [np.nan, np.inf, 0]
        np.save(tmp_path / f"depth/{i}.npy", metres)
    frame = FolderDataset(tmp_path).frame(0)
    assert frame.depth_m[0, :4].tolist() == [0, 0, 0, 2]
    np.save(tmp_path / "depth/1.npy", -np.ones((48, 64), dtype=np.float32))
    with pytest.raises(DatasetError, match=r"frame 1 .*1.npy: holds negative depth \(-1 m\)"):
        list(FolderDataset(tmp_path))
    np.save(tmp_path / "depth/1.npy", distances(1))
    assert FolderDataset(tmp_path).frame(1).depth_m.max() == 2.0
    np.save(tmp_path / "depth/1.npy", distances(1).astype(np.uint8))
    with pytest.raises(DatasetError, match=r"1.npy: got 8-bit depth"):
        FolderDataset(tmp_path)
    np.save(tmp_path / "depth/1.npy", np.zeros((48, 64, 2), dtype=np.float32))
    with pytest.raises(DatasetError, match=r"1.npy: got an array of shape \(48, 64, 2\)"):
        FolderDataset(tmp_path)
    (tmp_path / "depth/1.npy").write_bytes((tmp_path / "depth/2.npy").read_bytes()[:500])
    with pytest.raises(DatasetError, match=r"1.npy: not a .npy array, or cut off"):
        FolderDataset(tmp_path)


def test_integer_depth_without_a_scale_is_refused(tmp_path):
    write_folder(tmp_path)
    text = (tmp_path / "camera.json").read_text()
    (tmp_path / "camera.json").write_text(text.replace(f', "depth_scale": {CAMERA["depth_scale"]}', ""))
    with pytest.raises(DatasetError, match=r"no depth_scale: write it into camera.json"):
        FolderDataset(tmp_path)
    assert FolderDataset(tmp_path, depth_scale=5000).frame(0).depth_m.max() == 2.0


def test_what_is_missing_is_named(tmp_path):
    write_folder(tmp_path)
    with pytest.raises(ConfigError, match="fps: got 0"):
        FolderDataset(tmp_path, fps=0)
    (tmp_path / "rgb/cover.png").write_bytes((tmp_path / "rgb/frame0000.png").read_bytes())
    with pytest.raises(DatasetError, match=r"cover.png: its name holds no number"):
        FolderDataset(tmp_path)
    (tmp_path / "rgb/cover.png").rename(tmp_path / "rgb/left0001.png")
    with pytest.raises(DatasetError, match="has the same number or stamp as"):
        FolderDataset(tmp_path)
    (tmp_path / "rgb/left0001.png").unlink()
    (tmp_path / "depth/frame0003.png").unlink()
    assert any("1 of 5 colour images have no depth image" in w for w in FolderDataset(tmp_path).warnings)
    for file in (tmp_path / "depth").iterdir():
        file.rename(file.with_name(file.name.replace("frame0", "frame1")))
    with pytest.raises(DatasetError, match=r"no colour and depth image with the same number \(colour 0000..0004, depth 1000..1004\)"):
        FolderDataset(tmp_path)
    for file in (tmp_path / "depth").iterdir():
        file.unlink()
    with pytest.raises(DatasetError, match="depth: holds no images"):
        FolderDataset(tmp_path)
    (tmp_path / "depth").rmdir()
    with pytest.raises(DatasetError, match=r"no folder depth/ or depths/; found camera.json, rgb/"):
        FolderDataset(tmp_path)


def test_kinds_are_told_apart(tmp_path):
    write_tum(tmp_path / "t")
    write_folder(tmp_path / "f")
    assert detect_kind(tmp_path / "t") == open_dataset("auto", tmp_path / "t").kind == "tum"
    assert detect_kind(tmp_path / "f") == open_dataset("auto", tmp_path / "f", fps=None).kind == "folder"
    assert open_dataset("folder", tmp_path / "t").kind == "folder"
    with pytest.raises(DatasetError, match=r"not a recording of a known layout: found f/, t/; wanted rgb.txt and depth.txt"):
        open_dataset("auto", tmp_path)


def test_misspelt_kinds_and_options_name_the_nearest(tmp_path):
    write_tum(tmp_path)
    with pytest.raises(ConfigError, match="unknown kind of recording 'tmu'; did you mean 'tum'"):
        open_dataset("tmu", tmp_path)
    with pytest.raises(ConfigError, match="no option 'strid'; did you mean 'stride'"):
        open_dataset("tum", tmp_path, strid=2)
    with pytest.raises(ConfigError, match="no option 'fps'"):
        open_dataset("tum", tmp_path, fps=30)
