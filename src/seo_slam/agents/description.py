"""The description agent (SEO-SLAM III-D2): what is it, in words that tell alike things apart?"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from seo_slam.agents.asking import demand
from seo_slam.agents.chat_agent import ChatAgent, asked_ids, shown_label, version_of
from seo_slam.agents.compose import description_image, row_of
from seo_slam.agents.label_text import MOST_CATEGORY_WORDS, is_not_available, label_from, nearest_labels
from seo_slam.agents.replies import Description
from seo_slam.errors import ConfigError
from seo_slam.interfaces import AgentView, ChatModel
from seo_slam.records import AgentRole, Confirm, Edit, Relabel, Remove
from seo_slam.types import heaviest


class DescriptionAgent(ChatAgent):
    """Shows a model one landmark and the labels that others have: a known label that fits, a new one, or nothing to be recognised."""

    role: AgentRole = "description"
    most_landmarks: int = 1
    prompt_name: ClassVar[str] = "description"

    def __init__(
        self, chat: ChatModel | str | Mapping[str, Any], temperature: float = 0.7, max_tokens: int = 250, known_labels: int = 50
    ) -> None:
        """Know the model and how to ask it.

        Args:
            chat: a chat model, its name, or name and options.
            temperature: of the reply.
            max_tokens: of the reply.
            known_labels: labels that agents gave so far and that are sent along, at most; of more, those most like the landmark's.

        Raises:
            ConfigError, UnknownBackendError, MissingBackendError: as ``ChatAgent``.
        """
        super().__init__(chat, temperature, max_tokens)
        if known_labels < 0:
            raise ConfigError(f"agent {self.name!r}: known_labels is {known_labels}, wanted at least 0")
        self._most_known = int(known_labels)

    async def propose(self, view: AgentView) -> Sequence[Edit]:
        """Return a label for the landmark, a confirmation of the one it has, or its removal.

        Raises:
            ChatRequestError, ChatReplyError, BudgetExceeded: no reply could be had, or none of any use.
        """
        ids = asked_ids(view, self.most_landmarks)
        if not ids:
            return ()
        composed = description_image(view, ids[0])
        label = shown_label(view, ids[0])
        known = nearest_labels(label, view.known_labels, self._most_known)
        facts = {"landmarks": [{"box": 1, "label": label}], "known_labels": known}
        reply = await demand(self.chat, self.request("Name the thing in box 1.", facts, composed.images), Description)
        edit = self._edit(reply, known, view, ids[0])
        return () if edit is None else (edit,)

    def _edit(self, reply: Description, known: Sequence[str], view: AgentView, landmark_id: int) -> Edit | None:
        version = version_of(view, landmark_id)
        label = _label(reply, known)
        if label is None:
            nothing = is_not_available(reply.matched_label) and is_not_available(reply.generated_label)
            return Remove(landmark_id, version, self.name) if nothing else None
        row = row_of(view, landmark_id)
        category = label_from(reply.category, MOST_CATEGORY_WORDS) or _plain_word_in(label, heaviest(view.landmarks.labels[row]))
        category = "" if category == label else category
        has = (view.landmarks.name_of(row).casefold(), view.landmarks.category_of(row).casefold())
        if (label.casefold(), category.casefold()) == has:
            return Confirm(landmark_id, version, self.name)
        return Relabel(landmark_id, version, label, self.name, category)


def _label(reply: Description, known: Sequence[str]) -> str | None:
    """The known label that was matched, else the new one; a "match" that is not in the list is a new one, and so is a lone category."""
    matched, generated = label_from(reply.matched_label), label_from(reply.generated_label)
    if matched in known:
        return matched
    if not is_not_available(reply.generated_label):
        return generated
    return matched if not is_not_available(reply.matched_label) else label_from(reply.category, MOST_CATEGORY_WORDS)


def _plain_word_in(label: str, word: str) -> str:
    """The detector's word, if the label says it too: "shoe" of a "green hiking shoe"; else ""."""
    return word.lower() if word and f" {word.lower()} " in f" {label} " else ""
