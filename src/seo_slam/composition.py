"""From a configuration, and whatever objects are given, to the parts of a pipeline."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.config import Component, Config
from seo_slam.errors import ConfigError
from seo_slam.interfaces import Agent, Associator, Detector, Embedder, MapStore, Odometry, Smoother
from seo_slam.registry import create

_METHODS = {
    "detector": ("detect",),
    "odometry": ("update",),
    "associator": ("associate",),
    "smoother": ("start", "predict", "update", "remove", "merge", "split", "rename", "positions", "covariances", "poses"),
    "embedder": ("embed_text", "name", "size"),
    "store": (
        "commit",
        "keyframe",
        "amend",
        "edits",
        "keyframe_ids",
        "set_meta",
        "meta",
        "landmarks",
        "near",
        "next_id",
        "history",
        "close",
    ),
    "agent": ("propose",),
}


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The parts a pipeline runs on."""

    detector: Detector
    odometry: Odometry
    associator: Associator
    smoother: Smoother
    embedder: Embedder
    store: MapStore
    agents: tuple[Agent, ...]


def compose(config: Config, given: Mapping[str, Any], agents: Sequence[Any] | None) -> Parts:
    """Take each part as given (object, class, name, component), else from the configuration.

    Raises:
        ConfigError: an object lacks a method that its interface asks for.
        UnknownBackendError, MissingBackendError: a name cannot be turned into a part.
    """
    embedder = _part("embedder", given.get("embedder"), config.embedder)
    context: dict[str, Any] = {
        "settings": config.association,
        "overlap": config.overlap,
        "solver": create("assignment_solver", config.association.solver),
        "likelihood": LabelLikelihood(embedder),
        "seed": config.seed,
    }
    seeing = {
        "embedder": embedder,
        "likelihood": context["likelihood"],
        "seed": config.seed,
        "depth_noise_at_1m_m": config.lifting.depth_noise_at_1m_m,
    }
    return Parts(
        detector=_part("detector", given.get("detector"), config.detector, seed=config.seed),
        odometry=_part("odometry", given.get("odometry"), config.odometry, seed=config.seed),
        associator=_part("associator", given.get("associator"), config.associator, **context),
        smoother=_part("smoother", given.get("smoother"), config.smoother, settings=config.graph),
        embedder=embedder,
        store=_part("store", given.get("store"), config.store),
        agents=tuple(_part("agent", agent, Component(name=""), **seeing) for agent in (config.agents if agents is None else agents)),
    )


def _part(kind: str, given: Any, component: Component, **context: Any) -> Any:
    wanted = component if given is None else given
    part = create(kind, wanted, **context) if isinstance(wanted, str | Component | type) else wanted
    lacking = [method for method in _METHODS[kind] if not hasattr(part, method)]
    if lacking:
        raise ConfigError(f"{kind}: {type(part).__name__} has no {', no '.join(lacking)}; seo_slam.testing can check yours")
    return part
