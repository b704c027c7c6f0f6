"""All settings, one pydantic model a component, with the defaults in code.

``Config.from_file("my.toml")`` reads TOML or YAML; ``Config.preset("seo_slam")`` gives a named set;
``config.with_settings(["a.b=3"])`` changes single ones. A misspelt key is an error that names the nearest known one.
"""

import difflib
import json
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, Field, ValidationError, model_validator

from seo_slam.errors import ConfigError
from seo_slam.settings.abstraction import AbstractionSettings
from seo_slam.settings.base import Settings
from seo_slam.settings.concrete import OverlapSettings, StatusSettings
from seo_slam.settings.navigation import NavigationSettings
from seo_slam.settings.observing import CloudSettings, FeatureSettings
from seo_slam.settings.planning import LayoutSettings, PlannerSettings


class Component(Settings):
    """A part that the registry makes: ``name`` is a registered name or "module:Class"; ``options`` go to its constructor."""

    name: str
    options: dict[str, Any] = Field(default_factory=dict)


class KeyframeSettings(Settings):
    """A frame becomes a keyframe when any of these is reached since the last one."""

    distance_m: float = Field(0.1, gt=0, description="camera moved this far")
    angle_deg: float = Field(5.0, gt=0, description="camera turned this much")
    period_s: float = Field(0.5, gt=0, description="this much time went by")


class LiftingSettings(Settings):
    """From boxes or masks and depth to 3D measurements (SEO-SLAM III-A)."""

    min_score: float = Field(0.0, ge=0, le=1, description="detections below it are ignored")
    max_depth_m: float = Field(6.0, gt=0, description="farther depth is ignored")
    min_points: int = Field(20, ge=3, description="object pixels with depth that a measurement needs")
    max_points: int = Field(400, ge=50, description="pixels looked at a box; a larger box is sampled on a grid")
    depth_noise_at_1m_m: float = Field(0.0019, gt=0, description="axial depth noise is this times depth squared (Kinect v1)")
    box_noise_share: float = Field(0.05, ge=0, description="standard deviation of a box's edge, as a share of its side")
    min_sigma_m: float = Field(0.01, gt=0, description="floor of a measurement's standard deviation: calibration, pose, shape")
    duplicate_iou: float = Field(0.7, gt=0, le=1, description="two boxes of one frame that overlap more are one thing")
    one_box_a_place: bool = Field(True, description="two boxes of like size at one place in 3D are one thing")


class AssociationSettings(Settings):
    """The two-stage gate and the assignment (SEO-SLAM III-B)."""

    gate_probability: float = Field(0.99, gt=0, lt=1, description="alpha of Eq 7, for 3 degrees of freedom")
    search_distance_m: float = Field(6.0, gt=0, description="landmarks farther than this from the camera are not considered")
    semantic_gate: Literal["likelihood", "cosine", "none"] = Field(
        "likelihood", description="likelihood compares label distributions; cosine is the paper's Eq 8 with tau_s"
    )
    cosine_threshold: float = Field(0.6, ge=-1, le=1, description="tau_s of the cosine gate")
    solver: str = Field("scipy", description="assignment solver: scipy or lap (JVC)")


class SmootherSettings(Settings):
    """The factor graph."""

    first_pose_sigma_m: float = Field(1e-3, gt=0, description="how well the first camera is placed")
    first_pose_sigma_deg: float = Field(0.05, gt=0, description="and turned")
    views_that_err_together: float = Field(
        9.0, ge=1, description="so many views of a thing count as one: from one side they share the errors of shape and hiding"
    )
    cauchy_k: float = Field(
        1.0, gt=0, description="Cauchy loss of the measurements, in standard deviations: people move, boxes slip, shapes bias"
    )


class MapSettings(Settings):
    """The life of a landmark."""

    stable_observations: int = Field(3, ge=1, description="keyframes that a tentative landmark must be seen in")
    stable_seconds: float = Field(0.3, ge=0, description="and over at least this long")
    merge_duplicates: bool = Field(True, description="fold landmarks that are unambiguously one")
    separate_frames: int = Field(3, ge=1, description="frames with separate detections of both that prove two landmarks to be two")


