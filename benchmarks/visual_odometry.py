"""Visual odometry against plain ORB and PnP on one keyframe, on a TUM recording, interleaved frame by frame in one run.

python benchmarks/visual_odometry.py DATASET [--max-frames N] [--stride N]
Prints one JSON object: error (protocol ape/1) and milliseconds a frame of both, and the ratios.
"""

import argparse
import json
import time

import cv2
import numpy as np

from seo_slam import geometry
from seo_slam.backends.visual_odometry import VisualOdometry
from seo_slam.datasets.trajectory_files import read_trajectory
from seo_slam.datasets.tum import TumDataset
from seo_slam.evaluation.trajectory import APE_PROTOCOL, ape
from seo_slam.geometry import FloatArray
from seo_slam.records import Trajectory
from seo_slam.types import Frame


class OneKeyframeOrb:
    """The baseline: 1000 ORB features, brute-force matches with cross-check to the last keyframe, PnP with RANSAC."""

    def __init__(self) -> None:
        self._orb = cv2.ORB_create(1000)
        self._matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
        self._T_world_camera = np.eye(4)
        self._T_world_keyframe = np.eye(4)
        self._p_keyframe = np.zeros((0, 3))
        self._descriptors = np.zeros((0, 32), dtype=np.uint8)

    def update(self, frame: Frame) -> FloatArray:
        """Return ``T_world_camera``; the last pose again when too little matches."""
        grey = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY)
        keypoints, descriptors = self._orb.detectAndCompute(grey, None)
        if descriptors is None:
            return self._T_world_camera
        uv_px = cv2.KeyPoint_convert(keypoints).astype(np.float64)
        inliers = self._track(frame, uv_px, descriptors)
        if inliers < 150:
            self._make_keyframe(frame, uv_px, descriptors)
        return self._T_world_camera

    def _track(self, frame: Frame, uv_px: FloatArray, descriptors: np.ndarray) -> int:
        matches = self._matcher.match(self._descriptors, descriptors) if len(self._descriptors) else []
        if len(matches) < 8:
            return 0
        p_keyframe = self._p_keyframe[[m.queryIdx for m in matches]]
        rays = frame.camera.undistort(uv_px[[m.trainIdx for m in matches]])
        uv_pinhole_px = rays * [frame.camera.fx, frame.camera.fy] + [frame.camera.cx, frame.camera.cy]
        cv2.setRNGSeed(0)
        found, rotation, translation, inliers = cv2.solvePnPRansac(
            p_keyframe, uv_pinhole_px, frame.camera.matrix, None, reprojectionError=3.0, iterationsCount=200
        )
        if not found or inliers is None:
            return 0
        T_camera_keyframe = np.eye(4)
        T_camera_keyframe[:3, :3] = geometry.so3_exp(rotation.ravel())
        T_camera_keyframe[:3, 3] = translation.ravel()
        self._T_world_camera = self._T_world_keyframe @ geometry.inverse(T_camera_keyframe)
        return len(inliers)

    def _make_keyframe(self, frame: Frame, uv_px: FloatArray, descriptors: np.ndarray) -> None:
        column, row = np.rint(uv_px).astype(int).T
        depth_m = frame.depth_m[row, column].astype(np.float64)
        lifted = depth_m > 0
        self._p_keyframe = frame.camera.back_project(uv_px[lifted], depth_m[lifted])
        self._descriptors = descriptors[lifted]
        self._T_world_keyframe = self._T_world_camera


def main() -> None:
    """Run both over the recording."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset")
    parser.add_argument("--max-frames", type=int)
    parser.add_argument("--stride", type=int, default=1)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    recording = TumDataset(arguments.dataset, stride=arguments.stride, max_frames=arguments.max_frames)
    ours, baseline = VisualOdometry(initial_pose=np.eye(4)), OneKeyframeOrb()
    poses: dict[str, list[FloatArray]] = {"visual": [], "one_keyframe_orb": []}
    milliseconds: dict[str, list[float]] = {"visual": [], "one_keyframe_orb": []}
    stamps_s, lost = [], 0
    for frame in recording:
        stamps_s.append(frame.timestamp_s)
        started_s = time.perf_counter()
        motion = ours.update(frame)
        between_s = time.perf_counter()
        T_baseline = baseline.update(frame)
        ended_s = time.perf_counter()
        lost += motion.status == "lost"
        poses["visual"].append(motion.T_world_camera)
        poses["one_keyframe_orb"].append(T_baseline)
        milliseconds["visual"].append(1e3 * (between_s - started_s))
        milliseconds["one_keyframe_orb"].append(1e3 * (ended_s - between_s))
    if recording.groundtruth is None:
        parser.error(f"{recording.path} has no groundtruth.txt")
    truth = read_trajectory(recording.groundtruth)
    result: dict[str, object] = {"protocol": APE_PROTOCOL, "frames": len(stamps_s), "stride": arguments.stride, "lost_frames": lost}
    for name in poses:
        error = ape(Trajectory(np.array(stamps_s), np.array(poses[name])), truth)
        median_ms, p95_ms = np.percentile(milliseconds[name], [50, 95])
        result[name] = {
            "ape_rmse_m": round(error.rmse_m, 4),
            "ape_max_m": round(error.max_m, 4),
            "compared": error.compared,
            "ms_median": round(float(median_ms), 1),
            "ms_p95": round(float(p95_ms), 1),
        }
    a, b = result["visual"], result["one_keyframe_orb"]
    assert isinstance(a, dict)
    assert isinstance(b, dict)
    result["ratio_ape"] = round(a["ape_rmse_m"] / b["ape_rmse_m"], 3)
    result["ratio_ms_median"] = round(a["ms_median"] / b["ms_median"], 3)
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
