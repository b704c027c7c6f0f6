"""What flows through the pipeline, one frozen dataclass each.

Hot-path types are structs of arrays (one row a detection, observation or landmark), are checked when they are built, and can
be indexed by a boolean mask or an array of row numbers. Frames: ``camera`` is OpenCV's (x right, y down, z forward), ``world``
is z up where gravity is known.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.geometry import AnyArray, FloatArray, require_transform

if TYPE_CHECKING:
    from seo_slam.perception.cloud import Cloud

NEW = -1
"""In ``Association.landmark_ids``: no landmark fits, make a new one."""
REJECTED = -2
"""In ``Association.landmark_ids``: a false or doubled measurement, use it for nothing."""

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
OdometryStatus = Literal["ok", "lost"]
LandmarkState = Literal["tentative", "stable", "lost"]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One RGB-D image.

    Attributes:
        timestamp_s: stamp of the colour image, seconds.
        rgb: (H, W, 3) uint8.
        depth_m: (H, W) float32, metres along z, registered to ``rgb``; 0 = no return. None (or all 0) = a frame without depth.
        camera: intrinsics of ``rgb``.
        index: its number in the recording, for messages.

    Raises:
        FrameError: wrong shape or type, NaN, negative depth, or a camera of another size.
    """

    timestamp_s: float
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    camera: Camera
    index: int = 0

    def __post_init__(self) -> None:
        where = f"frame {self.index} (t={self.timestamp_s})"
        if not isinstance(self.timestamp_s, float | int | np.number) or not np.isfinite(self.timestamp_s):
            raise FrameError(f"{where}: timestamp_s is not finite seconds")
        arrays = isinstance(self.rgb, np.ndarray) and isinstance(self.depth_m, np.ndarray | None)
        if not arrays or not isinstance(self.camera, Camera):  # None is what cv2.imread makes of a file that is not there
            kinds = [type(value).__name__ for value in (self.rgb, self.depth_m, self.camera)]
            raise FrameError(f"{where}: rgb, depth_m and camera are {', '.join(kinds)}; wanted an array, an array or None, a Camera")
        if self.rgb.dtype != np.uint8 or self.rgb.ndim != 3 or self.rgb.shape[2] != 3:
            raise FrameError(f"{where}: rgb is {self.rgb.dtype} {self.rgb.shape}, wanted uint8 (H, W, 3)")
        size = (self.camera.height, self.camera.width)
        if self.rgb.shape[:2] != size:
            raise FrameError(
                f"{where}: rgb is {self.rgb.shape[1]}x{self.rgb.shape[0]}, the camera {size[1]}x{size[0]}; intrinsics must "
                "belong to the size of the images"
            )
        if self.depth_m is None:
            object.__setattr__(self, "depth_m", np.zeros(size, dtype=np.float32))
        if self.depth_m.dtype != np.float32 or self.depth_m.shape != size:
            raise FrameError(f"{where}: depth_m is {self.depth_m.dtype} {self.depth_m.shape}, wanted float32 {size}, in metres")
        lowest = float(self.depth_m.min())
        if not np.isfinite(lowest) or lowest < 0 or not np.isfinite(float(self.depth_m.max())):
            raise FrameError(f"{where}: depth_m holds NaN, infinity or negative values; wanted metres, 0 where no return")

    @property
    def has_depth(self) -> bool:
        """Whether any pixel has a depth."""
        return bool(self.depth_m.any())


class _Rows:
    """Indexing for structs of arrays: ``rows[mask]`` keeps the masked rows of every per-row field."""

    __slots__ = ()

    def __getitem__(self, rows: AnyArray) -> Self:
        wanted = np.asarray(rows)
        index = np.flatnonzero(wanted) if wanted.dtype == np.bool_ else wanted.astype(np.int64)
        changes: dict[str, Any] = {}
        for f in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            value = getattr(self, f.name)
            if isinstance(value, tuple):
                changes[f.name] = tuple(value[i] for i in index) if value else ()
            elif isinstance(value, np.ndarray):
                changes[f.name] = value[index]
        return replace(self, **changes)  # type: ignore[type-var]  # as above


