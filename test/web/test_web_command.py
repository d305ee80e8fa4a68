"""The command web: how it begins, what it refuses, and how it ends."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
from urllib.request import urlopen

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")
pytest.importorskip("viser", reason="viser is not installed")

from conftest import REPOSITORY
from waiting import DEADLINE

from g1_description.cli import web
from g1_description.cli.web import WebOptions
from g1_description.command_line import parse
from g1_description.motion.selection import Choice, Selection

sys.path.insert(0, str(REPOSITORY / "tools"))
from page_client import PageClient

pytestmark = pytest.mark.slow

DATA = REPOSITORY / "test" / "data"
ROBOT = str(DATA / "revolute.urdf")
ARM = (
    '<robot name="arm"><link name="pelvis"/><link name="forearm"/>'
    '<joint name="left_elbow_joint" type="continuous"><parent link="pelvis"/>'
    '<child link="forearm"/></joint></robot>'
)
"""A robot that the motion is for."""


def command(*arguments, path=None, **options):
    """Start the command; whoever runs the tests may ignore signals, as nohup does."""

    def answer_signals():
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGHUP, signal.SIG_DFL)

    places = [path, REPOSITORY / "src", os.environ.get("PYTHONPATH")]
    return subprocess.Popen(
        [sys.executable, str(REPOSITORY / "scripts" / "web"), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": ":".join(str(p) for p in places if p)},
        **{"stdout": subprocess.PIPE, **options},
        stderr=subprocess.PIPE,
        universal_newlines=True,
        preexec_fn=answer_signals,
    )


@contextlib.contextmanager
def opened(*arguments):
    """Start the command, and give it and its address once it has told that."""
    with command(*arguments) as process:
        try:
            line = process.stdout.readline() or process.stderr.read()
            yield process, re.search(r"^web: open (http://\S+)$", line).group(1)
        finally:
            process.kill()


@pytest.fixture
def refused(monkeypatch, capsys):
    """Give what runs the command in this process where it is refused: the sentence."""
    # They would stay changed in this process.
    monkeypatch.setattr(web.signal, "signal", lambda *_: None)
    monkeypatch.setattr(web.logging, "basicConfig", lambda **_: None)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["web", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            web.main()
        output, errors = capsys.readouterr()
        assert output == ""
        assert end.value.code == 2
        (line,) = errors.splitlines()
        assert line.startswith("web: ")
        return line

    return run


GREEDY = """
import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
except:
    pass
raise ModuleNotFoundError("No module named 'trimesh'", name="trimesh")
"""
"""A module that catches everything while it is imported, as some of scipy's do."""


def test_an_interrupt_of_its_imports_is_not_lost(tmp_path):
    (tmp_path / "trimesh.py").write_text(GREEDY)
    with command("--model", ROBOT, "--port", 0, path=tmp_path) as process:
        output, errors = process.communicate(timeout=DEADLINE)
    assert (process.returncode, output, errors) == (0, "", "")


def test_a_port_that_is_taken_is_told(refused):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        line = refused("--model", ROBOT, "--port", port)
    assert f"port {port}" in line
    assert "is in use" in line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--motion", "none.csv"], "none.csv"),
        (["--motion", DATA / "elbow.csv", "--model", ROBOT], "left_elbow_joint"),
        (["--model", "none.urdf"], "none.urdf"),
        (["none.csv", "--model", ROBOT], "none.csv does not exist"),
        ([DATA / "elbow.csv", "--model", ROBOT], "left_elbow_joint"),
        (["--port", "70000"], "must be a whole number from 0 to 65535"),
        (["--thresholds", DATA / "elbow.csv", "--model", ROBOT], "elbow.csv"),
        (["--host", "no.host.invalid", "--model", ROBOT], "'no.host.invalid'"),
        (["--colour"], "--colour"),
    ],
)
def test_what_it_cannot_show_is_refused_in_a_sentence(refused, arguments, words):
    assert words in refused("--port", 0, *arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--compare", "one.csv"], "--compare"),
        (["--motion", "a.csv", "--compare", "a.csv", "b.csv"], "cannot be combined"),
        ([".", "--read-only"], "a folder cannot be combined with --read-only"),
        (["a.csv", "--motion", "b.csv"], "FILE cannot be combined with --motion"),
        (["--report", "a.csv"], "--report and --selection need a folder as FILE"),
        (["--fps", "0"], "--fps: must be greater than 0"),
        (["--port", "http"], "--port"),
    ],
)
def test_wrong_options_are_told(arguments, words, capsys):
    with pytest.raises(SystemExit) as end:
        parse(WebOptions, "web", arguments)
    assert end.value.code == 2
    assert words in capsys.readouterr().err


