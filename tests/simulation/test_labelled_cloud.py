"""The true points of a recording: where they are, whose they are, and what structure is called."""

from dataclasses import replace

import numpy as np
import pytest
from homes import apartment

from seo_slam.errors import ConfigError
from seo_slam.evaluation.class_words import ClassWords
from seo_slam.evaluation.segmentation import PredictedObject, evaluate_segmentation
from seo_slam.evaluation.segmentation_protocols import PROTOCOLS
from seo_slam.simulation.catalogue import pose
from seo_slam.simulation.labelled_cloud import labelled_cloud
from seo_slam.simulation.primitives import Box
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.simulation.scene import Scene, SceneChange
from seo_slam.simulation.structure_names import StructureNames
from seo_slam.simulation.world import STRUCTURE_ID, Part, Thing, World

VOXEL_M = 0.02


@pytest.fixture(scope="module")
def desk():
    recording = SimulatedDesk(seed=3, frames=6, width=96, height=72, level=0.0)
    return recording, labelled_cloud(recording, VOXEL_M)


def points_of(cloud, number):
    return cloud.p_world[cloud.instance_ids == number]


def test_points_lie_on_the_thing_that_they_are_said_to_be_of(desk):
    recording, cloud = desk
    seen = [thing for thing in recording.world.things if len(points_of(cloud, thing.id))]
    assert len(seen) > 10
    for thing in seen:
        low, high = thing.bounds_world
        p_world = points_of(cloud, thing.id)
        assert (p_world >= low - 1e-3).all()
        assert (p_world <= high + 1e-3).all()
        assert cloud.class_names[cloud.instances[thing.id]] == thing.label


def test_a_voxel_of_a_thing_has_one_point(desk):
    _, cloud = desk
    cells = np.column_stack([cloud.instance_ids, np.floor(cloud.p_world / VOXEL_M)])
    assert len(np.unique(cells, axis=0)) == len(cells)


def test_structure_is_there_under_names_of_its_own(desk):
    recording, cloud = desk
    floor = cloud.p_world[cloud.class_ids == cloud.class_names.index("floor")]
    assert len(floor)
    assert np.abs(floor[:, 2]).max() < 0.02
    last = max(thing.id for thing in recording.world.things)
    structure = {cloud.class_names[class_id] for number, class_id in cloud.instances.items() if number > last}
    assert "floor" in structure
    assert not structure & {thing.label for thing in recording.world.things}


def test_the_same_recording_gives_the_same_points(desk):
    _, cloud = desk
    again = labelled_cloud(SimulatedDesk(seed=3, frames=6, width=96, height=72, level=1.0), VOXEL_M)
    assert again.p_world.tobytes() == cloud.p_world.tobytes()  # neither noise of depth nor of the detector is in it
    assert (again.instance_ids == cloud.instance_ids).all()
    assert again.visible_keyframes == cloud.visible_keyframes


def test_visible_keyframes_are_those_of_the_truth(desk):
    recording, cloud = desk
    stated = {row["id"]: row["visible_keyframes"] for row in recording.truth["objects"]}
    assert {number: cloud.visible_keyframes[number] for number in stated} == pytest.approx(stated, abs=1)


def test_a_thing_that_moved_is_only_where_it_is_at_the_end():
    recording = SimulatedDesk(seed=3, frames=6, width=96, height=72, level=0.0)
    there, gone = recording.world.things[0], recording.world.things[1]
    moved = there.at(pose(0.0, 0.0, 0.35) @ there.T_world_thing)
    middle_s = float(recording.trajectory.timestamps_s[3])
    recording.scene = Scene(recording.world, [SceneChange(middle_s, "moved", moved), SceneChange(middle_s, "removed", gone)])
    cloud = labelled_cloud(recording, VOXEL_M)
    low, high = moved.bounds_world
    assert len(points_of(cloud, there.id))
    assert (points_of(cloud, there.id) >= low - 1e-3).all()
    assert (points_of(cloud, there.id) <= high + 1e-3).all()
    assert not len(points_of(cloud, gone.id))
    assert gone.id not in cloud.instances


class OneWordOneAxis:
    """Each class name its own axis."""

    name = "one word one axis"

    def __init__(self, names):
        self.names = names

    def embed_text(self, texts):
        return np.array([[float(text in (name, f"there is a {name} in the scene")) for name in self.names] for text in texts])


@pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=PROTOCOLS)
def test_the_true_points_as_a_map_score_one(desk, protocol):
    recording, cloud = desk
    objects = [
        PredictedObject(points_of(cloud, number), label=cloud.class_names[class_id])
        for number, class_id in cloud.instances.items()
        if cloud.class_names[class_id] not in ("wall", "floor", "ceiling")
    ]
    (result,) = evaluate_segmentation(objects, cloud, ClassWords.of(cloud.class_names, OneWordOneAxis(cloud.class_names)), [protocol])
    if protocol.neighbours == 1:
        assert (result.miou, result.fmiou, result.macc) == (1.0, 1.0, 1.0)
    else:  # five neighbours smooth the borders of things that stand on others
        assert result.miou > 0.9
    assert result.counts.odr_objects == 1.0
    assert (result.counts.duplicates, result.counts.missed, result.counts.of_nothing) == (0, 0, 0)
    assert recording.world.things


def test_shells_are_named_by_place_and_other_pieces_by_their_own_names():
    world = apartment(0).world
    table = Thing(STRUCTURE_ID, "table", (Part(Box((1.0, 1.0, 0.7)), world.structure[0].parts[0].texture, pose()),), pose(5.0, 5.0, 0.35))
    glass = replace(table, label="room window b", T_world_thing=pose(5.0, 1.0, 1.0))
    light = replace(table, label="light c", T_world_thing=pose(8.0, 5.0, 2.0))
    names = StructureNames(World((), (*world.structure, table, glass, light), world.light, world.gaze_world))
    assert names.names[:3] == ("wall", "floor", "ceiling")
    assert sorted(names.names[3:]) == ["light", "table", "window"]
    places = np.array([[2.0, 4.0, 1.2], [4.0, 4.0, 0.0], [4.0, 4.0, 2.5], [5.0, 5.0, 0.7], [5.0, 1.0, 1.0], [4.6, 4.6, 0.0]])
    assert [names.names[piece] for piece in names.piece_of(places)] == ["wall", "floor", "ceiling", "table", "window", "floor"]


def test_bad_arguments_are_refused(desk):
    recording, _ = desk
    with pytest.raises(ConfigError, match="voxel_m: got 0, wanted metres above 0"):
        labelled_cloud(recording, 0)
    with pytest.raises(ConfigError, match="every: got 0"):
        labelled_cloud(recording, every=0)
    with pytest.raises(ConfigError, match="at most 65536 cells each way"):
        labelled_cloud(recording, 1e-6)
