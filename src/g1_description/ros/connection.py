"""Calls of the simulator's services, by programs that need not be nodes.

Connections are persistent: a new one takes 2 ms.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlparse

import rosgraph
import rospy

from g1_description.ros.waiting import (
    MASTER_PERIOD,
    SLAVE_API_ERRORS,
    NoAnswerError,
    RefusedError,
    wait_until,
)


class Connection:
    """The services of a simulator, with persistent connections."""

    def __init__(self, gazebo: str, timeout: float) -> None:
        """Create a connection; nothing is called yet.

        Args:
            gazebo: Namespace of the simulator.
            timeout: Longest wait for the master and for services, in [s].
        """
        self._gazebo = "/" + gazebo.strip("/")
        self._timeout = timeout
        self._proxies: dict[str, rospy.ServiceProxy] = {}

    def wait_for(self, service: str) -> None:
        """Wait for a service.

        Raises:
            NoAnswerError: If there is no master, or no such service in time.
        """
        if wait_until(lambda: self._has(service), self._timeout, None, MASTER_PERIOD):
            return
        if self._has("pause_physics"):
            why = f"{self._gazebo} is not the simulator of this package"
        else:
            why = f"{self._gazebo} is not running; is the simulator launched?"
        name = f"{self._gazebo}/{service}"
        raise NoAnswerError(f"No service {name} within {self._timeout:g} s: {why}")

    def _has(self, service: str) -> bool:
        """Return whether the master knows a service.

        Raises:
            NoAnswerError: If there is no master.
        """
        uri = rosgraph.get_master_uri()
        try:
            with _default_timeout(self._timeout):
                _check_address(uri)
                master = rosgraph.Master("/g1_description_client")
                master.lookupService(f"{self._gazebo}/{service}")
        except rosgraph.MasterError:
            return False
        except (*SLAVE_API_ERRORS, rosgraph.MasterException, ValueError) as error:
            raise NoAnswerError(
                f"No ROS master at {uri}: {error}. Is it running, and is "
                "ROS_MASTER_URI correct?"
            ) from error
        return True

    def call(self, service: str, kind: type, **fields: Any) -> Any:
        """Call a service.

        Args:
            service: Its name below the simulator's.
            kind: Its class.
            fields: Fields of the request.

        Raises:
            NoAnswerError: If it does not answer.
        """
        name = f"{self._gazebo}/{service}"
        if service not in self._proxies:
            self._proxies[service] = rospy.ServiceProxy(name, kind, persistent=True)
        try:
            return self._proxies[service](**fields)
        except (rospy.ServiceException, *SLAVE_API_ERRORS) as error:
            self._drop(service)
            raise NoAnswerError(
                f"{name} does not answer; is the simulator still running? {error}"
            ) from error
        except BaseException:  # a late answer would be read by the next request
            self._drop(service)
            raise

    def checked(self, service: str, kind: type, **fields: Any) -> Any:
        """Call a service that may refuse.

        Raises:
            RefusedError: If it does.
            NoAnswerError: If it does not answer.
        """
        answer = self.call(service, kind, **fields)
        if not answer.success:
            raise RefusedError(answer.status_message.rstrip(".") + ".")
        return answer

    def close(self) -> None:
        """Close all connections; the next call makes a new one."""
        for service in list(self._proxies):
            self._drop(service)

    def _drop(self, service: str) -> None:
        """Close one connection."""
        self._proxies.pop(service).close()


@contextlib.contextmanager
def _default_timeout(seconds: float) -> Iterator[None]:
    """Set the default timeout of sockets meanwhile."""
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(seconds)
    try:
        yield
    finally:
        socket.setdefaulttimeout(before)


def _check_address(uri: str) -> None:
    """Check the form of the master's URI.

    Raises:
        ValueError: If it is malformed.
    """
    parts = urlparse(uri)
    try:
        is_valid = parts.scheme == "http" and parts.hostname and parts.port
    except ValueError:  # the port is not a number
        is_valid = False
    if not is_valid:
        raise ValueError("it must be like http://HOST:PORT")
