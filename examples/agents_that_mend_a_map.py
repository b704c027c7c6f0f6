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
# # Agents that mend a map
#
# A simulated room on a poor day: the detector sees boxes, shelves and posters in bare walls, and calls things by wrong names. Agents
# look at the map while it is made and propose edits: first the local ones, then the three of the SEO-SLAM paper, which ask a chat model.
# That model is simulated here: it answers over HTTP from the pixels inside the boxes that it is sent, and is wrong as often as it is
# told to be. So nothing needs a key or a network, and no score below says how good a real model is.
#
# It takes about half a minute on two cores. Open it with Jupyter (the package `jupytext` lets Jupyter read this file), or run it as a
# plain script.

# %%
import tempfile
import time
from collections import Counter
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np

from seo_slam import Agent, Config, Confirm, Doubt, Map, Pipeline, RecordedOdometry, Remove, SimulatedRoom, read_edits, undo_edit
from seo_slam.config import chat_agents
from seo_slam.evaluation.landmarks import evaluate_landmarks
from seo_slam.evaluation.truth import truth_from
from seo_slam.run_files import prepare_folder
from seo_slam.run_recording import run_recording
from seo_slam.simulation.chat_answers import ACCURACY, SimulatedChat
from seo_slam.simulation.chat_question import role_of
from seo_slam.testing import ChatServer, check_agent

folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## The room
#
# `level=1.0` is a poor day, twice the level of the other examples. The simulated model watches the room, so that it
# can tell later what is in a picture; the map never learns any of this.

# %%
room = SimulatedRoom("SM1", seed=3, level=1.0, frames=70, width=320, height=240)
model = SimulatedChat.watching(room, seed=1)
frames = list(room)
truth = truth_from(room.truth)
print(len(frames), "frames over", round(frames[-1].timestamp_s - frames[0].timestamp_s), "s")
print("accuracy of the simulated model:", dict(ACCURACY))


# %%
def mapped(agents, **settings):
    """Map the room with some agents; return the result and everything that they proposed."""
    edits = []
    config = Config().updated({"agents": agents, **settings}, "here")
    with Pipeline(config, detector=room.detector, odometry=RecordedOdometry(room.odometry), embedder="hashed") as pipeline:
        for step in pipeline.stream(frames):
            edits += step.edits
        edits += pipeline.drain()
        return pipeline.result(), edits


def row(name, result):
    scored = evaluate_landmarks(result.map.landmarks, truth)
    kinds = Counter(item.kind for item in scored.extra)
    numbers = f"{scored.score.precision:9.2f} {scored.score.recall:6.2f} {scored.score.f1:5.2f}"
    print(f"{name:<14} {scored.score.landmarks:9d} {numbers} {kinds['duplicate']:10d} {kinds['ghost']:6d} {kinds['false']:5d}")


heading = f"{'':<14} landmarks precision recall    F1 duplicates ghosts false"

# %% [markdown]
# ## Without agents, and with local ones
#
# The local agents are the default, of `Pipeline()` and of `seo-slam run`. They use what the map knows, depth and colour, and ask nobody.

# %%
without, _ = mapped([])
local, local_edits = mapped([agent.model_dump() for agent in Config().agents])
print(heading)
row("no agents", without)
row("local agents", local)
print("the local agents proposed:", dict(Counter(edit.kind for edit in local_edits)))

# %% [markdown]
# ## The three agents of the paper
#
# Verification, description and merging each ask the model at a URL. `ChatServer` is a real server on this machine; what it is asked is
# kept here to be looked at. (`--agents chat` keeps the local verification agent beside them; here they are alone.) This is the inline
# mode: every keyframe waits for the answers, and the result is the same each time.

# %%
sent = []


def answers(request):
    """What the simulated model says, and a note of it."""
    answer = model(request)
    sent.append((request, answer))
    return answer


def asking(server):
    """The three agents, all asking one server."""
    return chat_agents({"model": "simulated", "base_url": server.base_url, "reply_format": "json_schema"})


with ChatServer(answers) as server:
    chat, edits = mapped(asking(server))

print(heading)
row("no agents", without)
row("chat agents", chat)
print("asked:", dict(Counter(role_of(request) for request, _ in sent)))

# %% [markdown]
# One room and one seed prove little; `benchmarks/semantic_mapping.py` does this for six rooms and many seeds.
#
# ## What the model was shown
#
# One question of each agent, as it went over the wire: its pictures, the last line of its text, and the answer. The numbers are new in
# every picture. Landmark ids stay in the process.