class LifeSettings(Settings):
    """Existence: what hits and misses say of a landmark."""

    enabled: bool = Field(
        True,
        description="off: a landmark counts once seen often enough, and nothing is ever removed but by agents; with ``status.enabled`` "
        "(dualmap) only the check of existence is off",
    )
    vanishing: float = Field(0.002, gt=0, lt=1, description="prior chance that a thing was taken away since it was last seen")
    stable_existence: float = Field(0.5, gt=0, lt=1, description="existence from which a landmark is stable")
    stable_share: float = Field(0.1, ge=0, le=1, description="and in what share of the views in which it should be seen it must have been")
    lost_existence: float = Field(0.3, gt=0, lt=1, description="a stable landmark below it is lost")
    removed_existence: float = Field(0.1, gt=0, lt=1, description="a landmark below it leaves the map")
    removed_misses: int = Field(3, ge=1, description="after at least so many keyframes in which it should have been seen")
    removed_seconds: float = Field(1.0, ge=0, description="and so long after it was last seen")


class RunnerSettings(Settings):
    """When agents are asked, and how many at once."""

    mode: Literal["inline", "background", "virtual"] = Field(
        "inline",
        description="inline: at once, every keyframe waits for them; background: in one thread, nothing waits; "
        "virtual: an answer counts so many recorded seconds later, whatever the machine's load",
    )
    in_flight: int = Field(8, ge=1, description="questions asked at once")
    queue: int = Field(64, ge=1, description="questions waiting; beyond it those about the oldest views are dropped")
    view_period_s: float = Field(0.5, ge=0, description="least time between two views that agents are shown")
    latency_s: float = Field(1.0, ge=0, description="virtual: seconds from question to answer")
    drain_s: float = Field(30.0, ge=0, description="at the end of a recording the last answers are waited for at most so long")
    shutdown_s: float = Field(1.0, gt=0, description="closing waits at most so long for the thread to end")


class EditSettings(Settings):
    """What the map does with what agents propose."""

    rails: bool = Field(True, description="off: every edit whose version holds is applied, as in the paper")
    quota: int = Field(8, ge=1, description="edits applied a keyframe; the rest wait")


LOCAL_AGENTS = tuple(Component(name=name) for name in ("local_verification", "local_description", "local_merging"))
"""The agents of the default: they need no key and no network."""

WITNESS = {"name": "local_verification", "options": {"confirms": False}}
"""What stands beside chat models: it sees in depth and colour where nothing is, and asks nobody."""


