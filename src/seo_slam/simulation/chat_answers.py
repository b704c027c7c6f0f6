"""A simulated vision-language model with a stated accuracy. It answers the three agents from what is in the boxes of the image it is sent.

It is shown each frame as it is drawn (``recording.show_to(simulated)``) and reads from the note inside the JPEG
(``agents.provenance``) which part of which frame lies in each drawn box. It then counts pixels of the instance image there
(``box_contents``). It never learns of landmarks: what it judges is what was drawn.

What it says when it is right:

- verification: 1.0 if the label names the thing in the box (``chat_words.names``), 0.0 if another thing is in it, -1.0 if it cannot be
  told what is in it.
- description: the thing's colour and label ("yellow banana"), and its label as the category; a known label if one is identical; N/A for
  both if it cannot be told.
- merging: boxes that show the same thing are duplicates; best is the box that goes best with its pixels.

It is wrong with probability 1 - accuracy. A share ``sticky`` of these draws belongs to the thing (or the place, where there is none) and
the side it is seen from, the rest to the frame: the same mistake comes back from the same side, as with a real model. Draws are keyed, so
that neither order nor number of questions changes an answer. What it says when it is wrong:

- verification: one of the two other verdicts, evenly.
- description: one time in four of a thing N/A, else the label of a look-alike; of nothing, the label of a thing that is not there.
- merging: it misses the duplicates of a thing; where there are none, it joins the two boxes that are nearest to each other.
"""

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from seo_slam.agents.provenance import Provenance, provenance_of
from seo_slam.errors import ChatRequestError, ConfigError
from seo_slam.interfaces import ChatReply, ChatRequest
from seo_slam.simulation.box_contents import BoxContents, contents_of
from seo_slam.simulation.chat_question import AskedBox, Question, question_of
from seo_slam.simulation.chat_tokens import tokens_of_question, tokens_of_text
from seo_slam.simulation.chat_words import NOT_TOLD, described, look_alike, names
from seo_slam.simulation.draws import generator
from seo_slam.simulation.labels import LOOK_ALIKES, PHANTOM_LABELS
from seo_slam.simulation.shown_frames import ShownFrame
from seo_slam.simulation.simple_reply import simplest_reply
from seo_slam.simulation.visible import View
from seo_slam.simulation.world import World

ACCURACY: Mapping[str, float] = {"verification": 0.85, "description": 0.90, "merging": 0.90}
"""Role -> how often the model is right, unless said otherwise."""

_UNTOLD_SHARE = 0.25  # of the wrong descriptions of a thing
_UNSEEN = BoxContents(None, "", 0.0, "not drawn", 0)


