"""Walking to things by name: candidates, paths, and a navigator for any robot loop (DualMap IV-B, IV-C)."""
