"""A map asked in everyday words (SEO-SLAM IV-D, Fig 7)."""

from seo_slam.ask.answer import Answer as Answer
from seo_slam.ask.answer import ask as ask
from seo_slam.ask.answer import ask_async as ask_async
from seo_slam.ask.retrieval import Retrieved as Retrieved
