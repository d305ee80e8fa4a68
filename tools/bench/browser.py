"""The browser view: how soon it shows a command, and what it costs.

The display runs with its usual 200 states per second, without RViz and with the browser
view; all of it shares the machine with the browsers. A process without rospy sends on
/joint_commands and reads /joint_states.

A command turns the left shoulder. It has been seen by a wire client, which speaks the
page's protocol and draws nothing, once that has read the message that moves the arm,
or the slider; and by Chromium when the page's own script has drawn a scene that differs
(a small copy of it is read back to tell) or has set its slider. How long the window
takes to bring that to a screen is not part of it. Chromium draws in software here, so
most of its time is drawing. The next command waits until the page is at rest.

Browsers are wire clients in a process of their own; one case has Chromium in place of
them. The robot stands, or is moved by 100 joint_commands per second for all joints.
Shares of a core are those of the processes, bytes those of the page's WebSocket after
it was opened. Latencies beside browsers run from just before a sample is sent until the
bytes of the joint_states that show it are read. Memory is resident memory of the node,
with five browsers and a robot that moves.

The first picture is timed from before a fresh Chromium opens the address until its
page has drawn a scene with nine tenths of the pixels that the robot has in the end.
"""

from __future__ import annotations

import time
from contextlib import closing

import numpy as np

from .bridge import EXACT
from .browser_display import ARM, Display
from .chromium import (
    Browser,
    WatchedPage,
    address_of,
    check_installed,
    first_pictures,
    pages_told,
    seen_in_page,
)
from .matching import match, positions_of
from .nodes import Graph, MeasurementError, idle
from .peer import Peer
from .start_up import measure_models
from .stream import no_collector
from .watchers import node_of
from page_client import PageClient

SIZE = (800, 600)  # [px]
FIRST_SIZE = (1280, 800)  # [px]
FOLDER = "Left arm"
COMMANDS = 200
COMMANDS_CHROMIUM = 100
SECONDS = 30.0
LONG = 600.0  # [s]
LOOK = 30.0  # [s] from one look at the memory to the next
BROWSERS = (0, 1, 5)
OPENINGS = 5
WARM_UP = 3.0  # [s]
SOON = 10.0  # [s] in which a command has been seen


def run(bench):
    """Measure first pictures, then a view of a live robot."""
    measure_models(bench, measure_first, "<= 8")
    with bench.attempt("a live robot"), Graph() as graph, closing(Peer()) as peer:
        display = Display(graph, bench, peer)
        with bench.attempt("commands, wire client"), pages_told():
            seen_by_client(bench, display)
        for name, case in (("at rest", rest), ("moving", moving)):
            for count in BROWSERS:
                words = f"robot {name}, {browsers(count)}"
                with bench.attempt(words):
                    case(bench, display, words, count)
        with bench.attempt("robot moving, 1 Chromium"), pages_told():
            beside_chromium(bench, display)
        with bench.attempt("commands, Chromium"), pages_told():
            seen_by_chromium(bench, display)
        with bench.attempt("robot moving for long, 5 browsers"):
            stay(bench, display)


def browsers(count):
    """Say how many."""
    return f"{count} browser" if count == 1 else f"{count} browsers"


def seen_by_client(bench, display):
    """Keep how soon a wire client sees commands."""
    scene, slider = [], []
    with PageClient(display.address) as page, no_collector():
        page.wait_until_whole()
        node = node_of(page, display.arm.child)
        uuid = page.element(ARM)["uuid"]
        for send, _ in display.arm_commands(bench.count(COMMANDS), bench.seed):
            begin = send()
            for name, times in ((node, scene), (uuid, slider)):
                page.wait_for(
                    lambda n=name, b=begin: page.times.get(n, 0.0) > b, name, SOON
                )
                times.append(page.times[name] - begin)
            display.peer.serve(time.monotonic() + 0.25)
    bench.add_latencies("command to wire client: scene", scene)
    bench.add_latencies("command to wire client: slider", slider)
    bench.add("command to wire client: commands", len(scene))


def seen_by_chromium(bench, display):
    """Keep how soon Chromium shows commands."""
    check_installed()
    count = bench.count(COMMANDS_CHROMIUM)
    commands = display.arm_commands(count, bench.seed)
    scene, slider = seen_in_page(bench, display.address, SIZE, (FOLDER, ARM), commands)
    bench.add_latencies("command to Chromium: scene", scene)
    bench.add_latencies("command to Chromium: slider", slider)
    bench.add("command to Chromium: commands", len(scene))


