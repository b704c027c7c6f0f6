"""The true agents ask the simulated model about pictures that they draw themselves."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest
from drawn_question import true_boxes

from seo_slam.agents.description import DescriptionAgent
from seo_slam.agents.merging import MergingAgent
from seo_slam.agents.verification import VerificationAgent
from seo_slam.interfaces import AgentView
from seo_slam.records import Confirm, Doubt, Merge, Relabel, Remove
from seo_slam.simulation.chat_answers import SimulatedChat
from seo_slam.simulation.named import simulate
from seo_slam.types import Landmark, Landmarks


@pytest.fixture(scope="module")
def shown():
    """A perfect model that saw one frame of a small room, the world, the frame, its camera pose, and boxes of things in plain view."""
    recording = simulate("SM1", seed=0, level=0.0, frames=6)
    model = SimulatedChat.watching(recording, 1.0)
    frame = recording.frame(2)
    rendered = recording.rendered(2)
    world = recording.scene.world_at(frame.timestamp_s)
    visible = {k: (rendered.instance_ids == k).sum() / rendered.covered_px[k] for k in rendered.covered_px}
    boxes = {k: box for k, box in true_boxes(rendered, least_px=300).items() if visible[k] > 0.8}
    assert len(boxes) >= 4
    return model, world, frame, recording.trajectory.T_world_camera[2], boxes


def view_of(shown, names, boxes):
    """What an agent is shown: landmark 10 * id for each thing, under the names given, with boxes given."""
    _, world, frame, T_world_camera, _ = shown
    rows = []
    for landmark_id, name in sorted(names.items()):
        thing = world.thing(landmark_id // 10)
        low, high = thing.bounds_world
        rows.append(
            Landmark(
                landmark_id,
                name,
                {name: 1.0},
                thing.p_world,
                1e-4 * np.eye(3),
                high - low,
                np.array([1.0]),
                5,
                0.0,
                1.0,
                state="stable",
                version=3,
            )
        )
    return AgentView(frame, T_world_camera, Landmarks.from_rows(rows), boxes, asked=tuple(sorted(names)))


def ask(agent, view):
    return list(asyncio.run(agent.propose(view)))


def test_right_and_wrong_labels_are_told_apart_four_at_a_time(shown):
    model, world, _, _, boxes = shown
    agent = VerificationAgent(chat=model)
    four = {10 * k: box for k, box in list(boxes.items())[:4]}
    right = {i: world.thing(i // 10).label for i in four}
    assert ask(agent, view_of(shown, right, four)) == [Confirm(i, 3, agent.name) for i in sorted(four)]
    assert ask(agent, view_of(shown, dict.fromkeys(right, "elephant"), four)) == [Doubt(i, 3, agent.name) for i in sorted(four)]


def test_a_box_where_nothing_is_proposes_removal(shown):
    model, world, _, _, boxes = shown
    first = next(iter(boxes))
    corner = {10 * first: np.array([2.0, 2.0, 40.0, 40.0])}
    assert ask(VerificationAgent(chat=model), view_of(shown, {10 * first: world.thing(first).label}, corner)) == [
        Remove(10 * first, 3, "verification")
    ]


def test_things_are_described_and_known_labels_kept(shown):
    model, world, _, _, boxes = shown
    agent = DescriptionAgent(chat=model)
    for k, box in boxes.items():
        view = view_of(shown, {10 * k: "thing"}, {10 * k: box})
        (edit,) = ask(agent, view)
        assert isinstance(edit, Relabel)
        assert edit.label.endswith(world.thing(k).label)
        assert edit.category == world.thing(k).label
        (again,) = ask(agent, replace(view, known_labels=(edit.label,)))
        assert (again.label, again.category) == (edit.label, edit.category)


def test_two_landmarks_of_one_thing_are_merged_into_the_better(shown):
    model, _, _, _, boxes = shown
    (first, box), (second, other) = list(boxes.items())[:2]
    wide = box + 0.25 * np.tile(box[2:] - box[:2], 2) * np.array([-1, -1, 1, 1])
    ids = {10 * first: "thing", 10 * first + 1: "thing", 10 * second: "thing"}
    view = view_of(shown, ids, {10 * first: wide, 10 * first + 1: box, 10 * second: other})
    assert ask(MergingAgent(chat=model), view) == [Merge(10 * first + 1, 3, 10 * first, 3, "merging")]