class Filming(Protocol):
    """A simulated recording, as far as it matters here."""

    look_alikes: Mapping[str, tuple[str, ...]]

    def show_to(self, seer: Any) -> None:
        """Tell a seer what is in every frame from now on."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class _Looked:
    """An image that was sent, and the frame it is of."""

    note: Provenance
    frame: ShownFrame
    instance_ids: NDArray[np.uint16]


class SimulatedChat:
    """Answers for a ``ChatServer``, and a ``ChatModel`` that needs no server. Frames must be shown to it before it is asked about them."""

    def __init__(
        self,
        accuracy: float | Mapping[str, float] = ACCURACY,
        *,
        sticky: float = 0.7,
        seed: int = 0,
        look_alikes: Mapping[str, tuple[str, ...]] = LOOK_ALIKES,
        minds_distance: bool = False,
        name: str = "simulated",
    ) -> None:
        """Make a model that has seen nothing yet.

        Args:
            accuracy: how often it is right: one number for all agents, or role -> number; roles left out are as in ``ACCURACY``.
            sticky: share of the draws that belong to the thing and the side it is seen from.
            seed: of all draws.
            look_alikes: label -> labels that it is taken for.
            minds_distance: whether it leaves boxes apart that the question says are further apart than things that may be one,
                whatever it sees.
            name: of the model.

        Raises:
            ConfigError: a number outside 0..1, or an unknown role.
        """
        given = dict.fromkeys(ACCURACY, accuracy) if isinstance(accuracy, int | float) else {**ACCURACY, **accuracy}
        if set(given) != set(ACCURACY) or not all(0.0 <= value <= 1.0 for value in (*given.values(), sticky)):
            raise ConfigError(f"simulated chat: got accuracy {given}, sticky {sticky}; wanted 0..1 for {', '.join(ACCURACY)}")
        self.accuracy: Mapping[str, float] = given
        self.sticky = sticky
        self.seed = seed
        self.look_alikes = {label.casefold(): others for label, others in look_alikes.items()}
        self.minds_distance = minds_distance
        self._name = name
        self._shown: dict[float, ShownFrame] = {}

    @classmethod
    def watching(cls, recording: Filming, accuracy: float | Mapping[str, float] = ACCURACY, **options: Any) -> Self:
        """Return a model that is shown every frame a simulated recording draws from now on, and confuses what its detector does."""
        model = cls(accuracy, **{"look_alikes": recording.look_alikes, **options})
        recording.show_to(model)
        return model

    @property
    def name(self) -> str:
        """Of the model."""
        return self._name

    def show(self, timestamp_s: float, view: View) -> None:
        """Take what is in the frame of this stamp."""
        self._shown[round(timestamp_s, 6)] = ShownFrame.of(view)

    async def complete(self, request: ChatRequest) -> ChatReply:
        """Answer as a ``ChatModel``, at once; tokens are counted as the chat server counts them."""
        text = self(request)
        return ChatReply(text, self.name, tokens_of_question(request), tokens_of_text(text))

    def __call__(self, request: ChatRequest) -> str:
        """Return the reply to a question, JSON; to a question of anyone else the simplest one that fits its schema.

        Raises:
            ChatRequestError: an image does not say where its pixels come from, or is of a frame that was never shown.
        """
        question = question_of(request)
        if question.role == "other":
            return simplest_reply(request)
        looked = [self._look(number, image) for number, image in enumerate(request.images, start=1)]
        if not looked:
            raise ChatRequestError("simulated chat: got a question without an image", permanent=True)
        seen = [self._contents(box, looked) for box in question.boxes]
        frame = looked[0].frame
        answer = {"verification": self._verify, "description": self._describe, "merging": self._merge}[question.role]
        return json.dumps(answer(question, seen, frame))

    def _look(self, number: int, image: bytes) -> _Looked:
        note = provenance_of(image)
        if note is None:
            raise ChatRequestError(f"simulated chat: image {number} does not say where its pixels come from", permanent=True)
        frame = self._shown.get(round(note.timestamp_s, 6))
        if frame is None:
            raise ChatRequestError(
                f"simulated chat: image {number} is of a frame (t={note.timestamp_s}) that was never shown; "
                "call recording.show_to(simulated) before the recording is run",
                permanent=True,
            )
        if (note.width, note.height) != (frame.camera.width, frame.camera.height):
            raise ChatRequestError(
                f"simulated chat: image {number} is of a frame of {note.width}x{note.height} pixels, "
                f"the one shown has {frame.camera.width}x{frame.camera.height}",
                permanent=True,
            )
        return _Looked(note, frame, frame.instance_ids())

    def _contents(self, box: AskedBox, looked: Sequence[_Looked]) -> BoxContents:
        """What the box of a number shows, in the first image and panel in which it is drawn."""
        for image in looked:
            for panel in image.note.panels:
                drawn = panel.boxes.get(str(box.number))
                if drawn is not None:
                    return contents_of(panel.in_frame(drawn), image.frame, image.instance_ids)
        return _UNSEEN

    def _draws(self, role: str, subject: str, side: int, frame: ShownFrame) -> np.random.Generator:
        fresh = generator(self.seed, "chat", role, subject, f"frame {frame.index}")
        return generator(self.seed, "chat", role, subject, f"side {side}") if fresh.random() < self.sticky else fresh

    def _errs(self, role: str, draws: np.random.Generator) -> bool:
        return bool(draws.random() >= self.accuracy[role])

    def _verify(self, question: Question, seen: Sequence[BoxContents], frame: ShownFrame) -> dict[str, Any]:
        verdicts = []
        for box, contents in zip(question.boxes, seen, strict=True):
            right = -1.0 if contents.thing is None else 1.0 if names(box.label, contents.thing) else 0.0
            draws = self._draws("verification", contents.subject, contents.side, frame)
            score = right
            if self._errs("verification", draws):
                score = float(draws.choice([value for value in (1.0, 0.0, -1.0) if value != right]))
            verdicts.append({"box": box.number, "object": self._said(score, box.label, contents, frame.world, draws), "score": score})
        return {"verdicts": verdicts}

    def _said(self, score: float, label: str, contents: BoxContents, world: World, draws: np.random.Generator) -> str:
        """The word for what is in a box that goes with a verdict."""
        if score != 0.0:
            return label if score > 0 else NOT_TOLD
        if contents.thing is None:
            return str(draws.choice(PHANTOM_LABELS))
        return look_alike(contents.thing, world, self.look_alikes, draws) if names(label, contents.thing) else contents.thing.label

    def _describe(self, question: Question, seen: Sequence[BoxContents], frame: ShownFrame) -> dict[str, Any]:
        contents = seen[0] if seen else _UNSEEN
        draws = self._draws("description", contents.subject, contents.side, frame)
        wrong = self._errs("description", draws)
        thing = contents.thing
        if thing is None:
            category = str(draws.choice(PHANTOM_LABELS)) if wrong else NOT_TOLD
            label = category
        elif not wrong:
            category, label = thing.label, described(thing, contents.colour)
        elif draws.random() < _UNTOLD_SHARE:
            category = label = NOT_TOLD
        else:
            category = look_alike(thing, frame.world, self.look_alikes, draws)
            label = " ".join(word for word in (contents.colour, category) if word)
        matched = next((known for known in question.known_labels if known.casefold() == label.casefold()), NOT_TOLD)
        return {"matched_label": matched, "generated_label": label, "category": category}

    def _merge(self, question: Question, seen: Sequence[BoxContents], frame: ShownFrame) -> dict[str, Any]:
        by_thing: dict[int, list[tuple[AskedBox, BoxContents]]] = {}
        for box, contents in zip(question.boxes, seen, strict=True):
            if contents.thing is not None:
                by_thing.setdefault(contents.thing.id, []).append((box, contents))
        groups = [near for boxes in by_thing.values() if len(near := self._near(boxes, question)) > 1]
        if not groups:
            return {"duplicates": self._joined_by_mistake(question, seen, frame)}
        duplicates = []
        for group in groups:
            contents = group[0][1]
            if not self._errs("merging", self._draws("merging", contents.subject, contents.side, frame)):
                best, _ = max(group, key=lambda entry: (entry[1].fit, -entry[0].number))
                duplicates.append({"boxes": [box.number for box, _ in group], "best": best.number})
        return {"duplicates": duplicates}

    def _near(self, boxes: list[tuple[AskedBox, BoxContents]], question: Question) -> list[tuple[AskedBox, BoxContents]]:
        """The boxes that may be one by their distance from the best of them."""
        if not self.minds_distance:
            return boxes
        best, _ = max(boxes, key=lambda entry: (entry[1].fit, -entry[0].number))
        return [entry for entry in boxes if _distance_m(best, entry[0]) <= question.separate_beyond_m]

    def _joined_by_mistake(self, question: Question, seen: Sequence[BoxContents], frame: ShownFrame) -> list[dict[str, Any]]:
        if len(question.boxes) < 2:
            return []
        entries = zip(question.boxes, seen, strict=True)
        (a, in_a), (b, in_b) = min(itertools.combinations(entries, 2), key=lambda pair: _distance_m(pair[0][0], pair[1][0]))
        subject = " and ".join(sorted((in_a.subject, in_b.subject)))
        if self._errs("merging", self._draws("merging", subject, in_a.side, frame)):
            return [{"boxes": [a.number, b.number], "best": a.number}]
        return []


def _distance_m(a: AskedBox, b: AskedBox) -> float:
    return math.inf if a.position_m is None or b.position_m is None else math.dist(a.position_m, b.position_m)
