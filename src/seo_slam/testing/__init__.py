"""Contract checks for authors of plug-ins: ``check_store(make_store)`` and so on. Each raises ``AssertionError`` with a clear text."""

from seo_slam.testing.store import check_store as check_store
