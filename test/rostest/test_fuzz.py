"""Nothing from outside hurts the simulator: any request, any XML, any bytes."""

import os
import signal
import socket
import struct
import sys
import tempfile
import time
import unittest
from pathlib import Path
from urllib.parse import urlparse

import rosgraph
import rosnode
import rospy
from gazebo_msgs.msg import LinkState, ModelState
from support.bridge.arm import LINK as BODY
from support.examples import run_examples
from support.fuzz.requests import any_request, of_service
from support.fuzz.world import ROBOT, Observer
from support.fuzz.xml import SECRET, sdf_attacks, urdf_attacks
from support.ros_testing import DEADLINE, wait_for
from support.stand_in import Node

from tcpros import HangupError, ServiceError, header_of, packed

REQUESTS = int(os.environ.get("FUZZ_REQUESTS", "200"))
SEED = int(os.environ.get("FUZZ_SEED", "1"))
BATCH = 100
"""Requests between two times that the world is put in order."""
AT_ONCE = 3.0
"""Most processor time that an answer may take in [s]; a request of 1 MB took 1.2 on a
machine with more to do than cores."""
ROUNDS = 60
"""Times that the same requests are sent again, to see what memory they cost."""
GROWTH = 6e6
"""Most memory that they may cost in [bytes]; those that are refused have 12 MB."""


