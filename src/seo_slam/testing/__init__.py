"""Contract checks for authors of plug-ins: ``check_detector(mine)`` and so on. Each raises ``AssertionError`` with a clear text."""

from seo_slam.testing.agent import check_agent as check_agent
from seo_slam.testing.assignment import check_assignment_solver as check_assignment_solver
from seo_slam.testing.associator import check_associator as check_associator
from seo_slam.testing.detector import check_detector as check_detector
from seo_slam.testing.embedder import check_embedder as check_embedder
from seo_slam.testing.odometry import check_odometry as check_odometry
from seo_slam.testing.smoother import check_smoother as check_smoother
from seo_slam.testing.store import check_store as check_store
