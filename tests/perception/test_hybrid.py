"""The hybrid front end: what of two detectors becomes what, and what bad parts get."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam import registry
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.camera import Camera
from seo_slam.config import Component
from seo_slam.errors import ConfigError, FrameError, UnknownBackendError
from seo_slam.perception.hybrid import HybridDetector
from seo_slam.types import Detections, Frame

WIDTH, HEIGHT = 160, 120
CAMERA = Camera(130.0, 130.0, 79.5, 59.5, WIDTH, HEIGHT)


def frame(timestamp_s=0.0, depth_m=None):
    """A picture with a red and a blue square; a bumpy surface 2 m away unless other depths are given."""
    rgb = np.full((HEIGHT, WIDTH, 3), 128, dtype=np.uint8)
    rgb[10:50, 10:50] = (200, 30, 20)
    rgb[10:50, 100:140] = (20, 40, 210)
    bumpy_m = 2.0 + 0.3 * np.sin(np.arange(WIDTH) / 3.0)[None, :] * np.sin(np.arange(HEIGHT) / 3.0)[:, None]
    return Frame(timestamp_s, rgb, (bumpy_m if depth_m is None else depth_m).astype(np.float32), CAMERA, int(timestamp_s))


def mask(x0, y0, x1, y1):
    out = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    out[y0:y1, x0:x1] = True
    return out


def rows(*found, with_masks=True):
    boxes = np.array([box for _, box in found], dtype=np.float64).reshape(-1, 4)
    masks = np.array([mask(*box) for _, box in found], dtype=np.bool_).reshape(-1, HEIGHT, WIDTH)
    return Detections(boxes, tuple(label for label, _ in found), np.linspace(0.9, 0.5, len(found)), masks if with_masks else None)


class Says:
    """A detector with one answer."""

    def __init__(self, answer):
        self.answer = answer

    def detect(self, frame):
        return self.answer


RED, BLUE, ELSEWHERE = (10, 10, 50, 50), (100, 10, 140, 50), (60, 70, 100, 110)


def test_named_things_first_then_what_they_leave_out():
    detector = Says(rows(("cup", RED), ("cup", (12, 12, 48, 48)), ("wall", (0, 0, 160, 120))))
    segmenter = Says(rows(("what", RED), ("a", BLUE), ("segment is", ELSEWHERE)))
    found = HybridDetector(detector, segmenter).detect(frame())
    assert found.labels == ("cup", None, None)
    assert found.boxes_px.tolist() == [list(RED), list(BLUE), list(ELSEWHERE)]
    assert found.masks.sum(axis=(1, 2)).tolist() == [1600, 1600, 1600]


@pytest.mark.parametrize(
    ("options", "labels"),
    [
        ({"segmenter": None}, ("cup",)),
        ({"refine": False}, ("cup", "bowl", None)),
        ({"background": ()}, ("cup", "wall", None)),
        ({"classes": ["BOWL"]}, ("bowl", None)),
        ({"classes": ["shoe"]}, (None, None)),
        ({"settings": {"smallest_px": 30000.0}}, ("cup",)),
        ({"settings": {"smallest_px": 30000.0, "smallest_named_px": 30000.0}}, ()),
    ],
)
def test_every_step_can_be_left_out(options, labels):
    detector = Says(rows(("cup", RED), ("bowl", (12, 10, 50, 50)), ("wall", (60, 70, 100, 110))))
    segmenter = Says(rows((None, BLUE), (None, RED)))
    found = HybridDetector(detector, **({"segmenter": segmenter} | options)).detect(frame())
    assert found.labels == labels


def test_a_segment_of_named_background_is_background():
    detector = Says(rows(("wall", BLUE)))
    assert len(HybridDetector(detector, Says(rows((None, BLUE)))).detect(frame())) == 0


def test_no_two_masks_share_a_pixel_and_every_row_has_one():
    detector = Says(rows(("cup", RED), ("table", (0, 30, 160, 110)), with_masks=False))
    found = HybridDetector(detector, Says(rows((None, BLUE)))).detect(frame())
    assert found.masks.sum(axis=0).max() == 1
    assert found.masks.any(axis=(1, 2)).all()
    assert found.labels == ("cup", "table", None)


def test_a_mask_that_is_missing_comes_from_the_masker_only():
    class Masks:
        def masks(self, frame, boxes_px):
            self.asked = boxes_px.tolist()
            return np.array([mask(*(int(x) for x in box)) for box in boxes_px])

    detections = rows(("cup", RED), ("shoe", BLUE))
    masks = detections.masks.copy()
    masks[1] = False
    masks[0, :30] = False
    masker = Masks()
    found = HybridDetector(Says(replace(detections, masks=masks)), masker=masker).detect(frame())
    assert masker.asked == [list(BLUE)]
    assert found.masks.sum(axis=(1, 2)).tolist() == [20 * 40, 1600]


def test_of_two_alike_segments_one_stays_if_only_the_other_is_a_wall():
    wall, above_half, below_half = (0, 0, 100, 100), (0, 0, 100, 51), (0, 0, 100, 49)
    segments = Says(rows((None, above_half), (None, below_half)))
    found = HybridDetector(Says(rows(("wall", wall))), segments, structure="keep").detect(frame())
    assert found.boxes_px.tolist() == [list(below_half)]
    assert HybridDetector(Says(rows()), segments, structure="keep").detect(frame()).boxes_px.tolist() == [list(above_half)]


def test_walls_among_the_segments_go_by_shape():
    flat_m = np.full((HEIGHT, WIDTH), 3.0)
    flat_m[70:110, 60:100] = 1.5 + 0.2 * np.sin(np.arange(40) / 4.0)[:, None] + 0.2 * np.cos(np.arange(40) / 5.0)[None, :]
    wall, thing = mask(0, 0, 160, 120), mask(*ELSEWHERE)
    wall &= ~thing
    segments = Detections(np.array([[0.0, 0, 160, 120], ELSEWHERE]), (None, None), np.ones(2), np.array([wall, thing]))
    found = HybridDetector(Says(rows()), Says(segments)).detect(frame(depth_m=flat_m))
    assert found.boxes_px.tolist() == [list(ELSEWHERE)]
    assert len(HybridDetector(Says(rows()), Says(segments), structure="keep").detect(frame(depth_m=flat_m))) == 2
    named = HybridDetector(Says(replace(segments, labels=("poster", "cup")))).detect(frame(depth_m=flat_m))
    assert named.labels == ("poster", "cup")


class SeesRedWalls(HashedEmbedder):
    """Red is a wall, everything else a cup."""

    def embed_crops(self, frame, boxes_px):
        red = [frame.rgb[int(b[1] + b[3]) // 2, int(b[0] + b[2]) // 2, 0] > 180 for b in boxes_px]
        return self.embed_text(["wall" if is_red else "cup" for is_red in red])


class SeesRedWallsInCrops(HashedEmbedder):
    """The same of crops: an ``ImageEmbedder``."""

    def embed_image(self, images):
        return self.embed_text(["wall" if image[len(image) // 2, image.shape[1] // 2, 0] > 180 else "cup" for image in images])


@pytest.mark.parametrize("encoder", [SeesRedWalls(), SeesRedWallsInCrops()])
@pytest.mark.parametrize("structure", ["looks", "auto"])
def test_walls_among_the_segments_go_by_looks(structure, encoder):
    segments = Says(rows((None, RED), (None, BLUE)))
    hybrid = HybridDetector(Says(rows()), segments, classes=["cup"], structure=structure, image_encoder=encoder)
    assert hybrid.detect(frame()).boxes_px.tolist() == [list(BLUE)]
    by_shape = HybridDetector(Says(rows()), segments, classes=["cup"], structure="shape", image_encoder=SeesRedWalls())
    assert len(by_shape.detect(frame())) == 2


def test_without_a_class_list_looks_compare_with_what_was_said():
    detector = Says(rows(("cup", ELSEWHERE)))
    hybrid = HybridDetector(detector, Says(rows((None, RED), (None, BLUE))), structure="looks", image_encoder=SeesRedWalls())
    assert hybrid.detect(frame()).labels == ("cup", None)


def test_a_silent_segmenter_is_noted_once():
    segmenter = Says(Detections.empty())
    hybrid = HybridDetector(Says(rows(("cup", RED))), segmenter)
    notes = []
    for second in range(0, 130, 10):
        assert len(hybrid.detect(frame(float(second)))) == 1
        notes.append(hybrid.notes)
    assert [i for i, said in enumerate(notes) if said] == [6]
    assert "Says" in notes[6][0]
    assert "60 s" in notes[6][0]
    segmenter.answer = rows((None, BLUE))
    hybrid.detect(frame(130.0))
    segmenter.answer = Detections.empty()
    assert [bool(hybrid.detect(frame(t)) and hybrid.notes) for t in (150.0, 189.0, 190.0, 200.0)] == [False, False, True, False]


def test_nothing_anywhere_is_nothing():
    for options in ({}, {"segmenter": Says(Detections.empty())}):
        found = HybridDetector(Says(Detections.empty()), **options).detect(frame(depth_m=np.zeros((HEIGHT, WIDTH))))
        assert len(found) == 0


def test_a_frame_without_depth_keeps_its_detections():
    detector = Says(rows(("cup", RED), with_masks=False))
    found = HybridDetector(detector, Says(rows((None, BLUE)))).detect(frame(depth_m=np.zeros((HEIGHT, WIDTH))))
    assert found.labels == ("cup", None)
    assert found.masks[0].sum() == 1600


@pytest.mark.parametrize("part", ["detector", "segmenter", "masker"])
def test_masks_of_another_size_are_named(part):
    class Large:
        def masks(self, frame, boxes_px):
            return np.ones((len(boxes_px), 480, 640), dtype=np.bool_)

    wrong = {"boxes": [RED], "labels": ["cup"], "masks": np.ones((1, 480, 640), dtype=np.bool_)}
    good = rows(("cup", RED), with_masks=part != "masker")
    parts = {
        "detector": Says(wrong if part == "detector" else good),
        "segmenter": Says(wrong) if part == "segmenter" else None,
        "masker": Large() if part == "masker" else None,
    }
    with pytest.raises(FrameError, match=r"frame 7 \(t=7.0\).*480, 640.*120, 160"):
        HybridDetector(**parts).detect(frame(7.0))


def embedded(found, size):
    return replace(found, embeddings=np.ones((len(found), size)))


def test_embeddings_are_of_one_length():
    named, rest = rows(("cup", RED)), rows((None, BLUE))
    both = HybridDetector(Says(embedded(named, 4)), Says(embedded(rest, 4)), structure="keep").detect(frame())
    assert both.embeddings.tolist() == [[1.0] * 4] * 2
    one = HybridDetector(Says(named), Says(embedded(rest, 3)), structure="keep").detect(frame())
    assert one.embeddings.tolist() == [[0.0] * 3, [1.0] * 3]
    with pytest.raises(FrameError, match=r"frame 2 .*detector are 4 long, of the segmenter 3"):
        HybridDetector(Says(embedded(named, 4)), Says(embedded(rest, 3)), structure="keep").detect(frame(2.0))


def test_it_can_be_made_from_a_configuration(tmp_path):
    (tmp_path / "classes.txt").write_text("cup\nshoe\n", encoding="utf-8")
    options = {"detector": "none", "segmenter": {"name": "none"}, "classes": str(tmp_path / "classes.txt"), "settings": {"merge_iou": 0.7}}
    hybrid = registry.create("detector", Component(name="hybrid", options=options))
    assert isinstance(hybrid, HybridDetector)
    assert hybrid.classes.words == ("cup", "shoe")
    assert len(hybrid.detect(frame())) == 0


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"detector": 3}, ConfigError, "detector is a int"),
        ({"detector": "nome"}, UnknownBackendError, "did you mean 'none'"),
        ({"segmenter": {"nam": "none"}}, ConfigError, "segmenter"),
        ({"masker": 3}, ConfigError, "masker is a int"),
        ({"classes": ["cup", "Cup"]}, ConfigError, "'cup'"),
        ({"structure": "maybe"}, ConfigError, "wanted auto, looks, shape or keep"),
        ({"structure": "looks"}, ConfigError, "needs an image_encoder"),
        ({"image_encoder": HashedEmbedder()}, ConfigError, "embed_image or embed_crops"),
        ({"settings": {"merge_iuo": 0.7}}, ConfigError, "merge_iuo.*known: merge_iou"),
        ({"settings": {"novel_iou": 7}}, ConfigError, "novel_iou"),
        ({"settings": 3}, ConfigError, "HybridSettings"),
    ],
)
def test_bad_parts_are_named(options, error, words):
    with pytest.raises(error, match=words):
        HybridDetector(**({"detector": "none"} | options))
