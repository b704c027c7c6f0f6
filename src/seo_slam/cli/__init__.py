"""The command ``seo-slam``: thin, no logic that a library user would miss."""
