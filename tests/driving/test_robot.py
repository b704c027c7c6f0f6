"""The simulated robot: it goes where it is told, no faster than it can, not through walls, and its detector knows its frames."""

import numpy as np
import pytest
from driven_homes import apartment

from seo_slam.driving.robot import LOOK_DOWN_RAD, SimulatedRobot, touches
from seo_slam.errors import ConfigError, FrameError
from seo_slam.geometry import inverse
from seo_slam.navigation.outcomes import Command
from seo_slam.simulation.free_space import ROBOT_RADIUS_M
from seo_slam.simulation.segments import SimulatedSegmenter
from seo_slam.simulation.shortest import ShortestWays
from seo_slam.simulation.standpoints import EYE_M
from seo_slam.simulation.tour import MOST_TURN_RAD_S, RATE_HZ, SPEED_M_S


def roomy_place():
    """The place of the apartment with the most room, and how much that is."""
    free = apartment().free
    row, column = np.unravel_index(np.argmax(free.clearance_m), free.occupied.shape)
    return free.middles(np.array([[row, column]]))[0], float(free.clearance_m[row, column])


def wall_west_of(xy):
    """A point inside whatever is first met along -x."""
    free = apartment().free
    row, column = free.cells(xy[None])[0]
    blocked = np.flatnonzero(free.occupied[row, :column])
    return free.middles(np.array([[row, blocked[-1]]]))[0]


def test_the_camera_is_where_the_robot_is_and_looks_down_a_little():
    robot = SimulatedRobot(apartment(), roomy_place()[0], 0.7)
    T = robot.T_world_camera
    np.testing.assert_allclose(T[:3, 3], [*robot.xy_world, EYE_M])
    down = np.sin(LOOK_DOWN_RAD)
    np.testing.assert_allclose(T[:3, 2], [np.cos(0.7) * np.cos(LOOK_DOWN_RAD), np.sin(0.7) * np.cos(LOOK_DOWN_RAD), -down], atol=1e-9)


def test_it_turns_towards_its_goal_and_arrives():
    start, room_m = roomy_place()
    robot = SimulatedRobot(apartment(), start, 2.0)
    goal = start + np.array([room_m - ROBOT_RADIUS_M - 0.1, 0.0])
    for _ in range(60):
        robot.drive(Command("go", goal))
    np.testing.assert_allclose(robot.xy_world, goal, atol=2e-3)
    assert robot.collisions == 0
    assert robot.driven_m >= np.linalg.norm(goal - start) - 2e-3


def test_it_is_no_faster_than_the_tour_is():
    start, room_m = roomy_place()
    robot = SimulatedRobot(apartment(), start, 1.0)
    before = robot.yaw_rad
    robot.drive(Command("turn", start, before + 3.0), 1.0)
    assert robot.yaw_rad - before == pytest.approx(MOST_TURN_RAD_S, abs=1e-9)
    robot = SimulatedRobot(apartment(), start, 0.0)
    robot.drive(Command("go", start + np.array([room_m, 0.0])), 0.5)
    assert np.linalg.norm(robot.xy_world - start) == pytest.approx(0.5 * SPEED_M_S, abs=1e-6)


def test_it_turns_the_short_way_round():
    robot = SimulatedRobot(apartment(), roomy_place()[0], 3.0)
    robot.drive(Command("turn", robot.xy_world, -3.0), 1.0)
    assert np.cos(robot.yaw_rad + 3.0) == pytest.approx(1.0)
    assert robot.yaw_rad > 3.0


def test_at_its_goal_it_takes_the_heading_it_was_given():
    robot = SimulatedRobot(apartment(), roomy_place()[0], 0.0)
    for _ in range(12):
        robot.drive(Command("go", robot.xy_world, 1.2))
    assert robot.yaw_rad == pytest.approx(1.2, abs=2e-3)


def test_it_stops_at_a_wall_and_counts_one_collision():
    start, _ = roomy_place()
    robot = SimulatedRobot(apartment(), start, np.pi)
    for _ in range(120):
        robot.drive(Command("go", wall_west_of(start)))
    assert robot.collisions == 1
    assert not touches(apartment().free, robot.xy_world)
    left_m = np.linalg.norm(robot.xy_world - wall_west_of(start))
    assert ROBOT_RADIUS_M - 0.05 < left_m < ROBOT_RADIUS_M + 0.08
    robot.drive(Command("go", start), 10.0)
    assert np.linalg.norm(robot.xy_world - start) < 0.01
    for _ in range(120):
        robot.drive(Command("go", wall_west_of(start)))
    assert robot.collisions == 2


