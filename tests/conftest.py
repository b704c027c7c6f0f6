"""Fixtures shared by all tests."""

import os
import signal
from pathlib import Path

import pytest


def _shared_folder() -> Path:
    return Path(os.environ.get("SEO_SLAM_SHARED", Path(__file__).resolve().parents[2] / "shared"))


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder with real recordings and models; a test that asks for it skips where it is absent, but never in CI."""
    folder = _shared_folder()
    if not (folder / "data").is_dir():
        message = f"needs real data: no folder {folder} (set SEO_SLAM_SHARED to one that holds data/ and models/)"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    return folder


def pytest_configure(config):
    """Whatever starts the tests in the background may have them ignore Ctrl-C; some of them press it."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
