#!/usr/bin/env python3
"""Several hosts: cables are pulled, hosts die, packets are lost, clocks differ."""

import sys
import time
import unittest

import numpy as np
import rostest
from support.machines.lab import Lab
from support.ros_testing import DEADLINE, wait_for

from hosts import HostsError

NORMAL = 0.15
"""Time in [s] by which states may be late: of a busy machine."""
SOON = 5.0
"""Longest time in [s] until all goes on. On a quiet machine it takes up to 1.2 s; TCP
by itself takes 5.6 s at least after the break of `LONG`."""
SHORT, LONG = 5.0, 7.0
"""How long cables are pulled, in [s]."""
BUSY_GAP = 3.0
"""Longest time in [s] between two states at somebody who has to do with nothing: less
than what cables are pulled for."""
RIGHT, WRONG, MISSING = (
    f"right_{name}_joint" for name in ("elbow", "knee", "hip_pitch")
)
"""Joints of planners that tell their address so."""
EARLIEST = 20.0
"""How long before the first state of interest the clock is looked at, in [s]."""
TINY = 1e-9  # makes a time of 0 true


class TestMachines(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        try:
            cls.machines = Lab()
        except HostsError as error:
            raise unittest.SkipTest(f"machines: {error}") from error
        try:
            cls.begin()
        except BaseException:
            cls.tearDownClass()
            raise

    @classmethod
    def tearDownClass(cls):
        for name in cls.machines.programs:  # rostest shows it of a test that failed
            print(f"--- {name}\n{cls.machines.output(name)}", file=sys.stderr)
        cls.machines.close()

    @classmethod
    def begin(cls):
        m = cls.machines
        m.start_stand_in()
        m.start_bridge()
        cls.planner = m.start_planner(m.three, "planner")
        cls.witness = m.start_planner(m.one, "witness", rate=0)
        cls.page = m.start_page()
        cls.clock = m.start_planner(m.one, "clock", "/clock")
        for told in (cls.clock, cls.planner, cls.witness, cls.page):
            wait_for(lambda told=told: len(told.records) > 100, "states and pictures")

    # --- what is measured -----------------------------------------------------

    def goes_on(self, told, begin):
        """Wait for a state that is not late; give the time since another in [s]."""

        def find():
            records = told.since(begin)
            normal = records and np.flatnonzero(self.lateness(records) < NORMAL)
            return len(normal) and records[normal[0]][0] - begin + TINY

        return wait_for(find, "states", DEADLINE)

    def lateness(self, records):
        """Give how long after their time, on the simulator's host, states came [s]."""
        arrivals, stamps, _ = np.array(records).T
        known, times, _ = np.array(self.clock.since(arrivals[0] - EARLIEST)).T
        return arrivals - np.interp(stamps, times, known)

    @staticmethod
    def is_obeyed(told, begin):
        """Wait until a command moved the joint; give the time since another in [s]."""

        def find():
            records = told.since(begin)
            moved = records and np.flatnonzero(np.diff([one[2] for one in records]) > 0)
            return len(moved) and records[moved[0] + 1][0] - begin + TINY

        return wait_for(find, "commands that are obeyed", DEADLINE)

    def check_that_all_goes_on(self, what, begin, told=None):
        """Check that all is as before soon after a time."""
        told = told or self.planner
        times = {
            "states": self.goes_on(told, begin),
            "at others": self.goes_on(self.witness, begin),
            "commands": self.is_obeyed(told, begin),
        }
        text = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in times.items())
        print(f"machines: after {what}: {text}", file=sys.stderr)
        self.assertLess(max(times.values()), SOON)
        self.check_order()

    def check_order(self):
        """Each state came once, in order; no old position came with a new stamp."""
        for told in (self.planner, self.witness):
            _, stamps, positions = np.array(told.records).T
            self.assertTrue((np.diff(stamps) > 0.0).all())
            self.assertTrue((np.diff(positions) >= -1e-9).all())

    def check_undisturbed(self, begin):
        """Check that somebody who has to do with nothing got all states in time."""
        arrivals, stamps, _ = np.array(self.witness.since(begin)).T
        self.assertLess(np.diff(stamps).max(), 0.011)
        self.assertLess(np.diff(arrivals).max(), BUSY_GAP)
        self.assertLess(time.monotonic() - arrivals[-1], BUSY_GAP)

    def pull(self, host, seconds):
        """Pull a cable and put it back; give when."""
        host.pull()
        begin = time.monotonic()
        wait_for(lambda: time.monotonic() > begin + seconds, "the time", 2 * seconds)
        host.plug()
        return time.monotonic()

    def check_alive(self):
        """All programs run, and have no trouble."""
        for name in ("gazebo", "bridge", "web"):
            self.assertIsNone(self.machines.programs[name].poll(), name)
            self.assertNotIn("Traceback", self.machines.output(name))

    # --- the tests ------------------------------------------------------------

    def test_the_cable_of_those_who_look_is_pulled(self):
        begin = time.monotonic()
        back = self.pull(self.machines.three, SHORT)
        wait_for(lambda: self.page.since(back), "pictures")
        self.check_that_all_goes_on(f"{SHORT:.0f} s without people", back)
        self.check_undisturbed(begin)
        self.check_alive()

    def test_the_cable_of_the_bridge_is_pulled(self):
        back = self.pull(self.machines.two, LONG)
        self.check_that_all_goes_on(f"{LONG:.0f} s without the bridge", back)
        wait_for(lambda: self.page.since(back), "pictures")
        self.check_alive()

    def test_a_fifth_of_the_packets_is_lost(self):
        host = self.machines.three
        begin = time.monotonic()
        try:
            host.lose(0.2)
        except HostsError as error:
            self.skipTest(f"the kernel loses no packets: {error}")
        self.addCleanup(host.lose, 0.0)
        wait_for(lambda: time.monotonic() > begin + 4.0, "the time")
        wait_for(lambda: len(self.planner.since(begin + 0.5)) > 35, "states")
        records = self.planner.since(begin + 0.5)
        late = self.lateness(records)
        host.lose(0.0)
        end = time.monotonic()
        print(
            f"machines: with a fifth lost: {len(records) / 3.5:.0f} Hz, "
            f"late by {np.median(late):.2f} s, at most {max(late):.2f} s",
            file=sys.stderr,
        )
        self.assertGreater(max(late), NORMAL)  # they are lost
        self.check_that_all_goes_on("lost packets", end)
        self.check_undisturbed(begin)

    def test_the_address_of_a_planner(self):
        """Who tells a wrong address hears, and is not heard; nobody else notices."""
        m = self.machines
        begin = time.monotonic()
        told = {
            name: m.start_planner(m.four, name, joint, **changes)
            for name, joint, changes in (
                ("wrong", WRONG, {"ROS_IP": "10.71.13.99"}),
                ("missing", MISSING, {"ROS_IP": None}),
                ("right", RIGHT, {}),
            )
        }
        for name in told:
            wait_for(lambda name=name: len(told[name].records) > 100, "states")
        self.is_obeyed(told["right"], begin)
        for name in ("wrong", "missing"):
            self.assertEqual({record[2] for record in told[name].records}, {0.0})
        m.four.kill()
        self.check_undisturbed(begin)
        self.check_alive()

    def test_z_the_host_of_the_bridge_dies_and_comes_back_with_another_clock(self):
        """The last one: it is another bridge then."""
        m = self.machines
        m.two.die()
        begin = time.monotonic()
        wait_for(lambda: time.monotonic() > begin + 2.0, "the time")
        m.two.plug()
        m.start_bridge(offset=-2.0)
        first = begin + self.goes_on(self.witness, begin)
        self.check_that_all_goes_on("the bridge's return", first)
        self.check_alive()


if __name__ == "__main__":
    rostest.rosrun("g1_description", "machines", TestMachines, sys.argv)