def require_rows(name: str, array: AnyArray, shape: tuple[int, ...]) -> None:
    """Raise ``FrameError`` unless ``array`` has this shape and is finite."""
    if array.shape != shape:
        raise FrameError(f"{name}: got shape {array.shape}, wanted {shape}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array))[0][0])
        raise FrameError(f"{name}: row {row} is not finite: {array[row]!r}")


@dataclass(frozen=True, slots=True, eq=False)
class Detections(_Rows):
    """What a detector saw in one image.

    Attributes:
        boxes_px: (N, 4) float64, ``x0, y0, x1, y1``.
        labels: N words, or None where the detector has none (class-agnostic segments).
        scores: (N,) in [0, 1].
        masks: (N, H, W) bool, or None. A row without a single True pixel has no mask: its box is used.
        embeddings: (N, D) float64 of the detector's own, or None.
    """

    boxes_px: FloatArray
    labels: tuple[str | None, ...]
    scores: FloatArray
    masks: BoolArray | None = None
    embeddings: FloatArray | None = None

    def __post_init__(self) -> None:
        n = len(self.labels)
        require_rows("boxes_px", self.boxes_px, (n, 4))
        require_rows("scores", self.scores, (n,))
        if n and ((self.scores < 0) | (self.scores > 1)).any():
            raise FrameError(f"scores: got {float(self.scores.min())}..{float(self.scores.max())}, wanted 0..1")
        flat = (self.boxes_px[:, 2] <= self.boxes_px[:, 0]) | (self.boxes_px[:, 3] <= self.boxes_px[:, 1])
        if flat.any():
            row = int(np.flatnonzero(flat)[0])
            raise FrameError(f"boxes_px: row {row} is {self.boxes_px[row].tolist()}, wanted x0 < x1 and y0 < y1")
        if self.masks is not None and (self.masks.ndim != 3 or self.masks.shape[0] != n or self.masks.dtype != np.bool_):
            raise FrameError(f"masks: got {self.masks.dtype} {self.masks.shape}, wanted bool ({n}, H, W)")
        if self.embeddings is not None and (self.embeddings.ndim != 2 or self.embeddings.shape[0] != n):
            raise FrameError(f"embeddings: got {self.embeddings.shape}, wanted ({n}, D)")

    def __len__(self) -> int:
        return len(self.labels)

    @classmethod
    def empty(cls) -> Self:
        """Nothing was seen."""
        return cls(boxes_px=np.zeros((0, 4)), labels=(), scores=np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class Observations(_Rows):
    """Objects measured in one frame (SEO-SLAM III-A), camera frame, metres.

    Attributes:
        p_camera: (K, 3) centres.
        cov_camera: (K, 3, 3) covariance Gamma of Eq 2 and 3.
        size_m: (K, 2) width and height across the line of sight.
        labels: K words or None.
        scores: (K,) in [0, 1].
        embeddings: (K, D) unit rows: the embedding phi(cl) of the label, or, where features are of pictures too, of both; what has no
            label may have the mean of known words. Zeros where there is none of these.
        boxes_px: (K, 4), clipped to the image.
        truncated: (K, 4) bool: the box touches the left, top, right, bottom border of the image.
        clouds: K arrays (M, 3): a sample of the object's surface points.
        rows: (K,) int64, the row of each in the frame's ``Detections``.
    """

    p_camera: FloatArray
    cov_camera: FloatArray
    size_m: FloatArray
    labels: tuple[str | None, ...]
    scores: FloatArray
    embeddings: FloatArray
    boxes_px: FloatArray
    truncated: BoolArray
    clouds: tuple[FloatArray, ...]
    rows: IntArray

    def __post_init__(self) -> None:
        n = len(self.labels)
        require_rows("p_camera", self.p_camera, (n, 3))
        require_rows("cov_camera", self.cov_camera, (n, 3, 3))
        require_rows("size_m", self.size_m, (n, 2))
        require_rows("scores", self.scores, (n,))
        require_rows("boxes_px", self.boxes_px, (n, 4))
        require_rows("truncated", self.truncated, (n, 4))
        require_rows("rows", self.rows, (n,))
        if self.embeddings.ndim != 2 or self.embeddings.shape[0] != n or len(self.clouds) != n:
            raise FrameError(f"observations: {n} labels, {self.embeddings.shape} embeddings, {len(self.clouds)} clouds")

    def __len__(self) -> int:
        return len(self.labels)

    @classmethod
    def empty(cls, embedding_size: int = 0) -> Self:
        """Nothing was measured."""
        return cls(
            p_camera=np.zeros((0, 3)),
            cov_camera=np.zeros((0, 3, 3)),
            size_m=np.zeros((0, 2)),
            labels=(),
            scores=np.zeros(0),
            embeddings=np.zeros((0, embedding_size)),
            boxes_px=np.zeros((0, 4)),
            truncated=np.zeros((0, 4), dtype=np.bool_),
            clouds=(),
            rows=np.zeros(0, dtype=np.int64),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Landmark:
    """One thing in the map.

    Attributes:
        id: never reused.
        label: the heaviest of ``labels``, or what an agent called it, which need not be among them where there is a ``category``; ""
            while nothing has named it.
        labels: word -> weight, weights sum to 1 (empty if nothing has named it).
        position_m: (3,) in the world frame.
        covariance_m2: (3, 3) of the position.
        size_m: (3,) extent along the world's x, y and z.
        embedding: (D,) unit vector fused over the embeddings of all observations, which may be of pictures and of what has no name; zeros
            where all were, (0,) where a map was loaded without.
        observations: how often it was seen: once a keyframe, or more often where two observations of one were joined, by greedy matching
            or by a merge.
        first_seen_s, last_seen_s: stamps of the first and the last.
        state: "tentative" until seen often and long enough, then "stable"; "lost" while it is not where it should be seen.
        version: rises when label, state, merge or split change, not with every observation.
        existence: probability that it is there; 1 where that is not estimated.
        category: the plain word for it that an agent gave beside a descriptive label: "shoe" of a "green hiking boot"; else "".
        cloud_world: (M, 3) points of its surface, world frame, metres; none where no clouds are kept.
    """

    id: int
    label: str
    labels: Mapping[str, float]
    position_m: FloatArray
    covariance_m2: FloatArray
    size_m: FloatArray
    embedding: FloatArray
    observations: int
    first_seen_s: float
    last_seen_s: float
    state: LandmarkState
    version: int = 0
    existence: float = 1.0
    category: str = ""
    cloud_world: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True, slots=True, eq=False)
class Landmarks(_Rows):
    """Many landmarks as a struct of arrays; the attributes are those of ``Landmark``, one row each.

    Positions and covariances are in the world frame, metres. ``across_m`` (N, 2) is the usual width and height across the line of
    sight of views that show the thing whole, 0 where there was none. ``names`` and ``categories`` are ``Landmark``'s ``label`` and
    ``category``; empty where no agent gave any, see ``name_of``. ``clouds`` are what is known of their surfaces; empty where no clouds are
    kept.
    """

    ids: IntArray
    p_world: FloatArray
    cov_world: FloatArray
    size_m: FloatArray
    labels: tuple[Mapping[str, float], ...]
    embeddings: FloatArray
    observations: IntArray
    first_seen_s: FloatArray
    last_seen_s: FloatArray
    states: tuple[LandmarkState, ...]
    versions: IntArray
    across_m: FloatArray
    names: tuple[str, ...] = ()
    categories: tuple[str, ...] = ()
    clouds: "tuple[Cloud, ...]" = ()

    def __len__(self) -> int:
        return len(self.labels)

    def name_of(self, row: int) -> str:
        """What a landmark is called: the label that an agent gave, else the heaviest word; "" if nothing has named it."""
        return (self.names[row] if self.names else "") or heaviest(self.labels[row])

    def category_of(self, row: int) -> str:
        """The plain word that an agent gave beside a descriptive label, else ""."""
        return self.categories[row] if self.categories else ""

    @classmethod
    def from_rows(cls, rows: "list[Landmark]", embedding_size: int = 0) -> Self:
        """Stack landmarks; none give a struct with zero rows."""
        n = len(rows)
        D = rows[0].embedding.shape[0] if rows else embedding_size
        return cls(
            ids=np.array([r.id for r in rows], dtype=np.int64),
            p_world=np.array([r.position_m for r in rows], dtype=np.float64).reshape(n, 3),
            cov_world=np.array([r.covariance_m2 for r in rows], dtype=np.float64).reshape(n, 3, 3),
            size_m=np.array([r.size_m for r in rows], dtype=np.float64).reshape(n, 3),
            labels=tuple(r.labels for r in rows),
            embeddings=np.array([r.embedding for r in rows], dtype=np.float64).reshape(n, D),
            observations=np.array([r.observations for r in rows], dtype=np.int64),
            first_seen_s=np.array([r.first_seen_s for r in rows], dtype=np.float64),
            last_seen_s=np.array([r.last_seen_s for r in rows], dtype=np.float64),
            states=tuple(r.state for r in rows),
            versions=np.array([r.version for r in rows], dtype=np.int64),
            across_m=np.zeros((n, 2)),
            names=tuple(r.label for r in rows),
            categories=tuple(r.category for r in rows),
        )


def heaviest(labels: Mapping[str, float]) -> str:
    """The word with the largest weight, the alphabetically first on a tie; "" if there is none."""
    return min(labels, key=lambda word: (-labels[word], word)) if labels else ""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What odometry says of the step from the previous frame to this one.

    Attributes:
        T_previous_current: (4, 4); the identity for the first frame.
        covariance: (6, 6), rotation first, right-perturbed.
        status: "lost" when nothing could be measured; the motion is then a guess and its covariance says how poor.
        message: why it is lost, for the user; "" otherwise.
        T_world_camera: an absolute pose, if the odometry has one. It places the first camera; after that only a smoother of given
            poses takes it.
        end_covariance: (6, 6) of this frame's pose in the odometry's own map, if it measures every frame against one; else None.
            Its steps then telescope: ``covariance`` holds the errors of both ends, and only two ends count over many steps.
    """

    T_previous_current: FloatArray
    covariance: FloatArray
    status: OdometryStatus = "ok"
    message: str = ""
    T_world_camera: FloatArray | None = None
    end_covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_previous_current", require_transform(self.T_previous_current, "Motion.T_previous_current"))
        require_rows("Motion.covariance", self.covariance, (6, 6))
        if self.end_covariance is not None:
            require_rows("Motion.end_covariance", self.end_covariance, (6, 6))
        if self.T_world_camera is not None:
            object.__setattr__(self, "T_world_camera", require_transform(self.T_world_camera, "Motion.T_world_camera"))


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The camera pose of a keyframe as the smoother sees it.

    Attributes:
        T_world_camera: (4, 4).
        joint_covariance: landmark ids (M,) -> (6 + 3M, 6 + 3M) covariance of this pose (rotation first, right-perturbed) and those
            landmarks (world frame), in that order: Sigma of Eq 4. Computed when called, since it is the dearest part of a gate.
    """

    T_world_camera: FloatArray
    joint_covariance: Callable[[IntArray], FloatArray]

    @property
    def covariance(self) -> FloatArray:
        """(6, 6) covariance of the pose alone."""
        return self.joint_covariance(np.zeros(0, dtype=np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class Association:
    """Which landmark each observation belongs to.

    Attributes:
        landmark_ids: (K,) int64: an id, ``NEW`` or ``REJECTED``.
        costs: (K,) float64: cost of the chosen pair, squared Mahalanobis distance first; NaN for NEW and REJECTED.
        shared: several observations may be of one landmark (DualMap's greedy matching); else that is refused.
    """

    landmark_ids: IntArray
    costs: FloatArray
    shared: bool = False

    def __post_init__(self) -> None:
        if self.landmark_ids.shape != self.costs.shape or self.landmark_ids.ndim != 1:
            raise FrameError(f"association: got {self.landmark_ids.shape} ids and {self.costs.shape} costs, wanted (K,) of each")
        matched = self.landmark_ids[self.landmark_ids >= 0]
        if not self.shared and len(np.unique(matched)) != len(matched):
            raise FrameError(f"association: a landmark is given to two observations: {self.landmark_ids.tolist()}")
