"""The simulated image encoder: what it sees, how wrong it is, and what it remembers."""

from functools import cache

import numpy as np
import pytest

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.errors import ConfigError, FrameError
from seo_slam.interfaces import CropEmbedder, Embedder
from seo_slam.simulation.box_pictures import PictureFrame, structure_words
from seo_slam.simulation.detector import View
from seo_slam.simulation.image_encoder import SimulatedImageEncoder
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.simulation.renderer import Rendered
from seo_slam.simulation.world import Thing, World
from seo_slam.testing import check_embedder
from seo_slam.types import Frame

WORDS = HashedEmbedder(256)


@cache
def drawn(index):
    """A frame of the desk, drawn once a run."""
    return SimulatedDesk(seed=3, frames=4, level=0.0, width=160, height=120).rendered(index)


def desk():
    recording = SimulatedDesk(seed=3, frames=4, level=0.0, width=160, height=120)
    recording.rendered = drawn
    return recording


def angle_deg(a, b):
    return np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0)))


def large_boxes(recording, frame):
    """Detections whose middle shows their own thing and hardly another."""
    found = recording.detector.detect(frame)
    view = PictureFrame.of(View(frame.index, recording.world, frame.camera, np.eye(4), recording.rendered(frame.index)))
    alone = [len(seen) == 1 and seen[0].word == label for seen, label in zip(view.in_boxes(found.boxes_px), found.labels, strict=True)]
    return found[np.array(alone)]


def test_a_perfect_encoder_gives_the_vector_of_the_true_word():
    recording = desk()
    encoder = SimulatedImageEncoder.of(recording, WORDS, 0.0, 0.0)
    assert isinstance(encoder, CropEmbedder)
    assert isinstance(encoder, Embedder)
    frame = recording.frame(1)
    found = large_boxes(recording, frame)
    assert len(found) >= 4
    rows = encoder.embed_crops(frame, found.boxes_px)
    assert np.allclose(rows, WORDS.embed_text(list(found.labels)))


def test_words_pass_through():
    encoder = SimulatedImageEncoder(WORDS)
    check_embedder(encoder)
    assert encoder.name == "hashed"
    assert np.array_equal(encoder.embed_text(["cup"]), WORDS.embed_text(["cup"]))


def test_angles_are_as_stated():
    recording = desk()
    by_object = SimulatedImageEncoder.of(recording, WORDS, 50.0, 0.0)
    by_view = SimulatedImageEncoder.of(recording, WORDS, 0.0, 30.0)
    both = SimulatedImageEncoder.of(recording, WORDS)
    frames = [recording.frame(i) for i in (0, 3)]
    box = large_boxes(recording, frames[0])
    label = box.labels[0]
    other = large_boxes(recording, frames[1])
    boxes = [box.boxes_px[:1], other[np.array([name == label for name in other.labels])].boxes_px[:1]]
    word = WORDS.embed_text([label])[0]
    seen = [[encoder.embed_crops(f, b)[0] for f, b in zip(frames, boxes, strict=True)] for encoder in (by_object, by_view, both)]
    assert [angle_deg(word, row) for row in seen[0]] == pytest.approx([50.0, 50.0])
    assert np.allclose(*seen[0])
    assert [angle_deg(word, row) for row in seen[1]] == pytest.approx([30.0, 30.0])
    assert angle_deg(*seen[1]) > 15.0
    assert np.linalg.norm(seen[2], axis=1) == pytest.approx([1.0, 1.0])


