"""A made-up household and what people ask for in it: nothing here was chosen after seeing what an embedder makes of it."""

from dataclasses import replace

import numpy as np

from seo_slam.map import Map
from seo_slam.testing.store import make_landmark

# Label, and where it stands (x, y, z in metres).
THINGS = (
    ("green hiking boot", (0.3, -0.5, 0.1)),
    ("brown leather boot", (0.6, -0.5, 0.1)),
    ("red high heel", (0.9, -0.5, 0.05)),
    ("blue water bottle", (2.0, 0.5, 0.8)),
    ("red mug", (2.2, 0.6, 0.8)),
    ("wine glass", (2.4, 0.6, 0.8)),
    ("banana", (2.1, 0.9, 0.8)),
    ("loaf of bread", (2.4, 0.9, 0.8)),
    ("kettle", (2.9, 0.9, 0.9)),
    ("frying pan", (3.2, 0.9, 0.9)),
    ("kitchen knife", (3.4, 0.9, 0.9)),
    ("black backpack", (0.2, 1.5, 0.2)),
    ("umbrella", (0.1, 0.2, 0.4)),
    ("rain jacket", (0.1, 0.5, 1.2)),
    ("bicycle helmet", (0.4, 0.2, 0.1)),
    ("football", (0.8, 1.9, 0.1)),
    ("guitar", (4.0, 3.0, 0.6)),
    ("laptop", (4.5, 1.0, 0.8)),
    ("computer mouse", (4.8, 1.0, 0.8)),
    ("desk lamp", (4.6, 1.4, 1.0)),
    ("office chair", (4.4, 0.4, 0.5)),
    ("sofa", (3.0, 3.5, 0.4)),
    ("pillow", (3.2, 3.5, 0.6)),
    ("television", (3.0, 1.8, 0.7)),
    ("remote control", (3.3, 3.2, 0.5)),
    ("bookshelf", (5.5, 3.5, 1.0)),
    ("cookbook", (3.3, 0.6, 1.0)),
    ("toothbrush", (6.0, 0.5, 0.9)),
    ("shampoo bottle", (6.2, 0.5, 0.9)),
    ("towel", (6.4, 0.9, 1.1)),
    ("flower vase", (2.6, 0.4, 0.8)),
    ("teddy bear", (5.0, 3.8, 0.5)),
)

# A request, and the things that would serve it.
REQUESTS = (
    (
        "I am going hiking, anything good?",
        ("green hiking boot", "brown leather boot", "black backpack", "rain jacket", "blue water bottle"),
    ),
    ("It is raining and I have to go out", ("umbrella", "rain jacket")),
    ("I am thirsty", ("blue water bottle", "red mug", "wine glass", "kettle")),
    ("something to carry my books to school", ("black backpack",)),
    ("I want to make some tea", ("kettle", "red mug")),
    ("what can I eat right now?", ("banana", "loaf of bread")),
    ("I would like to fry an egg", ("frying pan",)),
    ("something to cut the vegetables with", ("kitchen knife",)),
    ("where could I take a nap?", ("sofa", "pillow")),
    ("I need to write an email", ("laptop", "computer mouse")),
    ("it is too dark to read here", ("desk lamp",)),
    ("I would like to make music", ("guitar",)),
    ("what should I wear to a formal party?", ("red high heel",)),
    ("let's play in the garden", ("football",)),
    ("I want to watch the news", ("television", "remote control")),
    ("how do I change the channel?", ("remote control", "television")),
    ("something that protects my head when I ride my bike", ("bicycle helmet",)),
    ("I want to wash my hair", ("shampoo bottle", "towel")),
    ("my teeth need cleaning", ("toothbrush",)),
    ("I got flowers for my birthday", ("flower vase",)),
    ("find a recipe for dinner", ("cookbook",)),
    ("my child wants something to cuddle", ("teddy bear", "pillow")),
    ("dry my hands", ("towel",)),
    ("where can I sit down and work?", ("office chair", "sofa")),
)

# Written after the rule for what stands out was settled on the requests above and HOPELESS, and never used to change it.
HELD_OUT = (
    ("what do I need for a camping trip?", ("black backpack", "green hiking boot", "blue water bottle", "rain jacket")),
    ("somewhere to put these roses", ("flower vase",)),
    ("I would like a toast for breakfast", ("loaf of bread",)),
    ("I just stepped out of the shower and I am wet", ("towel",)),
    ("a snack with vitamins", ("banana",)),
    ("pour some coffee for our guest", ("red mug", "kettle")),
    ("let us toast to the newlyweds", ("wine glass",)),
    ("the storm is coming, what should I take along?", ("umbrella", "rain jacket")),
    ("I want to score a goal", ("football",)),
    ("play a song for us", ("guitar",)),
    ("program a website", ("laptop", "computer mouse")),
    ("I have to click on something", ("computer mouse",)),
    ("find me a novel", ("bookshelf",)),
    ("lay my head down", ("pillow", "sofa")),
    ("a toy for the baby", ("teddy bear",)),
    ("make the room brighter", ("desk lamp",)),
)

# Requests that nothing in the household serves.
HOPELESS = (
    "where is the swimming pool?",
    "I need a fire extinguisher",
    "feed the dog",
    "I want to play chess",
    "a hammer and some nails",
    "what is the capital of France?",
    "charge my electric car",
    "I need a passport",
)

# The same, held out.
HOPELESS_HELD_OUT = (
    "is there a printer?",
    "I want to iron my shirt",
    "water for the goldfish",
    "where are my car keys?",
    "take a photograph",
    "hang a picture on the wall",
    "what time is it?",
    "I want to paint the fence",
)


def household(embedder: str = "hashed") -> Map:
    """The map of it."""
    rows = [
        replace(make_landmark(i, where), label=label, labels={label: 1.0}, embedding=np.zeros(0)) for i, (label, where) in enumerate(THINGS)
    ]
    return Map(rows, "poses", embedder)
