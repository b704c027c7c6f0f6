# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A room that changes
#
# Eleven things on tables; halfway through the recording two are taken away and three are moved. Everything is known, so a map of
# it can be scored: with three ways to map, with one source of error turned off, and with a part of your own.
#
# It takes half a minute on two cores and needs no data and no network. Open it with Jupyter (the package `jupytext` lets Jupyter
# read this file), or run it as a plain script.

# %%
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

from seo_slam import Agent, Config, Pipeline, RecordedOdometry, Remove, SimulatedRoom
from seo_slam.evaluation.landmarks import evaluate_landmarks
from seo_slam.evaluation.truth import truth_from
from seo_slam.report.truth_svg import truth_svg
from seo_slam.types import heaviest

# %% [markdown]
# ## The room
#
# `SM1` is the first of six rooms with the inventories of SEO-SLAM's Table I. The seed decides where things stand, how the camera
# walks and which mistakes are made; `level` says how bad depth, odometry and detector are (0 perfect, 1 a poor day). Things are
# coloured primitives here; with a folder of meshes (`meshes=...`) they are real models. Drawn frames are kept in `cache`: another
# level, or other mistakes, need not draw them again.

# %%
folder = Path(tempfile.mkdtemp())
view = {"room": "SM1", "seed": 1, "frames": 80, "width": 240, "height": 180, "cache": folder / "drawn"}
room = SimulatedRoom(**view, level=0.5)
frames = list(room)

print("there at first:", ", ".join(thing.label for thing in room.scene.start.things))
for change in room.scene.changes:
    print(f"{change.timestamp_s:.1f} s: {change.event} {change.thing.label}")

# %% [markdown]
# A frame before the change and one after it, with what the detector says. Its masks are the yellow edges.

# %%
shown = (26, 54)
figure, panels = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
for axes, index in zip(panels, shown, strict=True):
    frame = frames[index]
    found = room.detector.detect(frame)
    axes.imshow(frame.rgb)
    for (x0, y0, x1, y1), label, mask in zip(found.boxes_px, found.labels, found.masks, strict=True):
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, color="white", linewidth=0.8))
        axes.contour(mask, levels=[0.5], colors="yellow", linewidths=0.8)
        axes.text(x0 + 1, y0 - 2, label, fontsize=7, bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6})
    axes.set_title(f"{frame.timestamp_s:.1f} s")
    axes.set_axis_off()
plt.show()

# %% [markdown]
# ## Three ways to map it
#
# All get the same frames, the same detections and the same drifting odometry; the truth only scores.
#
# - `rg`: an observation belongs to the nearest landmark. Nothing is ever removed.
# - `rg_d`: the paper's data association, one assignment for all. Nothing is ever removed, either.
# - `seo_slam`, the default: the same association, and landmarks have a life. What should have been seen and was not is lost, then
#   removed; what turns up elsewhere keeps its id. Local agents take out what is nothing.
#
# Ghosts are landmarks where something stood before it was taken or moved away. False ones lie where there was never such a thing.
# The embedder `hashed` only knows spelling, but it loads at once.


# %%
def mapped(room, frames, preset="seo_slam", **parts):
    """The result of a run, what happened to the map when, and the score."""
    odometry = RecordedOdometry(room.odometry)
    news = []
    with Pipeline(Config.preset(preset), detector=room.detector, odometry=odometry, embedder="hashed", **parts) as pipeline:
        for step in pipeline.stream(frames):
            news += [(step.timestamp_s, event) for event in step.events]
        run = pipeline.result()
    return run, news, evaluate_landmarks(run.map.landmarks, truth_from(room.truth))


def row(name, scored):
    kinds = Counter(item.kind for item in scored.extra)
    numbers = f"{scored.score.precision:9.2f} {scored.score.recall:6.2f} {scored.score.f1:5.2f}"
    print(f"{name:<22} {scored.score.landmarks:9d} {numbers} {kinds['duplicate']:10d} {kinds['ghost']:6d} {kinds['false']:5d}")


heading = f"{'':<22} landmarks precision recall    F1 duplicates ghosts false"
runs = {preset: mapped(room, frames, preset) for preset in ("rg", "rg_d", "seo_slam")}
print(heading)
for preset, (_, _, scored) in runs.items():
    row(preset, scored)

