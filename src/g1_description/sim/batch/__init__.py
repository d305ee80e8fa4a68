"""Many motions judged: one after the other, by processes, or by a cluster."""
