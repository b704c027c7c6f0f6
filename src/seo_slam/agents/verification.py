"""The verification agent (SEO-SLAM III-D1): are the labels right?"""

from collections.abc import Sequence
from typing import ClassVar

from seo_slam.agents.asking import demand
from seo_slam.agents.chat_agent import ChatAgent, asked_ids, only_answers, shown_label, version_of
from seo_slam.agents.compose import VERIFICATION_CROPS, verification_image
from seo_slam.agents.replies import Verification
from seo_slam.interfaces import AgentView
from seo_slam.records import AgentRole, Confirm, Doubt, Edit, Remove

_VERDICTS: dict[float, type[Confirm] | type[Doubt] | type[Remove]] = {1.0: Confirm, 0.0: Doubt, -1.0: Remove}


class VerificationAgent(ChatAgent):
    """Shows a model up to four crops and labels: correct, incorrect or unidentifiable.

    A score of 1 confirms, 0 doubts the label, and -1 proposes to remove; any other score, a box that was not asked about, and one that is
    answered twice change nothing.
    """

    role: AgentRole = "verification"
    most_landmarks: int = VERIFICATION_CROPS
    prompt_name: ClassVar[str] = "verification"

    async def propose(self, view: AgentView) -> Sequence[Edit]:
        """Return a verdict on each landmark that the model judged.

        Raises:
            ChatRequestError, ChatReplyError, BudgetExceeded: no reply could be had, or none of any use.
        """
        ids = asked_ids(view, self.most_landmarks)
        if not ids:
            return ()
        composed = verification_image(view, ids)
        asked = [{"box": number, "label": shown_label(view, i)} for number, i in enumerate(composed.ids, start=1)]
        request = self.request("Judge the label of each numbered box.", {"landmarks": asked}, composed.images)
        reply = await demand(self.chat, request, Verification)
        once = only_answers([verdict.box for verdict in reply.verdicts], len(composed.ids))
        return tuple(
            _VERDICTS[verdict.score](landmark_id, version_of(view, landmark_id), self.name)
            for verdict in reply.verdicts
            if verdict.box in once and verdict.score in _VERDICTS
            for landmark_id in (composed.ids[verdict.box - 1],)
        )