class Config(Settings):
    """Everything a Pipeline needs to build itself."""

    detector: Component = Field(Component(name="none"), description="finds objects in the image")
    odometry: Component = Field(Component(name="recorded"), description="says how the camera moved")
    associator: Component = Field(Component(name="two_stage"), description="two_stage (SEO-SLAM III-B) or nearest")
    smoother: Component = Field(Component(name="gtsam"), description="the factor graph's solver")
    embedder: Component = Field(Component(name="auto"), description="turns labels into vectors")
    store: Component = Field(Component(name="memory"), description="keeps every keyframe")
    agents: tuple[Component, ...] = Field(LOCAL_AGENTS, description="look at the map and propose edits; [] for none")
    keyframes: KeyframeSettings = KeyframeSettings()
    lifting: LiftingSettings = LiftingSettings()
    features: FeatureSettings = FeatureSettings()
    clouds: CloudSettings = CloudSettings()
    association: AssociationSettings = AssociationSettings()
    overlap: OverlapSettings = OverlapSettings()
    graph: SmootherSettings = SmootherSettings()
    map: MapSettings = MapSettings()
    life: LifeSettings = LifeSettings()
    status: StatusSettings = StatusSettings()
    layout: LayoutSettings = LayoutSettings()
    abstraction: AbstractionSettings = AbstractionSettings()
    planner: PlannerSettings = PlannerSettings()
    navigation: NavigationSettings = NavigationSettings()
    runner: RunnerSettings = RunnerSettings()
    edits: EditSettings = EditSettings()
    seed: int = Field(0, ge=0, description="of every part that draws random numbers")

    @model_validator(mode="after")
    def _clouds_are_kept_where_they_are_needed(self) -> Self:
        if not self.clouds.enabled and (self.status.enabled or self.associator.name == "overlap"):
            what = "status.enabled" if self.status.enabled else 'associator "overlap"'
            raise ValueError(f"{what} needs clouds: set clouds.enabled, or take the preset dualmap")
        return self

    @classmethod
    def preset(cls, name: str) -> Self:
        """Return a named configuration.

        Raises:
            ConfigError: no preset of that name.
        """
        if name not in PRESETS:
            raise ConfigError(f"unknown preset {name!r}; known: {', '.join(sorted(PRESETS))}")
        return cls.from_dict(PRESETS[name], f"preset {name}")

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], source: str = "config") -> Self:
        """Check a nested mapping.

        Raises:
            ConfigError: names every unknown key (and the nearest known one) or bad value.
        """
        if not isinstance(values, Mapping):
            raise ConfigError(f"{source}: got {values!r:.60}, wanted a mapping of settings, or see Config.preset and Config.from_file")
        try:
            return cls.model_validate(dict(values))
        except ValidationError as error:
            raise ConfigError(_explain(error, source, cls)) from None

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """Read a TOML or YAML file.

        Raises:
            ConfigError: it is missing, is neither, does not parse, or holds a bad setting.
        """
        return cls.from_dict(read_settings(path), str(path))

    def updated(self, values: Mapping[str, Any], source: str) -> Self:
        """Return a copy in which the given settings win, key by key.

        Raises:
            ConfigError: a bad key or value; the message begins with ``source``.
        """
        return self.from_dict(_merged(self.model_dump(), values), source)

    def with_settings(self, assignments: Iterable[str]) -> Self:
        """Return a copy with ``key.sub=value`` assignments made; a value is JSON, else taken as text.

        Raises:
            ConfigError: an assignment has no "=", or a bad key or value.
        """
        values = self.model_dump()
        for text in assignments:
            key, equals, raw = text.partition("=")
            if not equals or not key:
                raise ConfigError(f"--set {text}: wanted key=value, for example keyframes.period_s=0.25")
            *parents, last = key.strip().split(".")
            target: Any = values
            for parent in parents:
                target = target.setdefault(parent, {}) if isinstance(target, dict) else None
            if not isinstance(target, dict):
                raise ConfigError(f"--set {text}: {key!r} is inside a setting that holds no others")
            target[last] = _value(raw)
        return self.from_dict(values, "--set")


def describe_settings(model: type[BaseModel] = Config, prefix: str = "") -> list[tuple[str, str, str]]:
    """Return (key, default as JSON, what it is) of every setting, as ``--set`` takes them."""
    rows: list[tuple[str, str, str]] = []
    for name, field in model.model_fields.items():
        default = field.get_default(call_default_factory=True)
        if isinstance(default, BaseModel) and not isinstance(default, Component):
            rows += describe_settings(type(default), f"{prefix}{name}.")
        else:
            value = default.model_dump() if isinstance(default, BaseModel) else default
            rows.append((prefix + name, json.dumps(value, default=BaseModel.model_dump), field.description or ""))
    return rows


_PAPER: dict[str, Any] = {
    "lifting": {"one_box_a_place": False},
    "map": {"stable_observations": 3, "stable_seconds": 0.0, "merge_duplicates": False},
    "life": {"enabled": False},
    "agents": [],
}
"""Table II's variants: without what of ours decides about a landmark's life (merging, existence, one box a place).
Lifting and graph are the same in all variants; the paper leaves them open."""