# %% [markdown]
# One room and one seed prove little. `benchmarks/semantic_mapping.py` does the same for all six rooms and many seeds.
#
# ## What happened
#
# The change is at 16.6 s. The camera has to come by again before the map can know. A thing may be removed first and found to have
# moved later: its id comes back with it. Not all that is removed was ever there; phantoms go, too.

# %%
run, news, scored = runs["seo_slam"]
for timestamp_s, event in news:
    if event.kind in ("lost", "found", "moved", "removed"):
        print(f"{timestamp_s:4.1f} s  {event.kind:<8} {event.landmark_id:3d}  {event.detail}")

# %% [markdown]
# ## Truth and map, side by side
#
# On the left what stands there at the end (dashed: where things were before), on the right the landmarks, by what they are. The
# picture is an SVG: a notebook shows it, and a file can be opened in a browser.


# %%
class Picture(str):
    """An SVG that a notebook shows."""

    def _repr_svg_(self):
        return str(self)


picture = Picture(truth_svg(run.map.landmarks, truth_from(room.truth), scored, run.trajectory, "SM1, seed 1"))
(folder / "truth_and_map.svg").write_text(picture, encoding="utf-8")
picture

# %% [markdown]
# ## Where do the mistakes come from?
#
# Every source of error is a knob. Here phantoms and loose false boxes are turned off and all else stays as it was, draw by draw:
# what changes is what they cost.

# %%
print(room.detector_knobs)
honest = SimulatedRoom(**view, level=0.5, detector_knobs=replace(room.detector_knobs, phantom_spots=0, spurious=0.0))
honest_frames = list(honest)  # from the cache
assert all(np.array_equal(a.rgb, b.rgb) for a, b in zip(frames, honest_frames, strict=True))

_, _, without_phantoms = mapped(honest, honest_frames)
print(heading)
row("seo_slam", scored)
row("no phantoms", without_phantoms)

# %% [markdown]
# ## Your own part
#
# An agent looks at the map after each keyframe and proposes edits. This one knows what may be in such a room (not where, nor how
# many), and takes out what bears another name. With `associator=Mine` or `detector=Mine()` you try those parts the same way;
# [Your own parts](../docs/plugins.md) has their interfaces.


# %%
class Inventory(Agent):
    """Removes landmarks whose label is not on a list."""

    def __init__(self, words):
        self.words = set(words)

    def propose(self, view):
        rows = zip(view.landmarks.ids, view.landmarks.versions, view.landmarks.labels, strict=True)
        return [Remove(int(i), int(version)) for i, version, labels in rows if heaviest(labels) not in self.words]


words = {word for thing in room.scene.start.things for word in (thing.label, *thing.accepted_labels)}
_, news, scored_with_list = mapped(room, frames, agents=[*Config().agents, Inventory(words)])
print(heading)
row("seo_slam", scored)
row("seo_slam + Inventory", scored_with_list)
removed = Counter(event.detail for _, event in news if event.source == "Inventory")
print("the agent removed:", ", ".join(f"{label} ({times} x)" for label, times in removed.most_common()))

# %% [markdown]
# Does it do harm as well? Look at recall, and try other seeds and rooms: a label that was read wrong at first is taken out with
# all that was known of the place.
#
# ## From the command line
#
# `room.write(folder)` writes a recording like any other, in TUM layout; so does `seo-slam simulate`:
#
#     seo-slam simulate SM1 --seed 1 --level 0.5 --out my_room
#     seo-slam check my_room
#     seo-slam run tum my_room --detector recorded --out my_map
#     seo-slam eval landmarks my_map my_room/truth.json --report my_map/evaluation.html
#     seo-slam eval trajectory my_map/trajectory.txt my_room/groundtruth.txt
#
# The run replays the drifting odometry and the detections of the recording, never the truth. Add `--preset rg` to `run` for
# another way to map, `--meshes DIR` to `simulate` for real models.

# %%
room.write(folder / "my_room")
print(*sorted(path.name for path in (folder / "my_room").iterdir()))

# %% [markdown]
# Next: [simulated rooms](../docs/simulated-rooms.md), [simulated homes](../docs/simulated-homes.md), and
# [benchmarks](../docs/benchmarks.md), where a part of your own runs beside ours in all rooms.