def rest(bench, display, words, count):
    """Keep what browsers cost while a robot stands."""
    seconds = bench.seconds(SECONDS)
    with display.watch(count) as watchers:
        display.peer.serve(time.monotonic() + WARM_UP)
        with Window(bench, display, words, watchers):
            display.peer.serve(time.monotonic() + seconds)


def moving(bench, display, words, count):
    """Keep what browsers cost while a robot moves, and what it feels of them."""
    seconds = bench.seconds(SECONDS, 5.0)
    with display.watch(count) as watchers, no_collector():
        display.move(WARM_UP)
        display.came.clear()
        with Window(bench, display, words, watchers) as window:
            positions, sent = display.move(seconds)
    latencies(bench, display, words, positions, sent)
    rate = len(display.came) / window.wall
    bench.add(f"{words}: joint_states", rate, "1/s", ">= 195")


class Window:
    """A time in which processes are measured."""

    def __init__(self, bench, display, words, watchers=None):
        """Prepare it."""
        self._bench, self._words, self._watchers = bench, words, watchers
        self._processes = display.processes

    def __enter__(self):
        """Begin."""
        self._begin, self._idle = time.monotonic(), idle()
        self._meters = {name: p.meter() for name, p in self._processes.items()}
        return self

    def __exit__(self, *_):
        """Keep the figures."""
        end, bench, words = time.monotonic(), self._bench, self._words
        self.wall = end - self._begin
        for name, meter in self._meters.items():
            cpu, wall = meter()
            bench.add(f"{words}: {name}'s share of a core", 100.0 * cpu / wall, "%")
        bench.say(f"{100.0 * self._idle():.0f} % of the machine were idle")
        if self._watchers is not None and self._watchers.count:
            n_bytes, moves = self._watchers.between(self._begin, end)
            bench.add(f"{words}: bytes to each", 1e-3 * n_bytes, "kB/s")
            bench.add(f"{words}: moves shown by each", moves, "1/s")


def latencies(bench, display, words, positions, sent):
    """Keep how soon joint states show what was sent."""
    told = positions_of([body for _, body in display.came], display.names)
    times = np.array([moment for moment, _ in display.came])
    is_new = np.any(np.diff(told, axis=0, prepend=np.inf) != 0.0, axis=1)
    rows = match(positions, told[is_new], EXACT)
    seen = times[is_new][rows >= 0] - sent[rows[rows >= 0]]
    if not len(seen):
        raise MeasurementError("no sample was seen")
    bench.add_latencies(f"{words}: joint_commands to joint_states", seen)


def stay(bench, display):
    """Watch memory, with browsers and a robot that moves."""
    seconds = bench.seconds(LONG, 60.0)
    look = min(LOOK, seconds / 6.0)
    view, words = display.processes["view"], "5 browsers for long"
    memory = []
    with display.watch(5) as watchers, Window(bench, display, words, watchers):
        for _ in range(round(seconds / look) + 1):
            memory.append(view.memory())
            bench.say(f"view's memory {memory[-1]:.1f} MB")
            if len(memory) <= round(seconds / look):
                display.came.clear()
                display.move(look)
    half = len(memory) // 2
    bench.add(f"{words}: time", seconds, "s")
    bench.add(f"{words}: view's memory at the beginning", memory[0], "MB")
    bench.add(f"{words}: view's memory after half", memory[half], "MB")
    bench.add(f"{words}: view's memory at the end", memory[-1], "MB")
    grown = max(memory[half:]) - memory[half]
    bench.add(f"{words}: growth in the second half", grown, "MB", "< 2")


def beside_chromium(bench, display):
    """Keep what Chromium costs beside a robot that moves."""
    check_installed()
    words = "robot moving, 1 Chromium"
    with Browser() as browser:
        WatchedPage(browser, display.address, SIZE)
        display.move(WARM_UP)
        display.came.clear()
        with Window(bench, display, words) as window:
            positions, sent = display.move(bench.seconds(SECONDS, 5.0))
    latencies(bench, display, words, positions, sent)
    bench.add(f"{words}: joint_states", len(display.came) / window.wall, "1/s")


def measure_first(bench, name, model, target="<= 3"):
    """Time first pictures of one model."""
    runs = bench.count(OPENINGS, 2)
    command = ("rosrun", "g1_description", "web", "--model", model, "--port", 0)
    words = f"first picture of {name}"
    with bench.attempt(words), Graph() as graph, pages_told():
        check_installed()
        address, share = address_of(graph.start(command)), idle()
        times = first_pictures(address, FIRST_SIZE, runs)
        bench.say(", ".join(f"{t:.2f} s" for t in times))
        bench.say(f"{100.0 * share():.0f} % of the machine were idle")
        bench.add(f"{words}: median of {runs}", np.median(times), "s", target)
        bench.add(f"{words}: slowest", max(times), "s")
