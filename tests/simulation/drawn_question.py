"""Questions as agents ask them, about boxes of a frame, with a note in the image that says where they lie."""

import json

import cv2
import numpy as np

from seo_slam.agents.provenance import Panel, Provenance, with_provenance
from seo_slam.interfaces import ChatRequest
from seo_slam.simulation.masks import patches_of

BLACK = cv2.imencode(".jpg", np.zeros((64, 64, 3), dtype=np.uint8))[1].tobytes()


def true_boxes(rendered, least_px=200):
    """Thing id -> box of its visible pixels, for things that show enough of them."""
    return {k: patch.box_px() for k, patch in patches_of(rendered.instance_ids).items() if patch.pixels.sum() >= least_px}


def image_of(frame, *boxes, size=512.0):
    """A JPEG with the whole frame scaled into a square, and boxes 1, 2, … of the frame drawn in it."""
    panel = Panel((0.0, 0.0, float(frame.camera.width), float(frame.camera.height)), (0.0, 40.0, size, size - 40.0), {})
    drawn = {str(number): panel.in_image(tuple(map(float, box))) for number, box in enumerate(boxes, start=1)}
    panel = Panel(panel.source, panel.target, drawn)
    return with_provenance(BLACK, Provenance(frame.timestamp_s, frame.camera.width, frame.camera.height, (panel,)))


def question(role, frame, boxes, labels, positions_m=(), known_labels=(), separate_beyond_m=0.1):
    """A request of one of the three agents."""
    landmarks = [{"box": number, "label": label} for number, label in enumerate(labels, start=1)]
    for entry, position in zip(landmarks, positions_m, strict=False):
        entry["position_m"] = list(position)
    asked = {"landmarks": landmarks}
    if role == "description":
        asked["known_labels"] = list(known_labels)
    if role == "merging":
        asked["separate_beyond_m"] = separate_beyond_m
    return ChatRequest("Look.", "Boxes:\n" + json.dumps(asked), (image_of(frame, *boxes),))


def ask(model, *args, **options):
    """The reply of a model to such a request, read."""
    return json.loads(model(question(*args, **options)))


def verdicts(model, frame, boxes, labels):
    return [verdict["score"] for verdict in ask(model, "verification", frame, boxes, labels)["verdicts"]]
