"""The mapper that is told what it sees: nothing but what was in view, where it is."""

from functools import cache

import numpy as np
from driven_homes import apartment

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.driving.robot import SimulatedRobot
from seo_slam.driving.true_mapper import TrueMapper
from seo_slam.navigation.outcomes import Command
from seo_slam.simulation.standpoints import Standpoints


@cache
def looked_around():
    """A map made by a robot that turns once around; and what was in its images."""
    home = apartment()
    thing = next(thing for thing in home.world.things if thing.kind == "volatile")
    eyes = Standpoints(home.world, home.free).near(thing, 1.5, 0.8)
    robot = SimulatedRobot(home, eyes[0, :2])
    mapper = TrueMapper(robot, robot.odometry, HashedEmbedder())
    seen = {}

    class Witness:
        def show(self, timestamp_s, view):
            near = view.rendered.depth_m < 5.0
            ids, counts = np.unique(view.rendered.instance_ids[near], return_counts=True)
            for i, n in zip(ids, counts, strict=True):
                seen[int(i)] = max(seen.get(int(i), 0), int(n))

    robot.show_to(Witness())
    for _ in range(16):
        result = mapper.step(robot.frame())
        np.testing.assert_allclose(result.T_world_camera, robot.T_world_camera, atol=1e-12)
        assert result.is_keyframe
        robot.drive(Command("turn", robot.xy_world, robot.yaw_rad + 1.0), 0.5)
    seen.pop(0, None)
    return home.world, mapper.snapshot(), seen


def test_it_maps_what_was_in_view_where_it_is():
    world, snapshot, seen = looked_around()
    rows = (*snapshot.landmarks, *snapshot.tentative)
    assert {row.id for row in rows} == {i for i, pixels in seen.items() if pixels >= 12}
    assert len(snapshot.landmarks) >= 3
    for row in rows:
        low, high = world.thing(row.id).bounds_world
        assert (row.cloud_world >= low - 0.02).all()
        assert (row.cloud_world <= high + 0.02).all()
        assert row.label == world.thing(row.id).label
        assert (row.state == "stable") == (row.observations >= 2)


def test_landmarks_can_be_asked_for_by_their_words():
    _, snapshot, _ = looked_around()
    row = snapshot.landmarks[0]
    assert snapshot.query(row.label, 1, HashedEmbedder())[0].landmark.label == row.label
