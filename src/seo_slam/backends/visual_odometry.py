"""Visual odometry of an RGB-D camera: ORB features lifted by depth, PnP against a local map of several keyframes.

The scheme is that of keyframe SLAM front ends (Klein and Murray, ISMAR 2007; Mur-Artal and Tardos, T-RO 2017): every frame is
measured against points that several keyframes saw, so that errors do not add up from frame to frame; a new keyframe
adds points and refines those it sees. There is no loop closure.
"""

import numpy as np
from numpy.typing import ArrayLike

from seo_slam import geometry
from seo_slam.backends.visual_features import FeatureExtractor, Features
from seo_slam.backends.visual_local_map import Keyframe, LocalMap, turn_and_shift
from seo_slam.backends.visual_tracking import Track, Tracker
from seo_slam.errors import ConfigError, FrameError
from seo_slam.geometry import FloatArray
from seo_slam.types import Frame, IntArray, Motion

_MIN_POINTS_TO_START = 40
_TRUSTED_GAP_S = 0.5
_KEYFRAMES_TO_RELOCALISE = 4
_RELOCALISE_INLIERS = 25
_START_SIGMA = 1e-4


class VisualOdometry:
    """Odometry from colour and depth images alone; ``Odometry`` of ``seo_slam.interfaces``.

    Args:
        initial_pose: (4, 4) ``T_world_camera`` of the first frame. With it every motion carries an absolute pose; without it
            none does, since the camera cannot know which way is up.
        seed: of RANSAC; the same frames and seed give the same motions, bit for bit.
        features: ORB features a frame.
        depth_noise_at_1m_m: axial depth noise is this times depth squared; 0.0019 is a Kinect v1 (Khoshelham and Elberink 2012).
        timing_sigma_s: how well the stamp of an image says when its pixels were lit: jitter, rolling shutter, colour and depth
            taken at different moments. The covariance grows by what the camera moves in that time. 0 for a simulated camera.
        max_depth_m: farther depth is ignored.
        local_keyframes: a frame is measured against the points of this many keyframes that share points with the frame before,
            and of as many that look at the scene from nearby.
        min_inliers: with fewer agreeing matches the frame is lost.
        keyframe_share: a frame becomes a keyframe when it sees less than this share of the points its reference keyframe had.
        keyframe_shift: … or moved this far from it, as a share of the scene's depth,
        keyframe_turn_deg: … or turned this much.
        max_keyframes: keyframes remembered; the farthest one is forgotten first.
        restart_frames: after this many frames with good features that fit nothing remembered, a new map is begun.

    Raises:
        ConfigError: a setting is out of range.
        FrameError: ``initial_pose`` is not a rigid transform.
    """

    def __init__(
        self,
        initial_pose: ArrayLike | None = None,
        seed: int = 0,
        features: int = 1200,
        depth_noise_at_1m_m: float = 0.0019,
        timing_sigma_s: float = 0.015,
        max_depth_m: float = 6.0,
        local_keyframes: int = 5,
        min_inliers: int = 15,
        keyframe_share: float = 0.6,
        keyframe_shift: float = 0.1,
        keyframe_turn_deg: float = 10.0,
        max_keyframes: int = 120,
        restart_frames: int = 5,
    ) -> None:
        for name, value, least in (
            ("seed", seed, 0),
            ("features", features, 100),
            ("local_keyframes", local_keyframes, 1),
            ("min_inliers", min_inliers, 6),
            ("max_keyframes", max_keyframes, 2),
            ("restart_frames", restart_frames, 1),
            ("timing_sigma_s", timing_sigma_s, 0),
        ):
            if value < least:
                raise ConfigError(f"visual odometry: {name} is {value}, wanted at least {least}")
        for name, number in (
            ("depth_noise_at_1m_m", depth_noise_at_1m_m),
            ("max_depth_m", max_depth_m),
            ("keyframe_share", keyframe_share),
            ("keyframe_shift", keyframe_shift),
            ("keyframe_turn_deg", keyframe_turn_deg),
        ):
            if not number > 0:
                raise ConfigError(f"visual odometry: {name} is {number}, wanted more than 0")
        self._absolute = initial_pose is not None
        self._T_world_camera = np.eye(4) if initial_pose is None else geometry.require_transform(initial_pose, "initial_pose")
        self._extractor = FeatureExtractor(features, depth_noise_at_1m_m, max_depth_m)
        self._tracker = Tracker(min_inliers, seed)
        self._local_keyframes = local_keyframes
        self._timing_sigma_s = timing_sigma_s
        self._keyframe_share = keyframe_share
        self._keyframe_shift = keyframe_shift
        self._keyframe_turn_rad = float(np.deg2rad(keyframe_turn_deg))
        self._restart_frames = restart_frames
        self._map = LocalMap(max_keyframes)
        self._pose_covariance = _START_SIGMA**2 * np.eye(6)
        self._velocity = np.zeros(6)
        self._timestamp_s: float | None = None
        self._found: IntArray = np.zeros(0, dtype=np.int64)
        self._reference: Keyframe | None = None
        self._reference_count = 0
        self._depth_m = 2.0
        self._unrecognised = 0
        self._lost = False

    def update(self, frame: Frame) -> Motion:
        """Return the motion from the frame given before to this one; the identity for the first.

        Raises:
            FrameError: the frame is not later than the one before.
        """
        first = self._timestamp_s is None
        elapsed_s = 0.0 if self._timestamp_s is None else frame.timestamp_s - self._timestamp_s
        if not first and elapsed_s <= 0:
            raise FrameError(f"frame {frame.index} (t={frame.timestamp_s}): wanted a stamp after {self._timestamp_s}")
        self._timestamp_s = frame.timestamp_s
        features = self._extractor.extract(frame)
        if not self._map.keyframes:
            return self._begin(frame, features, elapsed_s, first)
        track = self._measure(frame, features, elapsed_s)
        if track is None:
            return self._lose(frame, features, elapsed_s)
        return self._follow(frame, features, track, elapsed_s)

    def _begin(self, frame: Frame, features: Features, elapsed_s: float, first: bool) -> Motion:
        """Make the first keyframe of a map where the camera is thought to be."""
        with_depth = int(features.has_depth.sum())
        if with_depth < _MIN_POINTS_TO_START:
            why = f"{with_depth} features with depth, {_MIN_POINTS_TO_START} needed to begin a map"
            return self._guess(elapsed_s, f"frame {frame.index}: {why}")
        motion = self._guess(elapsed_s, f"frame {frame.index}: a new map begins here; how the camera came here was not seen")
        self._pose_covariance = _START_SIGMA**2 * np.eye(6)  # from here on the new map is what poses are measured against
        self._add_keyframe(frame, features, np.full(len(features), -1, dtype=np.int64))
        self._lost = False
        return self._motion(np.eye(4), self._pose_covariance) if first else motion

    def _measure(self, frame: Frame, features: Features, elapsed_s: float) -> Track | None:
        if len(features) < self._tracker.min_inliers:
            return None
        candidates = self._map.candidates(self._local(self._T_world_camera))
        trusted = elapsed_s < _TRUSTED_GAP_S and not self._lost
        guess = self._T_world_camera @ geometry.exp(self._velocity * (elapsed_s if trusted else 0.0))
        track = self._tracker.near(candidates, features, frame.camera, guess)
        if track is not None and (track.is_good or (not self._lost and _is_plausible(guess, track.T_world_camera, elapsed_s))):
            return track
        return self._relocalise(frame, features)

    def _relocalise(self, frame: Frame, features: Features) -> Track | None:
        """Look for a keyframe that saw the same: near the last known pose, then the newest, with every lost frame older ones."""
        near = self._map.nearest(self._T_world_camera, self._depth_m, _KEYFRAMES_TO_RELOCALISE)
        others = [k for k in reversed(self._map.keyframes) if all(k is not n for n in near)]
        start = self._unrecognised * _KEYFRAMES_TO_RELOCALISE
        for keyframe in near + others[start : start + _KEYFRAMES_TO_RELOCALISE]:
            track = self._tracker.anywhere(self._map.candidates([keyframe]), features, frame.camera)
            if track is None:
                continue
            self._found = track.found
            candidates = self._map.candidates(self._local(track.T_world_camera))
            track = self._tracker.near(candidates, features, frame.camera, track.T_world_camera)
            if track is not None and len(track.found) >= _RELOCALISE_INLIERS:
                return track
        return None

    def _local(self, T_world_camera: FloatArray) -> list[Keyframe]:
        """The keyframes to measure against, nearest view first."""
        near = self._map.nearest(T_world_camera, self._depth_m, self._local_keyframes)
        shared = self._map.covisible(self._found, self._local_keyframes)
        return near + [k for k in shared if all(k is not n for n in near)]

    def _follow(self, frame: Frame, features: Features, track: Track, elapsed_s: float) -> Motion:
        T_previous_current = geometry.inverse(self._T_world_camera) @ track.T_world_camera
        self._velocity = np.zeros(6) if self._lost else geometry.log(T_previous_current) / elapsed_s
        pose_covariance = track.covariance + self._timing_covariance()
        Ad = geometry.adjoint(geometry.inverse(T_previous_current))
        covariance = Ad @ self._pose_covariance @ Ad.T + pose_covariance
        self._lost, self._unrecognised = False, 0
        self._T_world_camera, self._pose_covariance = track.T_world_camera, pose_covariance
        self._found = track.found
        self._map.count_sightings(track.visible, track.found)
        motion = self._motion(T_previous_current, covariance)
        if features.has_depth.any():
            self._depth_m = float(np.median(1.0 / features.inverse_depth[features.has_depth]))
            if self._wants_keyframe(track):
                self._add_keyframe(frame, features, track.points)
        return motion

    def _timing_covariance(self) -> FloatArray:
        """What a wrong stamp does to a pose: half of it along the motion, half in any direction (rows of a rolling shutter)."""
        speed = self._velocity
        spread = np.repeat([speed[:3] @ speed[:3], speed[3:] @ speed[3:]], 3) / 3.0
        return np.asarray(self._timing_sigma_s**2 * 0.5 * (np.outer(speed, speed) + np.diag(spread)), dtype=np.float64)

    def _wants_keyframe(self, track: Track) -> bool:
        if self._reference is None or not track.is_good:
            return False
        turn_rad, shift_m = turn_and_shift(geometry.inverse(self._reference.T_world_camera) @ track.T_world_camera)
        return (
            len(track.found) < self._keyframe_share * self._reference_count
            or shift_m > self._keyframe_shift * self._depth_m
            or turn_rad > self._keyframe_turn_rad
        )

    def _add_keyframe(self, frame: Frame, features: Features, points: IntArray) -> None:
        keyframe = self._map.add_keyframe(self._T_world_camera, frame.camera, features, points)
        self._reference, self._reference_count = keyframe, max(int((points >= 0).sum()), len(keyframe.points) // 2)
        self._map.compact()
        self._found = keyframe.points

    def _lose(self, frame: Frame, features: Features, elapsed_s: float) -> Motion:
        usable = int(features.has_depth.sum())
        self._unrecognised += usable >= _MIN_POINTS_TO_START
        if self._unrecognised >= self._restart_frames:
            self._map = LocalMap(self._map.max_keyframes)
            self._unrecognised = 0
            return self._begin(frame, features, elapsed_s, first=False)
        return self._guess(
            elapsed_s,
            f"frame {frame.index}: its {len(features)} features ({usable} with depth) agree with the map on no pose that could be "
            f"trusted ({self._tracker.min_inliers} matches at least)",
        )

    def _guess(self, elapsed_s: float, why: str) -> Motion:
        """A motion that nothing measured: half the speed of before, then none."""
        T_previous_current = geometry.exp(self._velocity * min(elapsed_s, _TRUSTED_GAP_S))
        self._velocity = 0.5 * self._velocity
        self._lost = True
        sigma = np.repeat([0.05 + 1.0 * elapsed_s, 0.05 + 0.5 * elapsed_s], 3)
        covariance = np.diag(sigma**2)
        Ad = geometry.adjoint(geometry.inverse(T_previous_current))
        self._pose_covariance = Ad @ self._pose_covariance @ Ad.T + covariance
        self._T_world_camera = self._T_world_camera @ T_previous_current
        return self._motion(T_previous_current, covariance, why)

    def _motion(self, T_previous_current: FloatArray, covariance: FloatArray, why: str = "") -> Motion:
        return Motion(
            T_previous_current=T_previous_current,
            covariance=0.5 * (covariance + covariance.T),
            status="lost" if why else "ok",
            message=why,
            T_world_camera=self._T_world_camera.copy() if self._absolute else None,
            end_covariance=None if why else 0.5 * (self._pose_covariance + self._pose_covariance.T),
        )


def _is_plausible(T_world_guess: FloatArray, T_world_camera: FloatArray, elapsed_s: float) -> bool:
    """Whether a pose that few matches support is near what was expected; chance agreements are anywhere."""
    turn_rad, shift_m = turn_and_shift(geometry.inverse(T_world_guess) @ T_world_camera)
    return turn_rad < 0.2 + 2.0 * elapsed_s and shift_m < 0.1 + 1.0 * elapsed_s
