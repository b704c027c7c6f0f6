"""A scene's timeline: what changed, when, and the box around where the thing is then."""

import numpy as np
import pytest

from seo_slam.evaluation.truth import truth_from
from seo_slam.geometry import exp
from seo_slam.simulation.primitives import Box
from seo_slam.simulation.scene import Scene, SceneChange
from seo_slam.simulation.textures import mottled
from seo_slam.simulation.world import Light, Part, Thing, World

SIZE_M = (0.4, 0.2, 0.1)


def box_at(x: float, y: float, turn: float = 0.0, thing_id: int = 1) -> Thing:
    part = Part(Box(SIZE_M), mottled(("test",), (0.5, 0.5, 0.5)), exp([0, 0, 0, 0, 0, SIZE_M[2] / 2]))
    return Thing(thing_id, "book", (part,), exp([0, 0, 0, x, y, 0.7]) @ exp([0, 0, turn, 0, 0, 0]), accepted_labels=("paper",))


@pytest.fixture
def scene() -> Scene:
    light = Light(np.array([0.0, 0.0, 1.0]), 0.5)
    start = World((box_at(0, 0), box_at(5, 0, thing_id=2)), (), light, np.zeros(3))
    changes = (
        SceneChange(2.0, "moved", box_at(1, 2, np.pi / 2)),
        SceneChange(3.0, "removed", box_at(5, 0, thing_id=2)),
        SceneChange(4.0, "added", box_at(-1, 0, thing_id=3)),
    )
    return Scene(start, changes)


def test_every_event_has_the_box_around_its_centre(scene: Scene) -> None:
    rows = scene.timeline()
    assert [row["event"] for row in rows] == ["moved", "removed", "added"]
    sizes = [(0.2, 0.4, 0.1), SIZE_M, SIZE_M]  # the first is turned by 90 degrees where it is put
    for row, size_m in zip(rows, sizes, strict=True):
        low, high = np.array(row["aabb_min"]), np.array(row["aabb_max"])
        assert high - low == pytest.approx(np.array(size_m), abs=2e-6)
        assert (low + high) / 2 == pytest.approx(row["center"], abs=2e-6)
    assert rows[0]["center"] == pytest.approx([1.0, 2.0, 0.75])
    assert rows[0]["previous_center"] == pytest.approx([0.0, 0.0, 0.75])


def test_the_evaluation_knows_how_large_a_removed_thing_was(scene: Scene) -> None:
    left = {"id": 1, "label": "book", "center": [1.0, 2.0, 0.75]}
    truth = truth_from({"objects": [left], "timeline": scene.timeline()})
    (place,) = [place for place in truth.places if place.event == "removed"]
    assert place.size_m == pytest.approx(np.array(SIZE_M), abs=2e-6)
