"""Every registered agent keeps the contract, and the check notices those that do not."""

import inspect

import pytest

from seo_slam import registry
from seo_slam.errors import AgentError, ChatRequestError
from seo_slam.interfaces import Agent
from seo_slam.records import Confirm, Merge, Relabel, Remove
from seo_slam.testing import check_agent


class Silent:
    """A chat model that has nothing to say."""

    name = "silent"

    async def complete(self, request):
        raise ChatRequestError("nobody is there")


@pytest.mark.parametrize("name", registry.known("agent"))
def test_contract(name):
    asks_a_model = "chat" in inspect.signature(registry.find("agent", name)).parameters
    check_agent(registry.create("agent", name, **({"chat": Silent()} if asks_a_model else {})))


def test_an_asynchronous_one_is_awaited():
    async def propose(view):
        return [Remove(77, 0)]

    with pytest.raises(AssertionError, match="names landmark 77"):
        check_agent(agent(propose))


def agent(propose, **attributes):
    """Make an agent of a function from view to edits."""
    return type("Mine", (Agent,), {"propose": lambda self, view: propose(view)} | attributes)()


def first(view):
    return int(view.landmarks.ids[0]), int(view.landmarks.versions[0])


def test_good_ones_pass():
    def all_edits(view):
        if not len(view.landmarks):
            return []
        (a, va), (b, vb) = zip(view.landmarks.ids[:2].tolist(), view.landmarks.versions[:2].tolist(), strict=True)
        return [Confirm(a, va), Relabel(a, va, "mug"), Remove(b, vb), Merge(a, va, b, vb)]

    def refuses(view):
        raise AgentError("the model did not answer")

    for propose in (all_edits, refuses, lambda view: ()):
        check_agent(agent(propose))


def shown(make):
    return lambda view: [make(*first(view))] if len(view.landmarks) else []


@pytest.mark.parametrize(
    ("propose", "words"),
    [
        (lambda view: [Remove(77, 0)], "names landmark 77"),
        (shown(lambda i, v: Remove(i, v + 1)), "names version 3 of landmark 3; the view shows 2"),
        (shown(lambda i, v: Merge(i, v, i, v)), "with itself"),
        (shown(lambda i, v: Relabel(i, v, " ")), "has no label"),
        (shown(lambda i, v: "remove it"), "proposed a str"),
        (lambda view: None, "returned NoneType"),
        (lambda view: [Remove(3, 2)], "no landmarks"),
    ],
)
def test_broken_ones_are_noticed(propose, words):
    with pytest.raises(AssertionError, match=words):
        check_agent(agent(propose))


def test_other_faults_are_noticed():
    def draws(view):
        view.frame.rgb[:] = 0
        return []

    with pytest.raises(AssertionError, match="changed the image"):
        check_agent(agent(draws))
    with pytest.raises(AssertionError, match="name is ''"):
        check_agent(agent(lambda view: [], name=""))
    with pytest.raises(AssertionError, match="not a subclass"):
        check_agent(object())
