"""The simulated world: models, forces, time, and motions that models play."""
