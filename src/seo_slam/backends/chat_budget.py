"""What a chat model has used, what it is still allowed to use, and what the next question may come to."""

import threading
from collections import deque
from dataclasses import dataclass, replace

from seo_slam.errors import BudgetExceeded
from seo_slam.interfaces import ChatRequest

_IMAGE_TOKENS = 300
_CHARACTERS_A_TOKEN = 4
_REMEMBERED = 32
_FIRST_RATIO, _CAUTIOUS_RATIO = 1.5, 4.0  # servers differ most in what an image counts


@dataclass(frozen=True, slots=True)
class ChatUsage:
    """What was used so far.

    Attributes:
        requests: sent to the server, probes and repetitions included.
        retries: those of them that repeated one that had failed.
        prompt_tokens, completion_tokens: as the server counts them; estimated where it says nothing.
        cached: questions answered from the cache.
        cost: of the tokens, at the prices given; 0 without prices.
        waited_s: seconds that questions waited for rate limits, added up.
    """

    requests: int = 0
    retries: int = 0
    prompt_tokens: int = 0
    completion_tokens: int = 0
    cached: int = 0
    cost: float = 0.0
    waited_s: float = 0.0


class TokenEstimates:
    """What a question will come to, learned from what the server counted: as much as the dearest of the last ones."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._ratios: deque[float] = deque(maxlen=_REMEMBERED)
        self._replies: deque[int] = deque(maxlen=_REMEMBERED)

    def prompt(self, request: ChatRequest, cautious: bool = False) -> int:
        """Tokens of the question; ``cautious``: rather too many while nothing was learned yet."""
        return int(_rough(request) * max(self._ratios, default=_CAUTIOUS_RATIO if cautious else _FIRST_RATIO)) + 1

    def completion(self, request: ChatRequest) -> int:
        """Tokens of the reply: those that are allowed until a few came, then as many as the longest of late."""
        return request.max_tokens if len(self._replies) < _REMEMBERED // 4 else min(request.max_tokens, max(self._replies))

    def learn(self, request: ChatRequest, prompt_tokens: int, completion_tokens: int) -> None:
        """Take what the server counted."""
        self._ratios.append(prompt_tokens / _rough(request))
        self._replies.append(completion_tokens)


class Budget:
    """Counts tokens and money, and says when they are spent. Any thread.

    A question is let through only if it fits even when its reply is as long as is allowed; what it did not use is given back.

    Args:
        most_tokens: prompt and completion together; None: any number.
        most_cost: in ``currency``; None: any. Needs prices.
        prices: per million tokens of prompt and of completion.
        currency: name of it, for messages.
    """

    def __init__(self, most_tokens: int | None, most_cost: float | None, prices: tuple[float, float] | None, currency: str) -> None:
        self._most_tokens = most_tokens
        self._most_cost = most_cost
        self._prices = prices or (0.0, 0.0)
        self._currency = currency
        self._lock = threading.Lock()
        self._used = ChatUsage()
        self._held_tokens = 0
        self._held_cost = 0.0

    @property
    def used(self) -> ChatUsage:
        """What was used so far."""
        with self._lock:
            return self._used

    def hold(self, prompt_tokens: int, completion_tokens: int) -> None:
        """Set aside what a question may come to; ``release`` it when it has ended.

        Raises:
            BudgetExceeded: there is not so much left.
        """
        tokens, cost = prompt_tokens + completion_tokens, self._cost(prompt_tokens, completion_tokens)
        with self._lock:
            spent = self._used.prompt_tokens + self._used.completion_tokens
            if self._most_tokens is not None and spent + self._held_tokens + tokens > self._most_tokens:
                raise BudgetExceeded(f"chat budget: {spent} of {self._most_tokens} tokens are used; the next question may need {tokens}")
            if self._most_cost is not None and self._used.cost + self._held_cost + cost > self._most_cost:
                raise BudgetExceeded(
                    f"chat budget: {self._used.cost:.4f} of {self._most_cost:.4f} {self._currency} are spent; "
                    f"the next question may cost {cost:.4f}"
                )
            self._held_tokens += tokens
            self._held_cost += cost

    def release(self, prompt_tokens: int, completion_tokens: int) -> None:
        """Give back what was set aside."""
        with self._lock:
            self._held_tokens -= prompt_tokens + completion_tokens
            self._held_cost -= self._cost(prompt_tokens, completion_tokens)

    def spend(self, prompt_tokens: int, completion_tokens: int) -> None:
        """Count the tokens of an answer."""
        with self._lock:
            self._used = replace(
                self._used,
                prompt_tokens=self._used.prompt_tokens + prompt_tokens,
                completion_tokens=self._used.completion_tokens + completion_tokens,
                cost=self._used.cost + self._cost(prompt_tokens, completion_tokens),
            )

    def count(self, requests: int = 0, retries: int = 0, cached: int = 0, waited_s: float = 0.0) -> None:
        """Count what costs nothing."""
        with self._lock:
            self._used = replace(
                self._used,
                requests=self._used.requests + requests,
                retries=self._used.retries + retries,
                cached=self._used.cached + cached,
                waited_s=self._used.waited_s + waited_s,
            )

    def _cost(self, prompt_tokens: int, completion_tokens: int) -> float:
        return (prompt_tokens * self._prices[0] + completion_tokens * self._prices[1]) / 1e6


def tokens_of_text(text: str) -> int:
    """Return about how many tokens a text is, where the server does not say."""
    return len(text) // _CHARACTERS_A_TOKEN + 1


def _rough(request: ChatRequest) -> int:
    texts = [request.system, request.text, *(text for turn in request.turns for text in turn)]
    schema = len(str(request.schema)) if request.schema is not None else 0
    return sum(map(tokens_of_text, texts)) + schema // _CHARACTERS_A_TOKEN + _IMAGE_TOKENS * len(request.images)
