"""The scene cloud in the background: never in the way, never fatal, gone when closed."""

import threading

import numpy as np
import pytest

from seo_slam.abstraction.scene_cloud import SceneCloud
from seo_slam.abstraction.scene_thread import THREAD_NAME, SceneCloudThread
from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.settings.planning import LayoutSettings

CAMERA = Camera(60.0, 60.0, 39.5, 29.5, 80, 60)
SETTINGS = {"move_m": 0.25, "turn_deg": 10.0, "new_share": 0.0}
DEPTH = np.full((60, 80), 1.5, dtype=np.float32)


def pose(x_m):
    """A camera at a height of 1.5 m that looks straight down."""
    T = np.eye(4)
    T[1, 1] = T[2, 2] = -1.0
    T[:3, 3] = x_m, 0.0, 1.5
    return T


class Waiting(SceneCloud):
    """Takes no frame before it is told to."""

    def __init__(self, settings):
        super().__init__(settings)
        self.started, self.go = threading.Event(), threading.Event()

    def add(self, *args, **kwargs):
        self.started.set()
        assert self.go.wait(10.0)
        return super().add(*args, **kwargs)


class Failing(SceneCloud):
    def add(self, *args, **kwargs):
        raise ValueError("no such luck")


def walk(cloud, steps=20):
    return [cloud.add(DEPTH, CAMERA, pose(0.1 * k), key=k) for k in range(steps)]


def alive():
    return [thread for thread in threading.enumerate() if thread.name == THREAD_NAME]


def test_both_modes_come_to_the_same_layout():
    plain = SceneCloud(LayoutSettings(**SETTINGS))
    walk(plain)
    for mode in ("inline", "background"):
        with SceneCloudThread(LayoutSettings(**SETTINGS, mode=mode, queue=100)) as cloud:
            taken = walk(cloud)
            layout = cloud.layout()
            assert taken == [k % 3 == 0 for k in range(20)]
            assert cloud.passed_over == 0
        assert np.array_equal(layout.floor, plain.layout().floor)
        assert layout.floor.any()
    assert not alive()


def test_a_robot_never_waits():
    slow = Waiting(LayoutSettings(**SETTINGS))
    with SceneCloudThread(LayoutSettings(**SETTINGS, queue=2), slow) as cloud:
        assert cloud.add(DEPTH, CAMERA, pose(0.0))
        assert slow.started.wait(10.0)  # it is out of the queue, so two more find room
        assert [cloud.add(DEPTH, CAMERA, pose(float(k))) for k in (1, 2, 3, 4)] == [True, True, False, False]
        assert cloud.passed_over == 2
        slow.go.set()
        assert cloud.drain(10.0)
        assert len(slow) == 3
        assert cloud.add(DEPTH, CAMERA, pose(4.0))  # what was passed over may come again
        assert cloud.layout().floor.any()
        assert len(slow) == 4


def test_an_error_in_the_thread_is_a_warning():
    settings = LayoutSettings(**SETTINGS)
    with SceneCloudThread(settings, Failing(settings)) as cloud:
        assert cloud.add(DEPTH, CAMERA, pose(0.0))
        assert cloud.drain(10.0)
        assert cloud.take_warnings() == ("scene cloud: a frame is lost (ValueError: no such luck)",)
        assert cloud.take_warnings() == ()
        assert cloud.add(DEPTH, CAMERA, pose(1.0))
        assert cloud.drain(10.0)
        assert len(cloud.take_warnings()) == 1
        assert not cloud.layout().floor.any()


def test_closing_drops_what_waits_and_ends_the_thread():
    slow = Waiting(LayoutSettings(**SETTINGS))
    cloud = SceneCloudThread(LayoutSettings(**SETTINGS), slow)
    cloud.add(DEPTH, CAMERA, pose(0.0))
    assert slow.started.wait(10.0)
    cloud.add(DEPTH, CAMERA, pose(1.0))
    assert not cloud.close(0.01)
    slow.go.set()
    assert cloud.close(10.0)
    assert cloud.close()
    assert not alive()
    assert len(slow) == 1
    assert not cloud.add(DEPTH, CAMERA, pose(2.0))
    assert cloud.layout().floor.any()  # what was seen is still there


@pytest.mark.parametrize("mode", ["inline", "background"])
def test_bad_input_is_refused_at_once(mode):
    with SceneCloudThread(LayoutSettings(mode=mode)) as cloud:
        with pytest.raises(FrameError, match="depth_m"):
            cloud.add(DEPTH[:3], CAMERA, pose(0.0))
        with pytest.raises(FrameError, match="T_world_camera"):
            cloud.add(DEPTH, CAMERA, np.zeros((4, 4)))


def test_the_way_between_frames_is_floor_in_both_modes():
    """The camera looks at a wall far ahead, so that only its way tells of the floor."""
    ahead = pose(0.0)
    ahead[:3, :3] = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    found = []
    for mode in ("inline", "background"):
        with SceneCloudThread(LayoutSettings(mode=mode, queue=100, new_share=0.0)) as cloud:
            for k in range(25):
                T = ahead.copy()
                T[0, 3] = 0.1 * k
                cloud.add(np.full((60, 80), 4.0, dtype=np.float32), CAMERA, T)
            layout = cloud.layout()
        on_way = np.array([[0.5, 0.0], [1.55, 0.0], [2.4, 0.0]])
        assert layout.floor[tuple(layout.cells(on_way).T)].all()
        found.append(layout)
    assert np.array_equal(found[0].floor, found[1].floor)


def test_a_robot_that_stands_still_on_the_border_of_cells_adds_nothing():
    with SceneCloudThread(LayoutSettings(**SETTINGS)) as cloud:
        walk(cloud, 2)
        kept = []
        for k in range(100):
            cloud.add(DEPTH, CAMERA, pose(0.2 + (0.001 if k % 2 else -0.001)))
            kept.append(len(cloud._way))
    assert kept[1] == kept[-1] == 2


def test_a_walk_to_and_fro_gives_the_same_way_in_both_modes():
    there = np.random.default_rng(0).normal(0.0, 0.12, 200).cumsum() % 3.0
    ways = []
    for mode in ("inline", "background"):
        with SceneCloudThread(LayoutSettings(**SETTINGS, mode=mode, queue=300)) as cloud:
            for x_m in there:
                cloud.add(DEPTH, CAMERA, pose(x_m))
            cloud.layout()
        ways.append(cloud._cloud.way_world())
    np.testing.assert_array_equal(*ways)
