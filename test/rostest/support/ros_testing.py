"""What the test nodes share: waiting with a deadline, and the newest message."""

import signal
import subprocess
import sys
import threading
import time
from functools import lru_cache
from pathlib import Path
from xmlrpc.client import ServerProxy

import rosgraph
import roslib.packages
import rosnode
import rospy
from gazebo_msgs.srv import GetPhysicsProperties, SetPhysicsProperties
from rosgraph_msgs.msg import Log
from std_srvs.srv import Empty

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # of all tests
from waiting import DEADLINE, wait_for

REPOSITORY = Path(__file__).resolve().parents[3]
PROFILE = REPOSITORY / "config" / "robots" / "g1_29dof"
SHARED = REPOSITORY.parent / "shared"


@lru_cache(maxsize=None)
def program(name, package="g1_description"):
    """Find a program of a package once; each rosrun looks for it anew."""
    return roslib.packages.find_node(package, name)[0]


def position_of(message, joint):
    """Give a joint's position in a JointState, in [rad] or [m]."""
    return message.position[message.name.index(joint)]


def is_at(message, joint, position):
    """Tell whether a joint is at a position, within what is promised: 1e-9."""
    return abs(position_of(message, joint) - position) < 1e-9


def wait_slowly(condition, what):
    """Wait for a condition that costs processor time to ask for."""
    due = 0.0

    def ask():
        nonlocal due
        if time.monotonic() < due:
            return None
        result = condition()
        due = time.monotonic() + 0.5
        return result

    return wait_for(ask, what)


def service(name, kind):
    """Give what calls a service, when it is there."""
    rospy.wait_for_service(name, DEADLINE)
    return rospy.ServiceProxy(name, kind)


class Listener:
    """Keep what comes on a topic."""

    def __init__(self, topic, kind, **options):
        self.messages = []
        self._changed = threading.Condition()
        self.topic = topic
        self._subscriber = rospy.Subscriber(topic, kind, self._came, **options)

    def _came(self, message):
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()

    def clear(self):
        with self._changed:
            self.messages = []

    def wait(self, accept=lambda message: True, what="a message", deadline=DEADLINE):
        """Wait for a message that is accepted; give the first such back."""
        end = time.monotonic() + deadline
        seen = 0
        with self._changed:
            while True:
                for message in self.messages[seen:]:
                    if accept(message):
                        return message
                seen = len(self.messages)
                left = end - time.monotonic()
                if left <= 0 or not self._changed.wait(left):
                    raise AssertionError(
                        f"waited {deadline} s in vain for {what} on {self.topic}; "
                        f"{seen} other messages came\n{self._connections()}"
                    )

    def _connections(self):
        """Tell who publishes, and what came from each node that is connected."""
        try:
            published = dict(rosgraph.Master("/test").getSystemState()[0])
            registered = published.get(rospy.resolve_name(self.topic), [])
            lines = [f"The master knows as publishers: {', '.join(registered)}"]
        except (OSError, rosgraph.MasterException) as error:
            lines = [f"The master does not answer: {error}"]
        for one in self._subscriber.impl.connections:
            rest = one.read_buff.tell() if one.read_buff else 0
            lines.append(
                f"{one.callerid_pub} at {one.endpoint_id}: {one.stat_num_msg} messages"
                f", {one.stat_bytes} bytes, {rest} of them wait"
            )
        return "\n".join(lines)

    def close(self):
        self._subscriber.unregister()


class Connected(Listener):
    """A listener that a publisher knows of: what it sends from now on comes."""

    def __init__(self, topic, kind, **options):
        super().__init__(topic, kind, **options)
        wait_for(self._subscriber.get_num_connections, f"a connection to {topic}")


class NodeLog(Listener):
    """Keep what a node logs, from now on without a gap."""

    def __init__(self, node):
        """Wait until the node's log is connected.

        Args:
            node: Its full name.
        """
        super().__init__("/rosout", Log)
        wait_for(lambda: self._is_heard(node), f"a connection to the log of {node}")

    @staticmethod
    def _is_heard(node):
        uri = uri_of(node)
        if uri is None:
            return False
        with ServerProxy(uri) as slave:
            rows = slave.getBusInfo("/test")[2]
        return any(
            row[1] == rospy.get_name() and row[4] == "/rosout" and row[5]
            for row in rows
        )


class Launch:
    """A launch file of this package, run in this master until it is stopped."""

    def __init__(self, file, *arguments):
        self._process = subprocess.Popen(
            ["roslaunch", "--wait", "g1_description", file, *arguments],
            start_new_session=True,
        )

    def stop(self):
        """Interrupt it as Ctrl-C would, and wait for its end."""
        self._process.send_signal(signal.SIGINT)
        self._process.wait(DEADLINE)

    def programs(self):
        """Give the names of the programs that run as its nodes."""
        command = ["ps", "-o", "comm=", "--ppid", str(self._process.pid)]
        return subprocess.run(command, stdout=subprocess.PIPE).stdout.decode().split()


def uri_of(node):
    """Give the address of a node's slave API, or None while it is not there."""
    try:
        return rosnode.get_api_uri(rosgraph.Master("/test"), node, skip_cache=True)
    except (OSError, rosnode.ROSNodeException):
        return None


def process_of(node):
    """Give the process id of a node, or None while it is not there."""
    uri = uri_of(node)
    try:
        return ServerProxy(uri).getPid("/test")[2] if uri else None
    except OSError:
        return None


def idle_seconds():
    """Give how long the machine's cores have been idle so far, all together, in [s]."""
    return float(Path("/proc/uptime").read_text().split()[1])


class Repeated:
    """Something done again and again in a thread, until it is closed."""

    def __init__(self, act, period):
        self._act, self._period = act, period
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        while not self._stopped.wait(self._period):
            self._act()

    def close(self):
        self._stopped.set()
        self._thread.join()


def step_by(seconds):
    """Let the simulator do few long steps, which a busy machine can follow.

    Time begins again, so that it is a whole number of such steps.
    """
    get = rospy.ServiceProxy("/gazebo/get_physics_properties", GetPhysicsProperties)
    get.wait_for_service(DEADLINE)
    change = rospy.ServiceProxy("/gazebo/set_physics_properties", SetPhysicsProperties)
    now = get()
    assert change(seconds, 1.0 / seconds, now.gravity, now.ode_config).success
    rospy.ServiceProxy("/gazebo/reset_simulation", Empty)()
