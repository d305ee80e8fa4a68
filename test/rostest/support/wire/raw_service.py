"""A set_model_configuration on raw sockets: slow, refusing or dying as a test wants."""

import contextlib
import socket
import struct
import threading

import rosgraph
import rospy
from gazebo_msgs.srv import SetModelConfiguration, SetModelConfigurationResponse

from ..ros_testing import DEADLINE, wait_for
from tcpros import ANSWER, LENGTH, body_of, header_of, received

SERVICE = "/gazebo/set_model_configuration"
SUCCESS = SetModelConfigurationResponse(True, "SetModelConfiguration: success")
RESET = struct.pack("ii", 1, 0)
"""SO_LINGER that makes closing a socket reset its connection."""


class Simulator:
    """The service of a simulator, and all that it was asked for."""

    def __init__(self, name=SERVICE):
        """Register the service.

        Args:
            name: Its full name.
        """
        self.name = name
        self.requests = []
        """Model and positions by joint, of each request when it came."""
        self.state = {}
        """Positions by model and joint, of the requests that were answered so."""
        self.answers = lambda model: SUCCESS
        """Makes the answer to a request; it may take its time."""
        self._sockets = []
        self._listener = socket.create_server(("localhost", 0))
        self._uri = f"rosrpc://localhost:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()
        self._master = rosgraph.Master(rospy.get_name())
        self._master.registerService(name, self._uri, rospy.get_node_uri())

    def _accept(self):
        """Serve each client in a thread of its own."""
        with contextlib.suppress(OSError):  # closed
            while True:
                sock, _ = self._listener.accept()
                # With a timeout, as rosunit sets, Python polls first, and a poll that
                # is woken late may find the next socket of the same number.
                sock.settimeout(None)
                self._sockets.append(sock)
                threading.Thread(target=self._serve, args=[sock], daemon=True).start()

    def _serve(self, sock):
        """Shake hands and answer requests until one side closes the connection."""
        with contextlib.suppress(OSError):
            self._receive(sock)
            fields = {"type": SetModelConfiguration._type, "callerid": "/simulator"}
            sock.sendall(header_of(md5sum=SetModelConfiguration._md5sum, **fields))
            while True:
                request = SetModelConfiguration._request_class()
                request.deserialize(self._receive(sock))
                positions = dict(zip(request.joint_names, request.joint_positions))
                self.requests.append((request.model_name, positions))
                answer = self.answers(request.model_name)
                body = body_of(answer)
                sock.sendall(ANSWER.pack(1, len(body)) + body)
                if answer.success:
                    self.state.setdefault(request.model_name, {}).update(positions)

    @staticmethod
    def _receive(sock):
        return received(sock, LENGTH.unpack(received(sock, LENGTH.size))[0])

    def wait_for_request(self, **positions):
        """Wait for a request with exactly these positions."""
        wait_for(
            lambda: any(asked == positions for _, asked in list(self.requests)),
            f"a request for {positions}",
        )

    def reset(self):
        """Reset all connections, as the end of a simulator does."""
        sockets, self._sockets = self._sockets, []
        for sock in sockets:
            with contextlib.suppress(OSError):
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
                sock.shutdown(socket.SHUT_RD)
                sock.close()

    def close(self):
        """End, and tell the master if it is there."""
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
            self._master.unregisterService(self.name, self._uri)
        self._listener.close()
        self.reset()


def refusal(words):
    """Make the answer of a simulator that does not obey."""
    return SetModelConfigurationResponse(False, words)


class Gate:
    """Something to wait for in an answer, until the test opens it."""

    def __init__(self, answer=SUCCESS):
        self._open = threading.Event()
        self._answer = answer
        self.open = self._open.set

    def __call__(self, model):
        """Wait, then give the answer."""
        self._open.wait(DEADLINE)
        return self._answer
