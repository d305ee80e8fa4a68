"""One model of an SDF document: its links, joints and tree."""