def side_by_side(encoder, *models):
    """(N, D) what encoder makes of things that stand beside each other, over thirty frames; a model is the word and a letter."""
    base = desk().world
    parts = base.things[0].parts
    things = tuple(Thing(i, model.split()[0], parts, np.eye(4), model=model) for i, model in enumerate(models, 1))
    world, camera = World(things, base.structure, base.light, base.gaze_world), desk().camera
    ids = np.repeat(np.arange(1, len(things) + 1), camera.width // len(things))[None].repeat(camera.height, axis=0).astype(np.int32)
    ids = np.pad(ids, ((0, 0), (0, camera.width - ids.shape[1])))
    drawn_view = Rendered(np.zeros((*ids.shape, 3), np.uint8), np.ones(ids.shape, np.float32), ids)
    wide = camera.width // len(things)
    boxes_px = np.array([[i * wide, 0.0, (i + 1) * wide, camera.height] for i in range(len(things))])
    rows = []
    for index in range(30):
        encoder.show(float(index), View(index, world, camera, np.eye(4), drawn_view))
        rows.append(encoder.embed_crops(Frame(float(index), drawn_view.rgb, drawn_view.depth_m, camera, index), boxes_px))
    means = np.mean(rows, axis=0)
    return means / np.linalg.norm(means, axis=1, keepdims=True)


@pytest.mark.parametrize("seed", range(4))
def test_copies_look_alike_and_other_models_less(seed):
    one, copy, other, bowl = side_by_side(SimulatedImageEncoder(WORDS, seed), "mug a", "mug a", "mug b", "bowl c")
    assert 0.85 < one @ copy < 0.999
    assert one @ other < one @ copy - 0.1
    assert one @ bowl < one @ copy - 0.1


def test_things_without_a_model_look_like_those_of_their_label():
    recording = desk()
    view = PictureFrame.of(View(1, recording.world, recording.camera, np.eye(4), recording.rendered(1)))
    found = [seen[0] for seen in view.in_boxes(recording.detector.detect(recording.frame(1)).boxes_px)]
    models = {thing.label: thing.model for thing in recording.world.things}
    assert not any(models.values())
    assert {part.look for part in found} == {part.word for part in found}


def test_two_things_in_one_box_mix():
    recording = desk()
    encoder = SimulatedImageEncoder.of(recording, WORDS, 0.0, 0.0)
    frame = recording.frame(2)
    found = recording.detector.detect(frame)
    boxes = [np.r_[np.minimum(a[:2], b[:2]), np.maximum(a[2:], b[2:])] for a in found.boxes_px for b in found.boxes_px]
    view = PictureFrame.of(View(2, recording.world, frame.camera, recording.trajectory.T_world_camera[2], recording.rendered(2)))
    seen = view.in_boxes(np.array(boxes))
    row = next(i for i, parts in enumerate(seen) if len(parts) > 1 and parts[0].word != parts[1].word)
    mixed = encoder.embed_crops(frame, np.array([boxes[row]]))[0]
    first, second = WORDS.embed_text([seen[row][0].word, seen[row][1].word])
    expected = seen[row][0].weight * first + seen[row][1].weight * second
    assert np.allclose(mixed, expected / np.linalg.norm(expected))


def test_structure_is_called_by_where_it_is():
    world = desk().world
    low, high = next(piece for piece in world.structure if piece.label == "desk").bounds_world
    points = np.array([[0.0, 0.0, 0.0], (low + high) / 2.0, [1.9, 0.0, 1.5]])
    words = structure_words(world, points).tolist()
    assert words[:2] == ["floor", "desk"]
    assert words[2] == "wall"


def test_the_order_of_frames_does_not_matter():
    forward, backward = desk(), desk()
    encoders = [SimulatedImageEncoder.of(recording, WORDS) for recording in (forward, backward)]
    frames = list(forward)
    for index in (3, 0, 3, 1, 2):
        backward.frame(index)
    for frame in frames:
        boxes_px = forward.detector.detect(frame).boxes_px
        assert np.array_equal(*(encoder.embed_crops(frame, boxes_px) for encoder in encoders))


def test_old_frames_are_forgotten():
    recording = desk()
    encoder = SimulatedImageEncoder.of(recording, WORDS, kept_frames=2)
    frames = list(recording)
    boxes_px = np.array([[10.0, 10.0, 60.0, 60.0]])
    assert encoder.embed_crops(frames[3], boxes_px).shape == (1, 256)
    with pytest.raises(FrameError, match=r"frame 1 .*newest 2 frames"):
        encoder.embed_crops(frames[1], boxes_px)
    recording.frame(1)
    assert encoder.embed_crops(frames[1], boxes_px).shape == (1, 256)


def test_no_boxes_no_rows_and_slivers_are_seen():
    recording = desk()
    encoder = SimulatedImageEncoder.of(recording, WORDS)
    frame = recording.frame(0)
    assert encoder.embed_crops(frame, np.zeros((0, 4))).shape == (0, 256)
    edges = np.array([[0.0, 0.0, 1.0, 120.0], [158.7, 100.0, 160.0, 101.0], [0.0, 0.0, 160.0, 120.0], [5.2, 5.2, 5.9, 5.9]])
    assert np.linalg.norm(encoder.embed_crops(frame, edges), axis=1) == pytest.approx(np.ones(4))


@pytest.mark.parametrize(
    ("options", "words"),
    [({"object_angle_deg": -1.0}, "object_angle_deg is -1"), ({"view_angle_deg": 91.0}, "0..90"), ({"kept_frames": 0}, "at least 1")],
)
def test_bad_options(options, words):
    with pytest.raises(ConfigError, match=words):
        SimulatedImageEncoder(WORDS, **options)
