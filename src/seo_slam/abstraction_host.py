"""The abstract map beside a pipeline: the scene cloud that grows while the robot drives, and the map made of it when it is asked for."""

from collections.abc import Sequence

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.abstraction.abstracting import abstract
from seo_slam.abstraction.joined_layouts import joined
from seo_slam.abstraction.scene_thread import SceneCloudThread
from seo_slam.abstraction.updating import updated
from seo_slam.config import Config
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder
from seo_slam.types import Frame, Landmark


class NoAbstraction:
    """No abstract map is wanted."""

    def see(self, frame: Frame, T_world_camera: FloatArray, keyframe: int) -> tuple[str, ...]:  # noqa: ARG002
        """Look at nothing."""
        return ()

    def abstract(
        self,
        landmarks: Sequence[Landmark],  # noqa: ARG002
        poses: FloatArray,  # noqa: ARG002
        before: AbstractMap | None = None,
        tentative: Sequence[Landmark] = (),  # noqa: ARG002
    ) -> AbstractMap | None:
        """Return the one there was."""
        return before

    def take_warnings(self) -> tuple[str, ...]:
        """Return none."""
        return ()

    def close(self) -> None:
        """Nothing is held."""


class Abstraction:
    """Feeds the scene cloud with keyframes (DualMap III-A4) and makes the abstract map of stable landmarks (IV-A)."""

    def __init__(self, config: Config, embedder: Embedder) -> None:
        """Take the settings; in the background, the scene cloud has a thread of its own.

        Raises:
            MissingBackendError: the extra ``nav`` is not installed; now, not when the run is over.
        """
        from seo_slam.abstraction.rooms import with_rooms

        self._with_rooms = with_rooms
        self._config = config
        self._embedder = embedder
        self._scene = SceneCloudThread(config.layout)
        self._warnings: list[str] = []

    def see(self, frame: Frame, T_world_camera: FloatArray, keyframe: int) -> tuple[str, ...]:
        """Take a keyframe if the camera has moved enough; return warnings. Waits for nothing in the background."""
        if frame.has_depth:
            self._scene.add(frame.depth_m, frame.camera, T_world_camera, keyframe)
        return self.take_warnings()

    def abstract(
        self, landmarks: Sequence[Landmark], poses: FloatArray, before: AbstractMap | None = None, tentative: Sequence[Landmark] = ()
    ) -> AbstractMap:
        """Return the abstract map of landmarks and of all that was seen of the floor.

        Args:
            landmarks: stable ones.
            poses: (T, 4, 4) of all keyframes as they are estimated now: the scene cloud moves with them.
            before: that of a map which is continued; it is updated (IV-D), and its floor grows by what was seen now.
            tentative: those that are not trusted.
        """
        layout = self._scene.layout(dict(enumerate(poses)))
        made = abstract(landmarks, self._embedder, self._config.abstraction, layout, tentative=tentative)
        if before is not None:
            made = updated(before, made, self._config.abstraction)
            layout = layout if before.layout is None else joined(before.layout, layout, self._warnings.append)
        layout, rooms = self._with_rooms(layout, made.anchors, self._embedder, self._config.layout)
        return AbstractMap(made.anchors, layout, rooms, made.embedder, made.features)

    def take_warnings(self) -> tuple[str, ...]:
        """Return what went wrong in the scene cloud, and what was left out of layouts, since the last call."""
        found, self._warnings = (*self._scene.take_warnings(), *self._warnings), []
        return found

    def close(self) -> None:
        """End the thread."""
        self._scene.close()
