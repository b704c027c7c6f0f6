"""Object-level semantic SLAM: RGB-D frames in, a map of things out.

    from seo_slam import Pipeline, SimulatedDesk, RecordedOdometry

    desk = SimulatedDesk(frames=30)
    with Pipeline(detector=desk.detector, odometry=RecordedOdometry(desk.odometry)) as pipeline:
        for result in pipeline.stream(desk):
            print(result.timestamp_s, result.events)
        print(pipeline.result().map.landmarks)

The public names are loaded when they are first asked for (PEP 562), so that ``import seo_slam`` itself is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Layout, Place, Room, Volatile
    from seo_slam.agents.description import DescriptionAgent
    from seo_slam.agents.local_description import LocalDescription
    from seo_slam.agents.local_merging import LocalMerging
    from seo_slam.agents.local_verification import LocalVerification
    from seo_slam.agents.merging import MergingAgent
    from seo_slam.agents.place_classes import classes_of_place
    from seo_slam.agents.verification import VerificationAgent
    from seo_slam.ask.answer import Answer
    from seo_slam.association.overlap import OverlapAssociator
    from seo_slam.association.two_stage import TwoStageAssociator
    from seo_slam.backends.openai_chat import OpenAIChat
    from seo_slam.backends.recorded_odometry import RecordedOdometry
    from seo_slam.camera import Camera
    from seo_slam.config import LOCAL_AGENTS, Component, Config
    from seo_slam.datasets.open import open_dataset
    from seo_slam.datasets.trajectory_files import read_trajectory, write_trajectory
    from seo_slam.driving.robot import SimulatedRobot
    from seo_slam.errors import (
        AgentError,
        BackendError,
        BudgetExceeded,
        ChatReplyError,
        ChatRequestError,
        ConfigError,
        DatasetError,
        EditRefused,
        EvaluationError,
        FrameError,
        MapError,
        MapFormatError,
        MissingBackendError,
        NoPathError,
        OptimizationError,
        SeoSlamError,
        UnknownBackendError,
        UnknownLandmarkError,
    )
    from seo_slam.evaluation.segmentation import evaluate_segmentation
    from seo_slam.interfaces import (
        Agent,
        AgentView,
        Associator,
        ChatModel,
        ChatReply,
        ChatRequest,
        CropEmbedder,
        Detector,
        Embedder,
        Evidence,
        ImageEmbedder,
        Odometry,
    )
    from seo_slam.map import Map, QueryHit
    from seo_slam.navigation.navigator import Navigator
    from seo_slam.navigation.outcomes import Attempt, Candidate, Command, Outcome
    from seo_slam.perception.class_list import ClassList
    from seo_slam.perception.hybrid import HybridDetector
    from seo_slam.pipeline import Pipeline
    from seo_slam.records import Confirm, Doubt, EditRecord, MapEvent, Merge, Relabel, Remove, StepResult, Trajectory
    from seo_slam.run_result import RunResult
    from seo_slam.settings.navigation import NavigationSettings
    from seo_slam.simulation.apartment import SimulatedApartment
    from seo_slam.simulation.house import SimulatedHouse
    from seo_slam.simulation.image_encoder import SimulatedImageEncoder
    from seo_slam.simulation.recording import SimulatedDesk
    from seo_slam.simulation.rooms import SimulatedRoom
    from seo_slam.simulation.segments import SimulatedSegmenter
    from seo_slam.types import NEW, REJECTED, Association, Detections, Estimate, Frame, Landmark, Landmarks, Motion, Observations
    from seo_slam.undo import read_edits, undo_edit

__version__ = "0.1.0"

_MODULES = {
    "agents.description": ("DescriptionAgent",),
    "agents.local_description": ("LocalDescription",),
    "agents.local_merging": ("LocalMerging",),
    "agents.local_verification": ("LocalVerification",),
    "agents.merging": ("MergingAgent",),
    "agents.verification": ("VerificationAgent",),
    "ask.answer": ("Answer",),
    "association.two_stage": ("TwoStageAssociator",),
    "backends.openai_chat": ("OpenAIChat",),
    "backends.recorded_odometry": ("RecordedOdometry",),
    "camera": ("Camera",),
    "config": ("LOCAL_AGENTS", "Component", "Config"),
    "datasets.open": ("open_dataset",),
    "datasets.trajectory_files": ("read_trajectory", "write_trajectory"),
    "errors": (
        "AgentError",
        "BackendError",
        "BudgetExceeded",
        "ChatReplyError",
        "ChatRequestError",
        "ConfigError",
        "DatasetError",
        "EditRefused",
        "EvaluationError",
        "FrameError",
        "MapError",
        "MapFormatError",
        "MissingBackendError",
        "NoPathError",
        "OptimizationError",
        "SeoSlamError",
        "UnknownBackendError",
        "UnknownLandmarkError",
    ),
    "interfaces": (
        "CropEmbedder",
        "Detector",
        "Embedder",
        "ImageEmbedder",
        "Odometry",
        "Agent",
        "AgentView",
        "Associator",
        "ChatModel",
        "ChatReply",
        "ChatRequest",
        "Evidence",
    ),
    "map": ("Map", "QueryHit"),
    "pipeline": ("Pipeline",),
    "run_result": ("RunResult",),
    "records": ("Confirm", "Doubt", "EditRecord", "MapEvent", "Merge", "Relabel", "Remove", "StepResult", "Trajectory"),
    "simulation.apartment": ("SimulatedApartment",),
    "simulation.house": ("SimulatedHouse",),
    "simulation.recording": ("SimulatedDesk",),
    "simulation.rooms": ("SimulatedRoom",),
    "types": (
        "NEW",
        "REJECTED",
        "Association",
        "Detections",
        "Estimate",
        "Frame",
        "Landmark",
        "Landmarks",
        "Motion",
        "Observations",
    ),
    "undo": ("read_edits", "undo_edit"),
    "abstraction.abstract_map": (
        "AbstractMap",
        "Anchor",
        "Layout",
        "Place",
        "Room",
        "Volatile",
    ),
    "agents.place_classes": ("classes_of_place",),
    "association.overlap": ("OverlapAssociator",),
    "driving.robot": ("SimulatedRobot",),
    "evaluation.segmentation": ("evaluate_segmentation",),
    "navigation.navigator": ("Navigator",),
    "navigation.outcomes": (
        "Attempt",
        "Candidate",
        "Command",
        "Outcome",
    ),
    "perception.class_list": ("ClassList",),
    "perception.hybrid": ("HybridDetector",),
    "settings.navigation": ("NavigationSettings",),
    "simulation.image_encoder": ("SimulatedImageEncoder",),
    "simulation.segments": ("SimulatedSegmenter",),
}
_HOME = {name: f"seo_slam.{module}" for module, names in _MODULES.items() for name in names}

__all__ = [  # noqa: RUF022  # by what they are for
    "Pipeline",
    "Place",
    "Config",
    "Component",
    "StepResult",
    "RunResult",
    "Map",
    "QueryHit",
    "Landmark",
    "Landmarks",
    "MapEvent",
    "Frame",
    "Camera",
    "Detections",
    "Observations",
    "Motion",
    "Estimate",
    "Trajectory",
    "Association",
    "NEW",
    "REJECTED",
    "Associator",
    "TwoStageAssociator",
    "Agent",
    "AgentView",
    "Evidence",
    "ChatModel",
    "ChatRequest",
    "ChatReply",
    "OpenAIChat",
    "Confirm",
    "Doubt",
    "Relabel",
    "Remove",
    "Merge",
    "EditRecord",
    "read_edits",
    "undo_edit",
    "LOCAL_AGENTS",
    "LocalVerification",
    "LocalDescription",
    "LocalMerging",
    "VerificationAgent",
    "DescriptionAgent",
    "MergingAgent",
    "Answer",
    "RecordedOdometry",
    "SimulatedDesk",
    "SimulatedRoom",
    "SimulatedApartment",
    "SimulatedHouse",
    "open_dataset",
    "read_trajectory",
    "write_trajectory",
    "SeoSlamError",
    "ConfigError",
    "FrameError",
    "DatasetError",
    "EvaluationError",
    "OptimizationError",
    "BackendError",
    "UnknownBackendError",
    "MissingBackendError",
    "NoPathError",
    "MapError",
    "UnknownLandmarkError",
    "EditRefused",
    "MapFormatError",
    "AgentError",
    "ChatRequestError",
    "ChatReplyError",
    "BudgetExceeded",
    "__version__",
    "AbstractMap",
    "Anchor",
    "Layout",
    "Room",
    "Volatile",
    "classes_of_place",
    "OverlapAssociator",
    "SimulatedRobot",
    "evaluate_segmentation",
    "Navigator",
    "Attempt",
    "Candidate",
    "Command",
    "Outcome",
    "ClassList",
    "HybridDetector",
    "NavigationSettings",
    "SimulatedImageEncoder",
    "SimulatedSegmenter",
    "CropEmbedder",
    "Detector",
    "Embedder",
    "ImageEmbedder",
    "Odometry",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module 'seo_slam' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *__all__})
