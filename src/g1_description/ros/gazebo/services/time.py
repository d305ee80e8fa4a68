"""gazebo_ros' services that let time run, stand still or begin again.

Everything here runs in the simulator's loop, between two steps.
"""

from __future__ import annotations

from std_srvs.srv import Empty, EmptyResponse

from .base import SteppedServices


class TimeServices(SteppedServices):
    """Pause, go on, begin again."""

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("pause_physics", Empty, self.pause),
            ("unpause_physics", Empty, self.unpause),
            ("reset_simulation", Empty, self.reset_simulation),
            ("reset_world", Empty, self.reset_world),
        )

    def pause(self, _):
        """Pause, also where steps were requested."""
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
