"""gazebo_ros' services that let time run, stand still or begin again.

Everything here runs in the simulator's loop, between two steps.
"""

from __future__ import annotations

from std_srvs.srv import Empty, EmptyResponse

from g1_description.ros.gazebo.stepper import Stepper
from g1_description.sim.world import World

from .base import Services, Wording


class TimeServices(Services):
    """Pause, go on, begin again."""

    def __init__(self, world: World, wording: Wording, stepper: Stepper) -> None:
        """Serve a world.

        Args:
            world: What the services act on.
            wording: How much they say.
            stepper: Whether time runs.
        """
        super().__init__(world, wording)
        self._stepper = stepper

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("pause_physics", Empty, self.pause),
            ("unpause_physics", Empty, self.unpause),
            ("reset_simulation", Empty, self.reset_simulation),
            ("reset_world", Empty, self.reset_world),
        )

    def pause(self, _):
        """Let time stand still, also where steps were asked for."""
        self._stepper.paused = True
        self._stepper.end("pause_physics")
        return EmptyResponse()

    def unpause(self, _):
        """Let time run."""
        self._stepper.paused = False
        return EmptyResponse()

    def reset_simulation(self, _):
        """Begin again: time zero, models as spawned, joints at zero."""
        self._world.reset()
        self._stepper.end("reset_simulation")
        return EmptyResponse()

    def reset_world(self, _):
        """Put the models back where they were spawned, joints as they are."""
        self._world.reset_models()
        self._stepper.end("reset_world")
        return EmptyResponse()