def test_it_shows_until_ctrl_c_also_while_somebody_looks_and_begins_again(tmp_path):
    robot, motion = tmp_path / "arm.urdf", DATA / "elbow.csv"
    robot.write_text(ARM)
    arguments = motion, "--model", robot, "--port", 0, "--read-only"
    with opened(*arguments) as (process, address), PageClient(address) as client:
        client.wait_until_whole()
        with urlopen(address, timeout=DEADLINE) as page:
            assert page.status == 200
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=DEADLINE)
        assert (process.returncode, output, errors) == (0, "", "")
        client.wait_for(lambda: client.has_ended, "the end")
    port = address.rstrip("/").rpartition(":")[2]
    arguments = "--model", robot, "--compare", motion, motion, "--port", port
    with opened(*arguments) as (process, again), PageClient(again) as client:
        assert again == address
        client.wait_until_whole()
        check_comparison(client.nodes)
        groups = [e.get("_tab_labels", ()) for e in client.elements.values()]
        (tabs,) = [labels for labels in groups if "View" in labels]
        assert tabs[0] == "Motion" and len(tabs) == 6
        process.send_signal(signal.SIGTERM)
        output, errors = process.communicate(timeout=DEADLINE)
        assert (process.returncode, output, errors) == (0, "", "")


def test_a_folder_is_looked_through(tmp_path):
    robot, motions = tmp_path / "arm.urdf", tmp_path / "motions"
    robot.write_text(ARM)
    motions.mkdir()
    for name in ("a.csv", "b.csv", "c.csv"):
        (motions / name).write_bytes((DATA / "elbow.csv").read_bytes())
    (motions / "d.csv").write_text("time,left_elbow_joint\n0,x\n")
    given = motions, "--model", robot, "--port", 0
    with opened(*given) as (_, address), PageClient(address) as client:
        client.wait_until_whole()
        client.wait_for(lambda: client.says("a.csv: undecided"), "it")
        client.set("Motion", "Next")
        client.wait_for(lambda: client.says("b.csv: undecided"), "it")
        client.set("Choice", "Exclude")
        client.wait_for(lambda: client.says("b.csv: exclude"), "it")
        client.set("Open row", "3")
        client.wait_for(lambda: client.says("c.csv: undecided"), "it")
        client.set("Note", "smooth")
        client.set("Motion", "Previous")
        client.wait_for(lambda: client.says("b.csv: exclude"), "it")
        client.set("Sort by", "samples")
        client.set("Chosen", "exclude")
        client.wait_for(lambda: client.says("1 of 4 motions"), "it")
    assert Selection(motions / "selection.yaml").choices == {
        "b.csv": Choice("exclude"),
        "c.csv": Choice("undecided", "smooth"),
    }


def check_comparison(nodes):
    """Check that there are two robots with their names, one above the other."""
    robots = {
        name.split("/")[3]
        for name in nodes
        if name.startswith("/map/robots/") and name.endswith("/pelvis")
    }
    assert len(robots) == 2
    tags = [node for name, node in nodes.items() if name.endswith("/tag")]
    assert {tag["text"] for tag in tags} == {"elbow.csv 1", "elbow.csv 2"}
    assert len({tag["position"][2] for tag in tags}) == 2
