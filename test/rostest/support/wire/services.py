"""All services of a node, each on a connection of its own."""

import rosgraph

from tcpros import Service


class Services:
    """All services of the node by their names below it."""

    def __init__(self, node="/gazebo"):
        master = rosgraph.Master("/test")
        scope = f"{node}/"
        offered = (name for name, _ in master.getSystemState()[2])
        self.names = sorted(n[len(scope) :] for n in offered if n.startswith(scope))
        self._services = {name: Service(scope + name) for name in self.names}

    def __getitem__(self, name):
        """Give the connection to a service."""
        return self._services[name]

    def call(self, name, *args, **fields):
        """Call a service as rospy does."""
        return self._services[name](*args, **fields)

    def close(self):
        for service in self._services.values():
            service.close()
