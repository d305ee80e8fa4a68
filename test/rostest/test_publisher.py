"""States go to all who listen, at once, and nobody who does not read stops them."""

import subprocess
import sys
import threading
import unittest

import rospy
from std_msgs.msg import String
from support.ros_testing import DEADLINE, Listener, wait_for
from support.wire.raw_subscriber import RawSubscriber, own_uri

from g1_description.ros.publisher import DirectPublisher

from tcpros import HangupError, body_of

MANY = 5_000
LONG = "x" * 4000
BUFFER = 1 << 16
SHARED = 300


def text(number, padding=""):
    return String(f"{number:08d}{padding}")


def number_of(data):
    return int(data[4:12])


class TestPublisher(unittest.TestCase):
    topics = 0

    def setUp(self):
        TestPublisher.topics += 1
        self.topic = f"/direct_{self.topics}"
        self.publisher = DirectPublisher(self.topic, String, 10)
        self.subscribers = []

    def tearDown(self):
        for subscriber in self.subscribers:
            subscriber.close()

    def subscribe(self, name, **options):
        before = self.publisher.get_num_connections()
        subscriber = RawSubscriber(own_uri(), self.topic, String, name, **options)
        self.subscribers.append(subscriber)
        wait_for(
            lambda: self.publisher.get_num_connections() > before, f"{name} to connect"
        )
        self.arrive(subscriber)
        return subscriber

    def arrive(self, subscriber, publisher=None):
        """Publish until the subscriber gets something: it is taken up then."""
        publisher, mark = publisher or self.publisher, text(99_999_999)
        wait_for(
            lambda: publisher.publish(mark) or subscriber.has_data(0.05),
            "the first message",
        )
        self.assertEqual(number_of(subscriber.read()), 99_999_999)

    def test_every_subscriber_gets_every_message_in_order(self):
        readers = [self.subscribe(f"/reader_{n}") for n in range(3)]
        for number in range(100):
            self.publisher.publish(text(number))
        for reader in readers:
            data = reader.read_until(lambda data: number_of(data) == 99)
            got = [number for number in map(number_of, data) if number < MANY]
            self.assertEqual(got, list(range(100)))

    def test_who_does_not_read_stops_nobody_and_gets_the_newest_in_the_end(self):
        reader = self.subscribe("/reader")
        sleeper = self.subscribe("/sleeper", buffer=BUFFER)
        for number in range(MANY):
            self.publisher.publish(text(number, LONG))
            self.assertEqual(number_of(self.next_of(reader)), number)
        got = [number_of(sleeper.read()) for _ in range(10)]
        last = text(MANY)
        self.publisher.publish(last)
        while got[-1] != MANY:
            self.publisher.flush()
            got.append(number_of(sleeper.read()))
        got = [number for number in got if number <= MANY]
        self.assertEqual(got, sorted(set(got)))
        self.assertLess(len(got), MANY)
        self.assertEqual(got[-10:], list(range(MANY - 9, MANY + 1)))

    def next_of(self, reader):
        data = reader.read()
        while number_of(data) == 99_999_999:
            data = reader.read()
        return data

    def test_who_leaves_a_long_message_half_taken_is_let_go(self):
        reader = self.subscribe("/reader")
        sleeper = self.subscribe("/sleeper", buffer=BUFFER)
        got = []
        thread = threading.Thread(
            target=lambda: got.extend(self.next_of(reader)[:12] for _ in range(3))
        )
        thread.start()
        for number in range(3):
            self.publisher.publish(text(number, "x" * 20_000_000))
        # A reader without room for the last one gets it later.
        wait_for(lambda: self.publisher.flush() or len(got) == 3, "the last message")
        self.assertEqual([number_of(data) for data in got], [0, 1, 2])
        with self.assertRaises(HangupError):
            sleeper.read_until(lambda data: False)

    def test_who_leaves_is_forgotten_and_may_come_back(self):
        stays, leaves = self.subscribe("/stays"), self.subscribe("/leaves")
        leaves.close()
        for number in range(50):
            self.publisher.publish(text(number))
            self.assertEqual(number_of(self.next_of(stays)), number)
        wait_for(
            lambda: self.publisher.get_num_connections() == 1, "it to be forgotten"
        )
        again = self.subscribe("/leaves")
        self.publisher.publish(text(77))
        self.assertEqual(number_of(self.next_of(again)), 77)
        self.assertEqual(number_of(self.next_of(stays)), 77)

    def test_a_node_that_listens_to_itself_gets_some_and_the_last(self):
        own = Listener(self.topic, String)
        wait_for(self.publisher.get_num_connections, "itself")
        wait_for(lambda: self.publisher.publish(text(0)) or own.messages, "a message")
        for number in range(1, 96):
            self.publisher.publish(text(number))
        self.publisher.flush()
        own.wait(lambda message: message.data == "00000095", "the last message")
        self.assertLess(len(own.messages), 60)
        own.close()

    def test_another_publisher_of_the_topic_in_this_node_does_not_mix_in(self):
        """Such as tf2's broadcaster, which any part of a node may have."""
        for first in (True, False):  # whether it is there before us
            with self.subTest(first=first):
                self.publish_from_two_threads(f"{self.topic}_shared_{first}", first)

    def publish_from_two_threads(self, topic, first):
        makers = [
            lambda: rospy.Publisher(topic, String, queue_size=2 * SHARED),
            lambda: DirectPublisher(topic, String, 2 * SHARED),
        ]
        publishers = [make() for make in makers[:: 1 if first else -1]]
        own = publishers[1 if first else 0]
        reader = RawSubscriber(own_uri(), topic, String, "/reader")
        self.subscribers.append(reader)
        self.arrive(reader, own)
        messages = text(1, "x" * 300), text(2, "x" * 5000)
        bodies = [body_of(message) for message in messages]
        self.addCleanup(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(1e-6)  # threads take turns often
        threads = [
            threading.Thread(
                target=lambda publisher=publisher, message=message: [
                    publisher.publish(message) for _ in range(SHARED)
                ]
            )
            for publisher, message in zip(publishers, messages)
        ]
        for thread in threads:
            thread.start()
        for _ in range(2 * SHARED):
            self.assertIn(self.next_of(reader), bodies)
        for thread in threads:
            thread.join(DEADLINE)

    def test_a_subscriber_is_served_during_a_slow_handshake(self):
        """On a busy machine it takes seconds; here another listener does."""
        topic, go = f"{self.topic}_slow", threading.Event()
        self.addCleanup(go.set)

        class Slow(rospy.SubscribeListener):
            def peer_subscribe(self, *_):
                go.wait(DEADLINE)

        rospy.Publisher(topic, String, Slow(), queue_size=1)
        publisher = DirectPublisher(topic, String, 10)
        reader = RawSubscriber(own_uri(), topic, String, "/reader")
        self.subscribers.append(reader)
        wait_for(publisher.get_num_connections, "the reader to connect")
        self.arrive(reader, publisher)

    def test_who_waited_for_the_publisher_is_served(self):
        """Such are taken up before anybody can tell how to reach them."""
        for number in range(2):
            topic = f"/awaited_{number}"
            waiting = subprocess.Popen([sys.executable, "-c", WAITING, topic])
            wait_for(lambda topic=topic: is_awaited(topic), "the subscriber")
            publisher = DirectPublisher(topic, String, 10)
            wait_for(
                lambda publisher=publisher, waiting=waiting: (
                    publisher.publish(text(1)) or waiting.poll() is not None
                ),
                "the subscriber to get a message",
            )
            self.assertEqual(waiting.returncode, 0)


WAITING = """
import sys
import rospy
from std_msgs.msg import String
rospy.init_node("waiting", anonymous=True)
rospy.wait_for_message(sys.argv[1], String)
"""


def is_awaited(topic):
    """Tell whether the master knows a subscriber."""
    subscribers = rospy.get_master().getSystemState()[2][1]
    return any(name == topic for name, _ in subscribers)