def chat_agents(verification: Mapping[str, Any], others: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return the paper's three agents as settings (SEO-SLAM IV-B: a lighter model verifies, a stronger one describes and merges).

    Args:
        verification: options of the chat model "openai" for the verification agent: model, base_url, …
        others: those for description and merging; the same ones by default.
    """
    chosen = {"verification": verification, "description": others or verification, "merging": others or verification}
    return [{"name": role, "options": {"chat": {"name": "openai", "options": dict(options)}}} for role, options in chosen.items()]


_MODELS = chat_agents({"model": "gpt-4o-mini"}, {"model": "gpt-4o"})

_IN_BACKGROUND: dict[str, Any] = {"runner": {"mode": "background"}}

_AS_PROPOSED = {"edits": {"rails": False}}

_NEAREST = {"associator": {"name": "nearest"}}

_DUALMAP: dict[str, Any] = {
    "associator": {"name": "overlap"},
    "smoother": {"name": "given_poses"},
    "agents": [],
    "lifting": {"duplicate_iou": 1.0, "one_box_a_place": False},
    "features": {"image_weight": 0.7, "text_weight": 0.3, "null_text": True},
    "clouds": {"enabled": True, "noise_at_1m_m": 0.0057},
    "overlap": {"noise_at_1m_m": 0.0057},
    "map": {"merge_duplicates": False},
    "status": {"enabled": True},
    "layout": {"enabled": True, "mode": "inline"},
}
"""DualMap III: clouds matched by overlap and looks, checks of each object by itself, poses as given."""

_ESTIMATED = {"smoother": {"name": "gtsam"}}

PRESETS: dict[str, dict[str, Any]] = {
    "seo_slam": {},
    "seo_slam_chat": {"agents": [*_MODELS, WITNESS], **_IN_BACKGROUND},
    "seo_slam_no_agents": {"agents": []},
    "rg": _PAPER | _NEAREST,
    "rg_d": _PAPER,
    "rg_a": _PAPER | _NEAREST | {"agents": _MODELS} | _IN_BACKGROUND | _AS_PROPOSED,
    "rg_d_a": _PAPER | {"agents": _MODELS} | _IN_BACKGROUND | _AS_PROPOSED,
    "rg_d_cosine": _PAPER | {"association": {"semantic_gate": "cosine"}},
    "seo_slam_paper_gate": {"association": {"semantic_gate": "cosine", "solver": "lap"}},
    "nearest": _NEAREST,
    "dualmap": _DUALMAP,
    "dualmap_estimated_poses": _DUALMAP | _ESTIMATED,
}


def read_settings(path: str | Path) -> dict[str, Any]:
    """Read a TOML or YAML file into a dict, unchecked but for its form.

    Raises:
        ConfigError: it is missing, has another suffix, or does not parse.
    """
    file = Path(path)
    if not file.is_file():
        raise ConfigError(f"{file}: no such config file")
    try:
        if file.suffix == ".toml":
            return tomllib.loads(file.read_text(encoding="utf-8"))
        if file.suffix in (".yaml", ".yml"):
            import yaml

            loaded = yaml.safe_load(file.read_text(encoding="utf-8"))
            if loaded is None:
                return {}
            if not isinstance(loaded, dict):
                raise ConfigError(f"{file}: got a {type(loaded).__name__} at the top, wanted keys and values")
            return loaded
    except ConfigError:
        raise
    except Exception as error:  # tomllib and yaml have errors of their own
        raise ConfigError(f"{file}: does not parse: {error}") from error
    raise ConfigError(f"{file}: got suffix {file.suffix!r}, wanted .toml, .yaml or .yml")


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(below)
    for key, value in above.items():
        old = out.get(key)
        out[key] = _merged(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return out


def _value(raw: str) -> Any:
    try:
        return json.loads(raw)
    except json.JSONDecodeError:
        return raw


def _explain(error: ValidationError, source: str, model: type[BaseModel]) -> str:
    lines = []
    for item in error.errors():
        path = [str(part) for part in item["loc"]]
        where = ".".join(path)
        if item["type"] == "extra_forbidden":
            known = _known_keys(model, path[:-1])
            near = difflib.get_close_matches(path[-1], known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            lines.append(f"unknown setting {where!r}{hint} (known here: {', '.join(sorted(known))})")
        else:
            lines.append(f"{where}: {item['msg']} (got {item['input']!r})")
    return f"{source}: " + "; ".join(lines)


def _known_keys(model: type[BaseModel], path: list[str]) -> list[str]:
    for part in path:
        field = model.model_fields.get(part)
        annotation = field.annotation if field else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        model = annotation
    return list(model.model_fields)