def test_stop_is_stop():
    robot = SimulatedRobot(apartment(), roomy_place()[0], 0.0)
    robot.drive(Command("stop", robot.xy_world + 1.0, 1.0, 0.5, 0.5))
    np.testing.assert_array_equal(robot.xy_world, roomy_place()[0])
    assert robot.yaw_rad == 0.0


def test_frames_are_due_at_its_rate_and_its_detectors_know_them():
    robot = SimulatedRobot(apartment(), roomy_place()[0], 0.0)
    segmenter = SimulatedSegmenter(robot.detector_knobs, robot.seed)
    robot.show_to(segmenter)
    first = robot.frame()
    robot.drive(Command("turn", robot.xy_world, 1.0))
    second = robot.frame()
    assert second.timestamp_s - first.timestamp_s == pytest.approx(1.0 / RATE_HZ, abs=1e-6)
    assert second.index == first.index + 1
    for frame in (first, second):
        ids = apartment().renderer(robot.world, robot.camera, robot.trajectory.T_world_camera[frame.index - first.index]).instance_ids
        labels = {robot.world.thing(int(i)).label for i in np.unique(ids[ids > 0])}
        assert set(robot.detector.detect(frame).labels) <= labels
        assert len(segmenter.detect(frame)) > 0
    assert len(robot.trajectory) == 2


def test_another_drive_has_other_noise_and_the_same_one_the_same():
    start = roomy_place()[0]
    frames = [SimulatedRobot(apartment(10, 0.69), start, 0.0, drive=drive).frame() for drive in (0, 0, 1)]
    np.testing.assert_array_equal(frames[0].depth_m, frames[1].depth_m)
    assert (frames[0].depth_m != frames[2].depth_m).any()


@pytest.mark.parametrize("drifts", [False, True])
def test_odometry_reports_the_true_poses_unless_it_drifts(drifts):
    robot = SimulatedRobot(apartment(10, 0.69), roomy_place()[0], 0.0, drifts=drifts)
    reported, T = [], np.eye(4)
    for k in range(8):
        motion = robot.odometry.update(robot.frame())
        T = motion.T_world_camera if k == 0 else T @ motion.T_previous_current
        np.testing.assert_allclose(T, motion.T_world_camera, atol=1e-9)
        reported.append(motion.T_world_camera)
        robot.drive(Command("go", robot.xy_world + np.array([0.3, 0.1])))
    errors = [np.linalg.norm((inverse(true) @ said)[:3, 3]) for true, said in zip(robot.trajectory.T_world_camera, reported, strict=True)]
    assert errors[0] == 0.0
    assert (max(errors) > 1e-4) == drifts


def test_odometry_knows_only_frames_of_its_robot():
    robot = SimulatedRobot(apartment(), roomy_place()[0])
    frame = robot.frame()
    robot.drive(Command("stop", robot.xy_world))
    later = robot.frame()
    other = SimulatedRobot(apartment(), roomy_place()[0])
    assert other.frame().timestamp_s == frame.timestamp_s
    with pytest.raises(FrameError, match="no pose"):
        other.odometry.update(later)


def test_it_cannot_start_in_a_wall_nor_drive_for_no_time():
    start, _ = roomy_place()
    with pytest.raises(ConfigError, match="start"):
        SimulatedRobot(apartment(), wall_west_of(start))
    with pytest.raises(ConfigError, match="drive -1"):
        SimulatedRobot(apartment(), start, drive=-1)
    with pytest.raises(ConfigError, match="above 0"):
        SimulatedRobot(apartment(), start).drive(Command("stop", start), 0.0)


def test_shortest_ways_are_straight_where_nothing_is_between_and_never_shorter():
    start, room_m = roomy_place()
    lengths_m = ShortestWays(apartment().free).lengths_m(start)
    reached = np.argwhere(np.isfinite(lengths_m))
    straight_m = np.linalg.norm(apartment().free.middles(reached) - start, axis=1)
    walked_m = lengths_m[tuple(reached.T)]
    assert (walked_m >= straight_m - 1e-9).all()
    near = straight_m < room_m - ROBOT_RADIUS_M - 0.1
    assert near.sum() > 20
    assert (walked_m[near] <= 1.028 * straight_m[near] + 1e-9).all()
    assert walked_m.max() > 5.0  # into other rooms
