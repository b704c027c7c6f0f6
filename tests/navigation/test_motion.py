"""Following a path: forward on it, within limits, to its end."""

import numpy as np
import pytest
from fake_home import Robot, furniture, layout
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.navigation.grid import NavigationGrid
from seo_slam.navigation.motion import Follower, Stance, path_length_m, towards, turn_to, turned_by, wait, wrapped
from seo_slam.settings.navigation import NavigationSettings

SETTINGS = NavigationSettings()
GRID = NavigationGrid(layout(furniture()), 0.18)
BENT = np.array([[1.0, 2.0], [3.6, 2.5], [4.6, 2.5], [4.6, 4.5]])


def by_velocity(path, settings=SETTINGS, dt_s=0.1, most=2000):
    """Where a robot comes that takes only the velocities."""
    follower, stance, trace = Follower(path, GRID, settings), Stance(path[0].copy(), 3.0), []
    while (command := follower.command(stance)) is not None and len(trace) < most:
        assert command.kind == "go"
        yaw = stance.yaw_rad + dt_s * command.turn_rad_s
        step = dt_s * command.forward_m_s * np.array([np.cos(yaw), np.sin(yaw)])
        stance = Stance(stance.xy_world + step, yaw)
        trace.append(stance.xy_world)
    return np.array(trace)


def test_velocities_lead_along_the_path_to_its_end():
    trace = by_velocity(BENT)
    assert np.linalg.norm(trace[-1] - BENT[-1]) <= SETTINGS.reach_m
    assert path_length_m(trace) < 1.05 * path_length_m(BENT)
    assert GRID.is_free(trace).all()


def test_waypoints_lead_to_its_end():
    robot = Robot(BENT[0], 3.0)
    follower = Follower(BENT, GRID, SETTINGS)
    left = [follower.left_m]
    while (command := follower.command(Stance(robot.xy, robot.yaw_rad))) is not None:
        assert np.linalg.norm(command.xy_world - robot.xy) <= SETTINGS.look_ahead_m + 0.1
        robot.drive(command)
        left.append(follower.left_m)
        assert len(left) < 500
    assert np.linalg.norm(robot.xy - BENT[-1]) <= SETTINGS.reach_m
    assert left[0] == pytest.approx(path_length_m(BENT))
    assert (np.diff(left) <= 1e-9).all(), "it never goes back"


def test_a_path_that_crosses_itself_is_walked_wholly():
    loop = np.array([[1.0, 2.0], [3.5, 2.0], [3.5, 2.8], [2.0, 2.8], [2.0, 1.2]])
    trace = by_velocity(loop)
    assert path_length_m(trace) > 0.85 * path_length_m(loop)


def test_a_path_of_one_place_is_at_its_end():
    assert Follower(np.array([[1.0, 2.0], [1.0, 2.0]]), GRID, SETTINGS).command(Stance(np.array([1.0, 2.0]), 0.0)) is None


def test_far_off_its_course_it_turns_on_the_spot():
    command = towards(np.array([0.0, 2.0]), Stance(np.array([1.0, 2.0]), 0.0), SETTINGS)
    assert command.forward_m_s == 0.0
    assert abs(command.turn_rad_s) == SETTINGS.turn_rad_s
    ahead = towards(np.array([2.0, 2.0]), Stance(np.array([1.0, 2.0]), 0.0), SETTINGS)
    assert (ahead.forward_m_s, ahead.turn_rad_s) == (SETTINGS.speed_m_s, 0.0)


def test_turning_and_waiting():
    stance = Stance(np.array([1.0, 2.0]), 3.0)
    command = turn_to(-3.0, stance, SETTINGS)
    assert command.kind == "turn"
    assert command.turn_rad_s > 0, "the short way round"
    assert turn_to(3.0 + 0.5 * SETTINGS.turned_rad, stance, SETTINGS) is None
    assert (wait(stance).yaw_rad, wait(stance).turn_rad_s) == (3.0, 0.0)


def test_the_stance_of_a_camera():
    robot = Robot((1.5, -2.0), 2.2)
    stance = Stance.of(robot.T_world_camera)
    np.testing.assert_allclose(stance.xy_world, [1.5, -2.0])
    assert stance.yaw_rad == pytest.approx(2.2)


@given(st.floats(-20, 20), st.floats(-20, 20))
def test_turns_are_the_short_way_and_arrive(a, b):
    turn = turned_by(a, b)
    assert -np.pi <= turn < np.pi
    assert np.cos(a + turn - b) == pytest.approx(1.0)
    assert wrapped(a + 2 * np.pi) == pytest.approx(wrapped(a), abs=1e-9) or abs(abs(wrapped(a)) - np.pi) < 1e-6
