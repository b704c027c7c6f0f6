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
# # Walk to things
#
# A robot maps an apartment, keeps an abstract map of its furniture and of what lies on it, and is then sent for a thing by name: once
# while it lies where it was, and once after somebody has moved it. This is DualMap, with our parts.
#
# Detector, segmenter and image encoder are simulated, on a middling day (`level=0.5`); poses are given, as DualMap assumes. The
# apartment is made of coloured boxes, so that no file is needed. It takes about a minute on two slow cores. Open it with Jupyter (the
# package `jupytext` lets Jupyter read this file), or run it as a plain script; it needs the extra `nav`.

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from seo_slam import (
    Config,
    HybridDetector,
    Map,
    Navigator,
    Pipeline,
    RecordedOdometry,
    SimulatedApartment,
    SimulatedImageEncoder,
    SimulatedRobot,
    SimulatedSegmenter,
    registry,
)
from seo_slam.abstraction.describing import describe
from seo_slam.driving.errand import errand, moves_in_words
from seo_slam.driving.judging import judged_stop
from seo_slam.navigation.query import candidates
from seo_slam.report.navigation_svg import Search, navigation_svg

folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## The apartment, and who looks at it
#
# The front end has two detectors: one that knows words, and a segmenter that sees whatever else there is. A robot of your own would bring
# an open-vocabulary detector, a segmenter and a CLIP model; here all three are told by the simulation what is in a frame, and err as much
# as the level says.

# %%
home = SimulatedApartment(seed=10, level=0.5, changes=False, width=160, height=120)
words = registry.create("embedder", "auto")
print(f"{home.name}: {len(home.world.things)} things and pieces of furniture, a tour of {home.tour.seconds:.0f} s, {len(home)} frames")
print("words are embedded by", words.name)


def dualmap_of(filmed, odometry, settings=None):
    """The preset `dualmap` for what a camera films: the tour, or a drive."""
    segmenter = SimulatedSegmenter(filmed.detector_knobs, filmed.seed)
    encoder = SimulatedImageEncoder(words, filmed.seed)
    for seer in (segmenter, encoder):
        filmed.show_to(seer)
    front_end = HybridDetector(filmed.detector, segmenter, image_encoder=encoder)
    config = Config.preset("dualmap").updated(settings or {}, "here")
    return Pipeline(config, detector=front_end, odometry=odometry, embedder=encoder)


# %% [markdown]
# ## The tour
#
# The robot is led through all rooms. Only every fourth frame is used, so that this takes half a minute at most; so a thing
# counts once it was seen in 5 frames, not in 8. Fewer frames would leave gaps in the floor, which a robot must not cross.

# %%
with dualmap_of(home, RecordedOdometry(home.trajectory), {"status": {"observations": 5}}) as pipeline:
    for index in range(0, len(home), 4):
        pipeline.step(home.frame(index))
    result = pipeline.result()

mapped = result.map
events = [event.kind for _, event in result.events]
print(mapped)
print({kind: events.count(kind) for kind in sorted(set(events))})

# %% [markdown]
# ## The abstract map
#
# Anchors are what rarely moves. What people carry about is remembered as a word and a feature on its anchor, without a place. Rooms are
# told by doors, and named after the furniture in them. Map and layout are saved in one file.

# %%
print(describe(mapped.abstract))
mapped.save(folder / "map")
for path in sorted((folder / "map").iterdir()):
    print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB")
mapped = Map.load(folder / "map")

# %%
layout = mapped.abstract.layout
picture = np.full((*layout.floor.shape, 3), 255, dtype=np.uint8)
picture[layout.floor] = (226, 232, 222)
picture[layout.obstacles] = (170, 170, 170)
picture[layout.walls] = (60, 60, 60)
low = layout.corner_world
high = low + layout.cell_m * np.array(layout.floor.shape[::-1])
figure, axes = plt.subplots(figsize=(7, 6), layout="constrained")
axes.imshow(picture, origin="lower", extent=(low[0], high[0], low[1], high[1]))
for anchor in mapped.abstract.anchors:
    axes.scatter(*anchor.footprint_world.T, s=1)
    axes.annotate(anchor.label, anchor.xy_world, fontsize=7, ha="center")
