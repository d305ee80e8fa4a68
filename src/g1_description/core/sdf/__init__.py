"""SDF documents: worlds, their models, lights, states and physics."""
