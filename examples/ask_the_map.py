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
# # Ask the map
#
# A simulated room is mapped and then asked in everyday words, as in Fig 7 of the SEO-SLAM paper: first by embedding alone, then with
# a chat model that words the answer. The chat model here is a script, so that nothing needs a key or a network.
#
# It takes under 20 s on two cores. Open it with Jupyter (the package `jupytext` lets Jupyter read this file), or run it as a plain
# script.

# %%
import json

from seo_slam import Pipeline, RecordedOdometry, SimulatedRoom
from seo_slam.ask import ask
from seo_slam.interfaces import ChatReply

# %% [markdown]
# ## A map
#
# The embedder is the best that this machine has: with the extra `minilm` one that knows meaning, without it one that only knows
# spelling.

# %%
room = SimulatedRoom("SM1", seed=1, frames=40, width=240, height=180, level=0.5)
with Pipeline(detector=room.detector, odometry=RecordedOdometry(room.odometry)) as pipeline:
    for _ in pipeline.stream(room):
        pass
    house = pipeline.result().map

print("embedder:", house.embedder)
for landmark in house.landmarks:
    print(landmark.id, landmark.label, landmark.position_m.round(2))

# %% [markdown]
# ## Without a language model
#
# Every thing gets a score: the cosine of the question's embedding with that of its labels. No fixed score says "this fits", since
# words that have nothing to do with each other have no cosine of 0. So a thing is named only if its score stands out from those of
# the rest of the map; else the answer says that nothing does.

# %%
for question in ("let us play tennis", "I want to cut some paper", "where can I sit down?", "I need a screwdriver"):
    print(ask(house, question).text, end="\n\n")

# %% [markdown]
# What a program needs is beside the text: the landmarks with their positions, and every score.

# %%
answer = ask(house, "where can I sit down?")
for landmark in answer.landmarks:
    print("go to", landmark.position_m.round(2))
for hit in answer.hits[:3]:
    print(f"{hit.landmark.label:<10} {hit.score:.2f}", "stands out" if hit.stands_out else "")

# %% [markdown]
# ## With a chat model
#
# A model knows what things are good for. It is shown the retrieved landmarks as one line of JSON: no image, and nothing else of the
# map. (This room is small enough to show all of it.) This one is a script that prints what it is shown; a real one is made with
# `registry.create("chat_model", Component(name="openai", options={"model": ..., "base_url": ...}))`.


# %%
class Scripted:
    """Says what it is told to say."""

    name = "scripted"

    def __init__(self, *replies):
        self.replies = list(replies)

    async def complete(self, request):
        shown = json.loads(request.text)["landmarks"]
        print("   (it is shown:", ", ".join(f"{row['id']} {row['label']}" for row in shown), end=")\n")
        return ChatReply(json.dumps(self.replies.pop(0)), self.name)


question, everything = "I am going hiking, anything good?", len(house)
bag, shoe = (next(row for row in house.landmarks if (row.category or row.label) == label) for label in ("bag", "shoe"))
good = {
    "answer": f"Yes! Take the bag ({bag.id}) for food and water, and the shoes ({shoe.id}) if the path is easy.",
    "landmarks": [{"id": bag.id, "why": "carries what you need"}, {"id": shoe.id, "why": "better than bare feet"}],
}
print(ask(house, question, Scripted(good), k=everything).text)

# %% [markdown]
# The positions are those of the map, whatever the model says. And what it says is checked: an answer that names an id that it was not
# shown, or a place where nothing is, goes back once; if the next one is no better, it is refused, and the ranked list is the answer.

# %%
invented = {"answer": "Take the mountain boots (99).", "landmarks": [{"id": 99, "why": "great grip"}]}
misplaced = {"answer": f"The bag ({bag.id}) is at (12.0, 7.5).", "landmarks": [{"id": bag.id, "why": "roomy"}]}

mended = ask(house, question, Scripted(invented, good), k=everything)
print("mended:", mended.source, [row.label for row in mended.landmarks])

refused = ask(house, question, Scripted(invented, misplaced), k=everything)
print("refused:", refused.refused)
print(refused.text)

# %% [markdown]
# From the command line:
#
#     seo-slam ask my_map "I am going hiking, anything good?"
#     seo-slam ask my_map "I am going hiking, anything good?" --chat-model llama3.2 --chat-url http://localhost:11434/v1
#
# Next: [how `ask` works](../docs/ask.md), and how well.