axes.set(xlabel="x (m)", ylabel="y (m)")
plt.show()

# %% [markdown]
# ## Where to look for a thing
#
# An anchor's score is the best cosine of the query with its own feature and with those of what is on it (Eq 5); the best one is the
# candidate (Eq 6).

# %%
thing = "the shoe"
for candidate in candidates(mapped.abstract, words.embed_text([thing.removeprefix("the ")])[0])[:4]:
    print(candidate)

# %% [markdown]
# ## Go there
#
# A navigator is asked once, and then given every frame; it says what to do until the next one. So it fits into any robot loop. The
# simulated robot obeys at once, and stops where it touches something.


# %%
class Picture(str):
    """An SVG that a notebook shows."""

    def _repr_svg_(self):
        return str(self)


def driven(trial):
    """Drive one errand; return robot, navigator, and the world as it was."""
    world = trial.world(home.world)
    robot = SimulatedRobot(home, trial.start_xy, trial.start_yaw_rad, world=world, rate_hz=3.0)
    with dualmap_of(robot, robot.odometry) as pipeline:
        navigator = Navigator(mapped.abstract, pipeline, words)
        navigator.ask(trial.query)
        while navigator.outcome is None:
            robot.drive(navigator.step(robot.frame()))
    return robot, navigator, world


def told(trial, robot, navigator, world):
    """Print what the navigator says, and what is true; return a picture of the paths."""
    outcome = navigator.outcome
    for line in navigator.log:
        print("  frame", line)
    print(f"{outcome.ending} after {outcome.places_gone_to} places and {robot.driven_m:.1f} m: {outcome.reason}")
    stop = judged_stop(world, home.free, [world.thing(i) for i in trial.target_ids], robot.xy_world)
    print(f"in truth it is {stop.distance_m:.2f} m away, {'in sight' if stop.in_sight else 'not in sight'}; collisions: {robot.collisions}")
    search = Search(
        abstract_map=mapped.abstract,
        driven_world=np.concatenate([navigator.trace_world, robot.xy_world[None]]),
        planned=[(attempt.candidate.anchor_id, attempt.path_world) for attempt in outcome.attempts if attempt.reached],
        title=f"{trial.query}: {outcome.ending}",
        subtitle=outcome.reason,
        target_world=world.thing(stop.thing_id).p_world,
        believed_world=outcome.target_world,
        success_m=1.0,
    )
    return Picture(navigation_svg(search))


trial = errand(home, thing, seed=0, rooms=mapped.abstract.rooms)
told(trial, *driven(trial))

# %% [markdown]
# ## And after it was moved
#
# Somebody takes it to another piece of furniture. The map does not know. The robot goes where it was, does not find it, learns from what it
# sees on the way, and goes on to where most is to be learned: three places at most.

# %%
moved = errand(home, thing, "cross_anchor", seed=0, rooms=mapped.abstract.rooms)
print(*moves_in_words(home.world, moved), sep="\n")
drive = driven(moved)
told(moved, *drive)

# %% [markdown]
# The map that the navigator was given stays as it was; the one that it learned knows better. Lines that changed:

# %%
robot, navigator, world = drive
before, after = describe(mapped.abstract).splitlines(), describe(navigator.abstract_map).splitlines()
print(*(f"- {line.strip()}" for line in before if line not in after), sep="\n")
print(*(f"+ {line.strip()}" for line in after if line not in before), sep="\n")

# %% [markdown]
# Two drives in one apartment prove little; `benchmarks/navigation.py` makes 185 in three homes.
#
# ## From the command line
#
#     seo-slam navigate my_map "the book" --world apartment:10 --make-map --out paths.svg
#     seo-slam navigate my_map "the book" --world apartment:10 --moved cross_anchor --out paths.svg
#
# Next: [the concrete map](../docs/dualmap.md), [the abstract map](../docs/abstract-map.md), [navigation](../docs/navigation.md).
