"""From the concrete map to the abstract one: anchors, what is on them, layout and rooms (DualMap IV-A, IV-D)."""
