"""The pictures that models get: what is drawn lies where the note says, numbers can be read, and the frame stays as it was."""

import itertools

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.agents.chips import CHIP_PX, chip_place, rect_gap
from seo_slam.agents.compose import description_image, merging_images, verification_image
from seo_slam.agents.drawing import COLOURS, RED, Drawing, window_around
from seo_slam.agents.provenance import provenance_of
from seo_slam.camera import Camera
from seo_slam.interfaces import AgentView
from seo_slam.types import Frame, Landmark, Landmarks

CAMERA = Camera(500.0, 500.0, 319.5, 239.5, 640, 480)
BOXES = ((100, 120, 160, 200), (300, 200, 420, 260), (302, 203, 424, 263), (500, 300, 520, 340), (560, 380, 640, 480), (5, 5, 30, 25))


def view_of(boxes=BOXES, depths_m=None):
    rows, columns = np.mgrid[0:480, 0:640]
    rgb = np.stack([60 + columns // 8, 60 + rows // 6, 120 + (rows + columns) // 16], axis=-1).astype(np.uint8)
    landmarks = [
        Landmark(10 * k, "cup", {"cup": 1.0}, np.array([0.0, 0.0, 2.0 if depths_m is None else depths_m[k - 1]]), 1e-4 * np.eye(3),
                 np.full(3, 0.1), np.zeros(4), 5, 0.0, 1.0, "stable", 3)
        for k in range(1, len(boxes) + 1)
    ]  # fmt: skip
    boxes_px = {10 * k: np.array(box, dtype=float) for k, box in enumerate(boxes, start=1)}
    return AgentView(Frame(4.5, rgb, np.full((480, 640), 2.0, np.float32), CAMERA), np.eye(4), Landmarks.from_rows(landmarks), boxes_px)


def decoded(jpeg):
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB).astype(int)


def is_near(pixels, colour, within=60):
    return np.abs(pixels - np.array(colour)).max(axis=-1) < within


def outline_pixels(image, box, panel):
    """Pixels in the middle of the line around a box, without the corners; at the border of its panel the line lies inside."""
    x0, y0, x1, y1 = (int(edge) for edge in box)
    left, above, right, below = (int(edge) for edge in panel.target)
    above, below, left, right = max(y0 - 2, above + 1), min(y1 + 1, below - 2), max(x0 - 2, left + 1), min(x1 + 1, right - 2)
    return np.concatenate([image[above, x0:x1], image[below, x0:x1], image[y0:y1, left], image[y0:y1, right]])


def all_images(view):
    ids = tuple(view.boxes_px)
    return {
        "verification": verification_image(view, ids[:4]).images,
        "single": verification_image(view, ids[4:5]).images,
        "description": description_image(view, ids[3]).images,
        "merging": merging_images(view, ids).images,
    }


def test_sizes_are_those_of_the_paper():
    shapes = {kind: [decoded(image).shape[:2] for image in images] for kind, images in all_images(view_of()).items()}
    assert shapes["verification"] == shapes["single"] == shapes["description"] == [(512, 512)]
    assert shapes["merging"] == [(512, 512), (512, 1024)]


@pytest.mark.parametrize("kind", ["verification", "single", "description", "merging"])
def test_boxes_are_drawn_where_the_note_says(kind):
    for image in all_images(view_of())[kind]:
        pixels, note = decoded(image), provenance_of(image)
        assert (note.timestamp_s, note.width, note.height) == (4.5, 640, 480)
        boxes = [(int(n), box, panel) for panel in note.panels for n, box in panel.boxes.items()]
        assert boxes
        apart = [entry for entry in boxes if kind != "merging" or entry[0] not in (2, 3)]  # those two are drawn over each other
        for number, box, panel in apart:
            colour = COLOURS[number - 1] if kind == "merging" else RED
            assert is_near(outline_pixels(pixels, box, panel), colour).mean() > 0.9


@pytest.mark.parametrize("kind", ["verification", "description", "merging"])
def test_the_note_maps_boxes_back_to_those_of_the_view(kind):
    view = view_of()
    order = {"verification": (10, 20, 30, 40), "description": (40,), "merging": tuple(view.boxes_px)}[kind]
    for image in all_images(view)[kind]:
        for panel in provenance_of(image).panels:
            for number, box in panel.boxes.items():
                magnified = (panel.target[2] - panel.target[0]) / (panel.source[2] - panel.source[0])
                expected = view.boxes_px[order[int(number) - 1]]
                assert panel.in_frame(box) == pytest.approx(expected, abs=1.0 / magnified + 0.5)


def test_the_pixels_inside_a_box_are_the_frames():
    view = view_of()
    image = description_image(view, 20).images[0]
    panel = provenance_of(image).panels[0]
    x0, y0, x1, y1 = (round(edge) for edge in panel.boxes["1"])
    middle = decoded(image)[(y0 + y1) // 2, (x0 + x1) // 2]
    assert np.abs(middle - view.frame.rgb[230, 360].astype(int)).max() < 12


def test_the_frame_is_left_alone_and_the_same_view_gives_the_same_bytes():
    view = view_of()
    before = view.frame.rgb.copy()
    assert all_images(view) == all_images(view_of())
    assert np.array_equal(view.frame.rgb, before)


def test_no_note_holds_a_landmark_id():
    view = view_of(boxes=((100, 120, 160, 200),) * 2)
    view = AgentView(view.frame, view.T_world_camera, view.landmarks, {77123: view.boxes_px[10]}, 0)
    assert b"77123" not in description_image(view, 77123).images[0]


def test_a_covered_thing_far_behind_is_left_out_of_the_scene_and_the_order_says_so():
    view = view_of(boxes=((100, 100, 300, 300), (150, 150, 200, 200), (400, 100, 450, 150)), depths_m=(1.0, 3.0, 1.0))
    composed = merging_images(view, (10, 20, 30))
    assert composed.ids == (10, 30)
    assert [set(panel.boxes) for panel in provenance_of(composed.images[1]).panels] == [{"1"}, {"2"}]


def test_a_small_thing_fills_a_good_part_of_its_picture():
    _, y0, _, y1 = provenance_of(description_image(view_of(), 40).images[0]).panels[0].boxes["1"]
    assert y1 - y0 > 120


def test_a_scene_is_zoomed_to_its_boxes_but_not_to_one_of_them():
    image = merging_images(view_of(boxes=((100, 120, 120, 140), (130, 120, 150, 140))), (10, 20)).images[0]
    x0, _, x1, _ = provenance_of(image).panels[0].source
    assert x1 - x0 == pytest.approx(0.6 * 480, abs=1)


def test_more_than_fit_are_not_drawn():
    view = view_of(boxes=BOXES * 2)
    assert len(verification_image(view, tuple(view.boxes_px)).ids) == 4
    assert len(merging_images(view, tuple(view.boxes_px)).ids) == 8


def test_number_plates_can_be_read():
    assert CHIP_PX >= 24  # of 512
    drawing = Drawing(view_of().frame, 512, 512)
    drawing.add((0, 0, 480, 480), (0, 0, 512, 512), {3: np.array([200.0, 200, 300, 300])}, COLOURS)
    x0, y0, x1, y1 = drawing.chips[0]
    plate = drawing.pixels[y0 + 2 : y1 - 2, x0 + 2 : x1 - 2].astype(int)
    ink = is_near(plate, (255, 255, 255))
    assert np.ptp(np.flatnonzero(ink.any(axis=1))) >= 14  # the figure's height
    assert 0.1 < ink.mean() < 0.5
    assert is_near(plate, COLOURS[2]).mean() > 0.4


@pytest.mark.parametrize("colour", COLOURS)
def test_figures_stand_out_from_their_plates(colour):
    drawing = Drawing(view_of().frame, 256, 256)
    drawing.add((0, 0, 200, 200), (0, 0, 256, 256), {1: np.array([50.0, 60, 90, 100])}, (colour,))
    x0, y0, x1, y1 = drawing.chips[0]
    grey = drawing.pixels[y0 + 2 : y1 - 2, x0 + 2 : x1 - 2].astype(float) @ [0.299, 0.587, 0.114]
    assert np.ptp(grey) > 100


some_boxes = st.lists(st.tuples(st.integers(0, 600), st.integers(0, 440), st.integers(2, 300), st.integers(2, 300)), min_size=1, max_size=8)


@given(some_boxes)
@settings(max_examples=40, deadline=None)
def test_plates_lie_inside_and_never_over_each_other(boxes):
    drawing = Drawing(view_of().frame, 512, 512)
    numbered = {k: np.array([x, y, min(x + w, 640), min(y + h, 480)], dtype=float) for k, (x, y, w, h) in enumerate(boxes, start=1)}
    drawing.add((0, 0, 640, 480), (0, 0, 512, 512), numbered, COLOURS)
    assert len(drawing.chips) == len(numbered)
    for x0, y0, x1, y1 in drawing.chips:
        assert 0 <= x0 < x1 <= 512
        assert 0 <= y0 < y1 <= 512
    for a, b in itertools.combinations(drawing.chips, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]


def test_a_plate_covers_no_box_where_there_is_room():
    placed = []
    boxes = [(100, 100, 140, 160), (150, 100, 190, 160), (100, 170, 190, 200), (200, 100, 260, 200)]
    for box in boxes:
        chip = chip_place(box, [other for other in boxes if other != box], placed, (0, 0, 512, 512))
        placed.append(chip)
        assert all(chip[2] <= b[0] or b[2] <= chip[0] or chip[3] <= b[1] or b[3] <= chip[1] for b in boxes)
        assert rect_gap(chip, box) < 40


def test_a_box_that_fills_its_panel_gets_its_plate_in_a_corner():
    assert chip_place((2, 2, 254, 254), [], [], (2, 2, 254, 254))[:2] == (2, 2)


@given(st.floats(-50, 640), st.floats(-50, 480), st.floats(1, 700), st.floats(1, 500))
def test_windows_lie_in_the_image(x, y, w, h):
    x0, y0, x1, y1 = window_around(np.array([x, y, x + w, y + h]), 2.0, 64.0, 640.0, 640, 480)
    assert 0 <= x0 < x1 <= 640
    assert 0 <= y0 < y1 <= 480


@pytest.mark.parametrize("box", [(-40, -40, 20, 20), (630, 470, 700, 600), (700, 500, 720, 520), (-100, 100, -50, 120), (0, 0, 640, 480)])
def test_boxes_over_and_beyond_the_border_are_drawn_inside(box):
    view = view_of(boxes=(box,))
    for image in (description_image(view, 10).images[0], verification_image(view, (10,)).images[0]):
        panel = provenance_of(image).panels[0]
        x0, y0, x1, y1 = panel.boxes["1"]
        assert panel.target[0] <= x0 < x1 <= panel.target[2]
        assert panel.target[1] <= y0 < y1 <= panel.target[3]
