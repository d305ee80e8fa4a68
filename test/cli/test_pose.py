"""The command line of pose: one sentence for each mistake."""

import os
import threading
from pathlib import Path
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest
from conftest import REPOSITORY
from forked import run_script

pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.cli.pose import PoseOptions, list_poses, main, save
from g1_description.command_line import parse
from g1_description.errors import PoseFileError


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "give one of NAME, --list and --save NAME"),
        (["squat", "--list"], "give one of NAME, --list and --save NAME"),
        (
            ["squat", "--seconds", "-1"],
            "--seconds: must be a number from 0 to 3600 (got -1)",
        ),
        (
            ["squat", "--seconds=-1"],
            "--seconds: must be a number from 0 to 3600 (got -1)",
        ),
        (["squat", "--seconds", "nan"], "must be a number (got 'nan')"),
        (["squat", "--force"], "--force and --about need --save"),
        (["squat", "--namespace", "a b"], "'a b' is not a valid ROS name"),
        (["--save", "zero"], "zero cannot be saved"),
        (["--save", "zero", "--force"], "zero cannot be saved"),
    ],
)
def test_a_wrong_command_line_ends_with_a_sentence(words, told, capsys):
    with pytest.raises(SystemExit) as ended:
        parse(PoseOptions, "pose", words)
    assert ended.value.code == 2
    output, errors = capsys.readouterr()
    assert told in errors
    assert (output, len(errors.splitlines())) == ("", 1)


@pytest.mark.parametrize("words", [["--file", "none.yaml"], ["--model", "none.urdf"]])
def test_a_file_that_cannot_be_read_is_no_fault_of_the_robot(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(parse(PoseOptions, "pose", ["--list", "--model", "g1_29dof", *words]))
    assert ended.value.code == 2
    assert "none." in capsys.readouterr().err


def test_a_pose_without_a_name_is_not_saved():
    with pytest.raises(PoseFileError, match="Invalid name: ''"):
        save(parse(PoseOptions, "pose", ["--save", ""]))


def test_poses_are_listed_with_what_they_are_or_where(tmp_path, capsys):
    file = tmp_path / "poses.yaml"
    file.write_text("low: {}\nleft_up:\n  about: an arm\nother: {l_hip: 0.5}\n")
    list_poses(parse(PoseOptions, "pose", ["--list", "--file", str(file)]))
    told = capsys.readouterr()
    lines = told.out.splitlines()
    width = max(len(line.split()[0]) for line in lines)
    assert f"{'left_up':{width}}  an arm" in lines
    assert f"{'low':{width}}  {file}" in lines
    assert lines[0].startswith("zero ")
    assert told.err == "pose: not of g1_29dof: other\n"


def test_poses_are_those_of_the_robot(tmp_path, capsys):
    file = tmp_path / "poses.yaml"
    file.write_text("low: {l_hip: 0.5}\n")
    five = REPOSITORY / "test" / "data" / "five_links.urdf"
    words = ["--list", "--file", str(file), "--model", str(five)]
    list_poses(parse(PoseOptions, "pose", words))
    told = capsys.readouterr()
    assert [line.split()[0] for line in told.out.splitlines()] == ["zero", "low"]
    assert told.err == ""


def test_a_namespace_may_be_written_as_in_a_launch_file():
    for text in ("left", "/left", "left/"):
        words = ["squat", "--namespace", text]
        assert parse(PoseOptions, "pose", words).namespace == "left"


class Dying(SimpleXMLRPCRequestHandler):
    """A master that hangs up when it is asked for a robot, or a node's parameters."""

    rpc_paths = ()
    own = b"<string>/spawn_urdf</string>"
    """A node's name, which is in each request; twice where it asks for all it has."""

    def decode_request_content(self, data):
        """Read a request, or end the connection without an answer."""
        is_for_all = b"getParam" in data and data.count(self.own) == 2
        if b"robot_description" not in data and not is_for_all:
            return super().decode_request_content(data)
        self.close_connection = True
        return None


class Answers:
    """What it says to all else."""

    def _dispatch(self, name, _):
        is_topic = name in ("registerSubscriber", "registerPublisher")
        return [1, "", [] if is_topic else 0]


@pytest.fixture
def dying_master():
    """Run a master that starts nodes and then dies; give its address."""
    server = SimpleXMLRPCServer(("localhost", 0), Dying, logRequests=False)
    server.register_instance(Answers())
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://localhost:{server.server_address[1]}"
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.mark.parametrize(
    ("script", "word"),
    [("pose", "squat"), ("play", "squat.csv"), ("record", "/tmp/none.csv")],
)
def test_without_a_master_it_is_told_what_to_start(script, word):
    environment = {**os.environ, "ROS_MASTER_URI": "http://localhost:9"}
    run = run_script(REPOSITORY / "scripts" / script, word, environment=environment)
    assert run.returncode == 1
    told = f"{script}: No ROS master at http://localhost:9; start a robot with"
    assert run.stderr.splitlines()[-1].startswith(told)


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("pose", ["squat"]),
        ("play", [str(REPOSITORY / "package.xml")]),
        ("spawn_robot.py", []),
        ("spawn_robot.py", ["_robot_description:=/robot"]),
    ],
)
def test_a_master_that_dies_is_told_in_a_sentence(script, words, dying_master):
    environment = {**os.environ, "ROS_MASTER_URI": dying_master}
    run = run_script(REPOSITORY / "scripts" / script, *words, environment=environment)
    assert run.returncode == 1
    name = Path(script).stem
    assert "Traceback" not in run.stderr
    assert run.stderr.splitlines()[-1].startswith(
        f"{name}: The ROS master does not answer: "
    )