# %%
def telling(role):
    """Question and answer of an agent: of those about most landmarks the one with the most objections."""
    asked = [(request, answer) for request, answer in sent if role_of(request) == role]
    return max(asked, key=lambda pair: (pair[0].text.count('"box"'), -pair[1].count('"score": 1.0')), default=None)


def show(request, answer):
    """Draw the pictures of a question, with question and answer."""
    pictures = [cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_COLOR)[..., ::-1] for image in request.images]
    widths = [picture.shape[1] / picture.shape[0] for picture in pictures]
    _figure, panels = plt.subplots(1, len(pictures), figsize=(4 * sum(widths), 4), width_ratios=widths, squeeze=False, layout="constrained")
    for axes, picture in zip(panels[0], pictures, strict=True):
        axes.imshow(picture)
        axes.set_axis_off()
    plt.show()
    print("asked:   ", request.text)
    print("answered:", answer)


for role in ("verification", "description", "merging"):
    print(f"--- {role}")
    if (pair := telling(role)) is not None:
        show(*pair)

# %% [markdown]
# ## What became of what they said
#
# A verdict is evidence. Most change nothing and are *noted*; a landmark is removed, renamed or merged once what was said of it, together
# with what was seen of it, leaves little doubt. Below is what was changed, when, from a look at which keyframe, and why.

# %%
for (kind, outcome), number in sorted(Counter((edit.kind, edit.outcome) for edit in edits).items()):
    print(f"{kind:<8} {outcome:<8} {number:4d}")
print()
changes = [edit for edit in edits if edit.outcome == "applied" and edit.kind != "confirm"]
for edit in changes:
    into = f" into {edit.other_id}" if edit.kind == "merge" else ""
    print(f"{edit.timestamp_s:5.1f} s  {edit.agent:<12} {edit.kind:<8} {edit.landmark_id:3d}{into}  {edit.detail}")

# %% [markdown]
# Each change has a history. All that was said of a landmark that was removed:

# %%
removed = {edit.landmark_id for edit in changes if edit.kind == "remove"}
said_of = Counter(edit.landmark_id for edit in edits if edit.landmark_id in removed)
for edit in edits:
    if said_of and edit.landmark_id == max(said_of, key=said_of.get):
        print(f"{edit.timestamp_s:5.1f} s  {edit.agent:<12} {edit.kind:<8} {edit.outcome:<8} {edit.detail}")

# %% [markdown]
# And a landmark that stayed, although the model denied or doubted it: what was seen and what was said before outweigh it. How much a
# model is worth is measured in the run, by how often it contradicts what is sure.

# %%
against = Counter(edit.landmark_id for edit in edits if edit.kind in ("doubt", "remove") and edit.landmark_id not in removed)
for edit in [edit for edit in edits if against and edit.landmark_id == max(against, key=against.get)][:12]:
    print(f"{edit.timestamp_s:5.1f} s  {edit.agent:<12} {edit.kind:<8} {edit.outcome:<8} {edit.detail}")

# %% [markdown]
# The landmarks at the end. A description is a name that tells alike things apart; the plain word beside it is for association and scores.

# %%
for landmark in chat.map.landmarks:
    x, y, z = landmark.position_m
    print(f"{landmark.id:3d}  {landmark.label:<18} {landmark.category or '-':<12} at {x:5.2f} {y:5.2f} {z:5.2f} m")

# %% [markdown]
# ## In the background
#
# A robot does not wait. In the background mode one thread asks up to eight questions at once, and each keyframe takes what has been
# answered by then. Here the model takes 0.2 s to answer, and the frames come at ten times their true pace. `drain` waits for the last
# answers at the end of a recording; `poll` takes what is there when no frame comes. What the answers are about may have changed
# meanwhile: such an edit is *stale*.

# %%
with ChatServer(model, latency_s=0.2) as server:
    config = Config().updated({"agents": asking(server), "runner": {"mode": "background", "view_period_s": 0.0}}, "here")
    with Pipeline(config, detector=room.detector, odometry=RecordedOdometry(room.odometry), embedder="hashed") as pipeline:
        on_the_way, slowest_s, previous_s = [], 0.0, frames[0].timestamp_s
        for frame in frames[:40]:
            time.sleep((frame.timestamp_s - previous_s) / 10)
            previous_s = frame.timestamp_s
            step = pipeline.step(frame)
            on_the_way += step.edits
            slowest_s = max(slowest_s, step.seconds.get("agents", 0.0))
        at_the_end = pipeline.drain(timeout_s=20.0)
        counts = pipeline.result().agents