class TestFuzz(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.node = Node()
        cls.addClassCleanup(cls.node.kill)
        cls.services = cls.node.services
        cls.defaults = cls.services.call("get_physics_properties")
        cls.observer = Observer(cls.services)
        cls.cost = cls.cost_from_the_start()

    def setUp(self):
        self.observer.restore(self.defaults)

    def tearDown(self):
        trouble = self.node.trouble()
        self.assertEqual(trouble, [], f"{len(trouble)} lines")

    @classmethod
    def cost_from_the_start(cls):
        """Put the world in order, let the robot fall, and give what that costs."""
        cls.observer.restore(cls.defaults)
        cls.services.call("unpause_physics")
        return cls.node.cost()

    def send(self, service, body):
        """Send a request.

        Returns:
            Success, None where there is no such field, and processor time in [s].
        """
        connection = self.services[service]
        begin = self.node.seconds_of_processor()
        try:
            answer = connection.send(body)
        except (ServiceError, HangupError):
            return False, self.node.seconds_of_processor() - begin
        elapsed = self.node.seconds_of_processor() - begin
        self.assertNotIn(SECRET.encode(), answer)
        response = connection.kind._response_class().deserialize(answer)
        return getattr(response, "success", None), elapsed

    def test_1_any_request(self):
        self.counts, self.slowest = {True: 0, False: 0, None: 0}, (0,)
        self.asked = set()
        self.note()
        names = self.services.names
        classes = {name: self.services[name].request_class for name in names}
        begin = time.monotonic()
        run_examples(self.check, any_request(classes), REQUESTS, SEED)
        for name in sorted({*names} - self.asked):  # draws may leave one out
            run_examples(self.check, of_service(name, classes[name]), 1, SEED)
        elapsed = time.monotonic() - begin
        print(
            f"fuzz: seed {SEED}, {REQUESTS} requests in {elapsed:.0f} s: "
            f"{self.counts[False]} refused, {self.counts[True]} accepted, "
            f"{self.counts[None]} that cannot refuse, slowest {self.slowest}",
            file=sys.stderr,
        )
        self.assertEqual(self.asked, set(names))
        self.assertGreater(self.counts[False], REQUESTS // 5)
        self.assertGreater(self.counts[True], REQUESTS // 80)

    def note(self):
        """Remember what can be seen."""
        self.before = self.observer.look()
        self.full = self.observer.look(every_link=True)

    def check(self, request):
        """Send a request; what is refused changes nothing."""
        service, body = request
        success, elapsed = self.send(service, body)
        self.asked.add(service)
        self.counts[success] += 1
        self.slowest = max(self.slowest, (elapsed, service))
        count = sum(self.counts.values())
        told = f"{service} {body[:200]!r}, seed {SEED}, request {count}"
        self.assertTrue(self.node.is_alive(), told)
        self.assertLess(elapsed, AT_ONCE, told)
        if service == "unpause_physics":
            self.services.call("pause_physics")
        after = self.observer.look()
        if success is False:
            self.assertEqual(self.before, after, told)
        else:
            self.full = None
        self.before = after
        if count % BATCH == 0:
            if self.full is not None:
                self.assertEqual(self.full, self.observer.look(every_link=True))
            self.run_on()
            self.observer.restore(self.defaults)
            self.note()

    def run_on(self):
        """Let the world that was made run for a moment."""
        self.services.call("unpause_physics")
        self.services.call("get_world_properties")
        self.services.call("pause_physics")

    def spawn(self, service, name, xml):
        """Send a document to be spawned."""
        text = xml.encode("utf-8", "surrogatepass")
        fields = (packed(name.encode()), packed(text), packed(b""), bytes(56))
        return self.send(service, b"".join([*fields, packed(b"")]))

    def test_2_any_document(self):
        with tempfile.TemporaryDirectory() as folder:
            for service, attacks in (
                ("spawn_urdf_model", urdf_attacks(Path(folder))),
                ("spawn_sdf_model", sdf_attacks(folder)),
            ):
                for name, xml in attacks.items():
                    with self.subTest(f"{service}: {name}"):
                        self.attack(service, name, xml)

    def attack(self, service, name, xml):
        """Send a document; what is refused leaves no trace."""
        before = self.observer.look()
        success, elapsed = self.spawn(service, name, xml)
        self.assertTrue(self.node.is_alive(), self.node.output()[-2000:])
        if len(xml) < 100_000:
            self.assertLess(elapsed, AT_ONCE)
        if success:
            self.services.call("delete_model", name)
            self.services.call("delete_light", name)
        self.assertEqual(before, self.observer.look())
        self.assertEqual(self.node.trouble(), [])

    def test_3_any_bytes(self):
        place = self.services["get_world_properties"].place
        whole = header_of(
            service="/gazebo/get_world_properties",
            md5sum=self.services["get_world_properties"].kind._md5sum,
            callerid="/fuzz",
        )
        starts = {
            "nothing": b"",
            "noise": bytes(range(256)) * 10,
            "http": b"GET / HTTP/1.1\r\n\r\n",
            "half a handshake": whole[: len(whole) // 2],
            "a gigabyte": struct.pack("<I", 1 << 30) + b"x" * 100,
            "no fields": packed(b""),
            "no equal sign": packed(packed(b"nonsense")),
            "no text": packed(packed(b"\xff=\xff")),
            "a field of 4 GB": packed(struct.pack("<I", 2**32 - 1) + b"a=b"),
            "nobody's topic": header_of(
                topic="/nobody", md5sum="*", type="*", callerid="x"
            ),
            "nobody's service": header_of(service="/nobody", md5sum="*", callerid="x"),
            "no md5sum": header_of(service="/gazebo/step"),
            "a request of 4 GB": whole + struct.pack("<I", 2**32 - 1) + b"x" * 1000,
            "half a request": whole + struct.pack("<I", 100) + b"x" * 10,
            "too much": whole + packed(b"x" * 100),
        }
        uri = rosnode.get_api_uri(rosgraph.Master("/fuzz"), "/gazebo")
        api = urlparse(uri).hostname, urlparse(uri).port
        posted = (
            b"POST / HTTP/1.1\r\nContent-Type: text/xml\r\nContent-Length: %d\r\n\r\n"
        )
        posts = (b"\xff" * 50, b"<methodCall/>", b"<methodCall><methodName>getPid", b"")
        held = []
        for start in starts.values():
            for name, where in (("tcpros", place), ("xmlrpc", api)):
                sock = socket.create_connection(where, DEADLINE)
                sock.sendall(start)
                held.append((name, sock))
                self.is_served()
        for post in posts:
            for length in (len(post), 1 << 40, -1):
                sock = socket.create_connection(api, DEADLINE)
                sock.sendall(posted % length + post)
                held.append(("post", sock))
                self.is_served()
        for _ in range(200):
            held.append(("silent", socket.create_connection(place, DEADLINE)))
        self.is_served()
        for _, sock in held:
            sock.close()
        self.is_served()
        wait_for(lambda: self.node.threads() < 50, "the threads to end")

    def is_served(self):
        """Check that a new client is answered."""
        self.services["get_world_properties"].close()
        self.services.call("get_world_properties")

    def test_4_any_bytes_for_an_answer(self):
        """What is no request gets an error or the end of the connection, no silence."""
        for body in (b"", b"\xff" * 7, packed(b"\xff" * 9), b"\xff" * 100_000):
            for name in self.services.names:
                if name != "step" and self.services[name].request_class._slot_types:
                    with self.subTest(f"{name} {body[:20]!r}"):
                        self.send(name, body)

    def test_5_topics(self):
        for topic, kind, x in (("model", ModelState, 7.0), ("link", LinkState, 8.0)):
            publisher = rospy.Publisher(
                f"/gazebo/set_{topic}_state", kind, queue_size=1000
            )
            wait_for(publisher.get_num_connections, "the simulator to listen")
            for number in (float("nan"), float("inf"), 1e308, 1e10):
                for name in (ROBOT, f"{ROBOT}::pelvis", "", "n" * 100_000, "\n"):
                    state = kind()
                    setattr(state, f"{topic}_name", name)
                    state.pose.position.x = number
                    publisher.publish(state)
            state = kind()
            setattr(state, f"{topic}_name", {"model": ROBOT, "link": "pelvis"}[topic])
            state.pose.position.x = x
            publisher.publish(state)
            wait_for(lambda x=x: abs(self.robot_x() - x) < 0.5, f"{topic} at {x}")
            publisher.unregister()

    def robot_x(self):
        """Return where the robot is along x, in [m]."""
        return self.services.call("get_model_state", ROBOT, "").pose.position.x

    def test_6_requests_cost_neither_memory_nor_time_for_ever(self):
        garbage = "<robot>" + "x" * 200_000
        box = f'<robot name="box">{BODY.format("body")}</robot>'

        def send_all():
            self.assertFalse(self.spawn("spawn_urdf_model", "bad", garbage)[0])
            self.assertTrue(self.spawn("spawn_urdf_model", "box", box)[0])
            self.assertTrue(self.services.call("delete_model", "box").success)

        for _ in range(ROUNDS // 3):
            send_all()
        before = self.node.memory()
        for _ in range(ROUNDS):
            send_all()
        growth = self.node.memory() - before
        print(f"fuzz: {growth / 1e6:+.1f} MB in {ROUNDS} rounds", file=sys.stderr)
        self.assertLess(growth, GROWTH)
        wait_for(
            lambda: self.cost_from_the_start() < 2.0 * self.cost,
            "steps that cost what they did at first",
        )

    def test_7_it_still_ends_when_it_is_told_to(self):
        """Also while the time step is zero."""
        defaults = self.services.call("get_physics_properties")
        numbers = 0.0, 1e3, defaults.gravity, defaults.ode_config
        self.assertTrue(self.services.call("set_physics_properties", *numbers).success)
        self.node.end(signal.SIGINT)
        self.assertEqual(self.node.process.returncode, 0)
        self.assertEqual(self.node.trouble(), [])
