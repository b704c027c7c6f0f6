"""For authors of plug-ins: contract checks (``check_detector(mine)`` and so on), and a chat server to test agents with.

Each check raises ``AssertionError`` with a clear text.
"""

from seo_slam.testing.agent import check_agent as check_agent
from seo_slam.testing.assignment import check_assignment_solver as check_assignment_solver
from seo_slam.testing.associator import check_associator as check_associator
from seo_slam.testing.chat_faults import BadStatus as BadStatus
from seo_slam.testing.chat_faults import Cut as Cut
from seo_slam.testing.chat_faults import Dies as Dies
from seo_slam.testing.chat_faults import Empty as Empty
from seo_slam.testing.chat_faults import Fault as Fault
from seo_slam.testing.chat_faults import Fenced as Fenced
from seo_slam.testing.chat_faults import Hang as Hang
from seo_slam.testing.chat_faults import Huge as Huge
from seo_slam.testing.chat_faults import NotJson as NotJson
from seo_slam.testing.chat_faults import RateLimited as RateLimited
from seo_slam.testing.chat_faults import Refusal as Refusal
from seo_slam.testing.chat_faults import RefusedKey as RefusedKey
from seo_slam.testing.chat_faults import ServerError as ServerError
from seo_slam.testing.chat_faults import Sometimes as Sometimes
from seo_slam.testing.chat_faults import WrongJson as WrongJson
from seo_slam.testing.chat_limits import Seen as Seen
from seo_slam.testing.chat_limits import most_requests as most_requests
from seo_slam.testing.chat_limits import most_tokens as most_tokens
from seo_slam.testing.chat_model import check_chat_model as check_chat_model
from seo_slam.testing.chat_server import ChatServer as ChatServer
from seo_slam.testing.detector import check_detector as check_detector
from seo_slam.testing.embedder import check_embedder as check_embedder
from seo_slam.testing.odometry import check_odometry as check_odometry
from seo_slam.testing.scripted_chat import scripted as scripted
from seo_slam.testing.smoother import check_smoother as check_smoother
from seo_slam.testing.store import check_store as check_store