print(f"edits on the way: {len(on_the_way)}, at the end: {len(at_the_end)}; most that a keyframe spent on agents: {1e3 * slowest_s:.0f} ms")
print("at once in the server:", server.most_in_flight, "questions")
for agent in counts["agents"]:
    print(
        f"{agent['name']:<12} asked {agent['asked']}, answered {agent['answered']}, failed {agent['failed']}, proposed {agent['proposed']}"
    )
print(Counter(edit.outcome for edit in (*on_the_way, *at_the_end)))

# %% [markdown]
# ## Taking one back
#
# A run that writes a folder keeps every edit with what was before it. `seo-slam edits FOLDER` lists them, and the report shows those
# that changed something, with pictures. Here one removal is undone: the landmark is in the saved map again, under its old id.

# %%
with ChatServer(model) as server:
    saved = prepare_folder(folder / "result", overwrite=False)
    config = Config().updated({"agents": asking(server), "store": {"name": "sqlite", "options": {"path": str(saved / "map.db")}}}, "here")
    pipeline = Pipeline(config, detector=room.detector, odometry=RecordedOdometry(room.odometry), embedder="hashed")
    run_recording(frames[:40], pipeline, saved, dataset="SM1, seed 3")

numbered = list(enumerate(read_edits(saved), start=1))
changed = [(n, e) for n, e in numbered if e.outcome == "applied" and e.kind in ("remove", "relabel", "merge")]
number, edit = max(changed, key=lambda item: (item[1].kind == "remove", item[0]))
print(f"edit {number}: {edit.kind} of landmark {edit.landmark_id}, {edit.detail}; asked with prompt {edit.prompt_hash}")
ids = {landmark.id for landmark in Map.load(saved).landmarks}
print("undone:", undo_edit(saved, number).detail)
print("back in the map:", {landmark.id for landmark in Map.load(saved).landmarks} - ids)
print(*sorted(path.name for path in saved.iterdir()))

# %% [markdown]
# ## An agent of your own
#
# One method. `role` says when it is asked; this one verifies, so it gets the landmarks in view, new ones first, and its verdicts count
# as evidence beside those of others. It knows what may be in this room, and looks at nothing else.


# %%
class Inventory(Agent):
    """Confirms what is on a list, and finds all else to be nothing."""

    role = "verification"
    most_landmarks = 8

    def __init__(self, words):
        self.words = {word.casefold() for word in words}

    def propose(self, view):
        edits = []
        for landmark_id, version, labels in zip(view.landmarks.ids, view.landmarks.versions, view.landmarks.labels, strict=True):
            if landmark_id in (view.asked or view.boxes_px):
                said = {word.casefold() for word in labels}
                verdict = Confirm if said <= self.words else Doubt if said & self.words else Remove
                edits.append(verdict(int(landmark_id), int(version), self.name))
        return edits


words = {word for thing in room.scene.start.things for word in (thing.label, *thing.accepted_labels)}
check_agent(Inventory(words))
with Pipeline(agents=[Inventory(words)], detector=room.detector, odometry=RecordedOdometry(room.odometry), embedder="hashed") as pipeline:
    for _ in pipeline.stream(frames):
        pass
    own = pipeline.result()

print(heading)
row("no agents", without)
row("Inventory", own)
print({f"{line['kind']} {line['outcome']}": line["number"] for line in own.agents["edits"]})

# %% [markdown]
# ## From the command line
#
#     seo-slam run tum my_recording --out result
#     seo-slam run tum my_recording --out result2 --agents chat --chat-model gpt-4o-mini
#     seo-slam run tum my_recording --out result3 --agents chat --chat-model qwen2.5vl --chat-url http://127.0.0.1:11434/v1
#     seo-slam edits result2 --outcome applied
#     seo-slam edits result2 --undo 7
#
# The key of a hosted model comes from the environment (`OPENAI_API_KEY`, or the variable that `--key-env` names).
#
# Next: [agents](../docs/agents.md), [chat models](../docs/chat-models.md), [testing agents](../docs/testing-agents.md).
