"""A fault of 0.2 s in five minutes, found on the page and sent as one file."""

from __future__ import annotations

import random
import re
import subprocess
import time
from collections import deque
from contextlib import closing
from pathlib import Path

import numpy as np
from sensor_msgs.msg import JointState

from .browser import HAS_ROBOT, SIZE, TIMEOUT, is_open
from .chromium import chromium
from .graph import Graph, MeasurementError, free_port, wait_for
from .html import FIRST, ROOT
from .peer import Peer, stamp_of
from tcpros import body_of, packed

SWUNG = "left_shoulder_pitch_joint", "left_elbow_joint"
FAULTY = {"right_shoulder_roll_joint": 0.4, "right_shoulder_yaw_joint": 0.8}
"""Where the right arm is in the torso, in [rad]."""
RATE, FAULT = 50, 0.2  # [Hz], [s]
PAST = re.compile(r"Past: ([\d.]+) s")


def rewind(bench):
    """The steps and times of a user who looks for what a planner did wrong.

    A planner sends joint_commands for five minutes, and the right arm into the torso
    for 0.2 s of them. Nobody has recorded that; the page is opened afterwards, in
    Chromium that draws in software.
    """
    seconds, port = bench.length(300.0, 30.0), free_port()
    with bench.attempt("rewinding"), chromium() as browser, Graph() as graph, closing(
        Peer()
    ) as peer:
        graph.launch(bench.model, "web:=true", f"port:={port}")
        graph.node("/link_states_bridge")
        wait_for(lambda: is_open(port), "the page")
        at = plan(peer, seconds)
        search(bench, graph, browser, f"http://127.0.0.1:{port}/", seconds, at)


def plan(peer, seconds):
    """Command the arms; give the simulated time of the fault in [s]."""
    topic = peer.advertise("/joint_commands", JointState)
    newest = deque(maxlen=1)
    peer.subscribe("/joint_states", JointState, lambda _, body: newest.append(body))
    peer.wait(lambda: topic.callers and newest, "the bridge")
    fault, at = random.uniform(0.3, 0.7) * seconds, None
    begin = time.monotonic()
    for number in range(round(seconds * RATE)):
        now = number / RATE
        goal = dict.fromkeys(FAULTY, 0.0)
        goal.update(zip(SWUNG, (0.3 * np.sin(now), 0.5 + 0.4 * np.sin(1.7 * now))))
        if fault <= now < fault + FAULT:
            goal.update(FAULTY)
            at = at or stamp_of(newest[-1])
        message = JointState(name=[*goal], position=[*goal.values()])
        topic.send(packed(body_of(message)))
        peer.serve(begin + (number + 1) / RATE)
    return at


def search(bench, graph, browser, address, seconds, at):
    """Find the fault, save it, check it, and open what is sent."""
    begin = time.monotonic()

    def step(name):
        nonlocal begin
        bench.add(name, time.monotonic() - begin, "s")
        begin = time.monotonic()

    page = browser.new_page(viewport=SIZE)
    page.set_default_timeout(1e3 * TIMEOUT)
    page.goto(address, wait_until="commit")
    page.wait_for_function(HAS_ROBOT, polling=100)
    step("1. open the page: the robot is seen")
    page.get_by_role("tab", name="History").click()
    page.get_by_label("Last seconds", exact=True).first.click()
    page.get_by_role("option", name="600" if seconds > 60 else "60", exact=True).click()
    page.get_by_role("button", name="Check this range").click()
    label = re.compile(r"self collision .*right_")
    button = page.get_by_role("button", name=label).first
    button.wait_for()
    step(f"2. check the last {seconds:g} s: the finding has a button")
    button.click()
    page.wait_for_function("document.body.innerText.includes('Past:')")
    shown = float(PAST.search(page.inner_text("body")).group(1))
    step("3. press it: the moment is shown")
    if not -0.1 < shown - at < FAULT + 0.1:
        raise MeasurementError(f"{shown} s is shown, the fault was at {at} s")
    page.get_by_label("Last seconds", exact=True).first.click()
    page.get_by_role("option", name="5", exact=True).click()
    page.get_by_role("button", name="Save this range").click()
    folder = Path(graph.folder, "g1_description", "motions")
    saved = wait_for(lambda: [*folder.glob("*.csv")], "the saved motion")[0]
    step("4. save five seconds")
    sent = saved.with_suffix(".html")
    check = [str(ROOT / "scripts" / "check"), saved, "--html", sent]
    subprocess.run(check, stdout=subprocess.DEVNULL, check=False, timeout=TIMEOUT)
    step("5. check --html: the file to send")
    bench.add("its size", sent.stat().st_size / 1e6, "MB")
    begin = time.monotonic()
    page.goto(sent.as_uri())
    page.evaluate(FIRST)
    cause = page.get_by_role("button", name=label).first
    cause.click()
    step("6. open it elsewhere, press the finding")
    page.close()
