"""The stand-in reads gzserver's command line."""

import shlex

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.gazebo.programs import gzclient, gzserver


def refusal(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        gzserver.parse(shlex.split(arguments))
    assert end.value.code == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    return told


@pytest.mark.parametrize("engine", ["ode", "bullet", "dart", "simbody", "limp"])
def test_no_engine_of_gazebo_has_motors(engine):
    assert gzserver.parse(["-e", engine])[0]["physics"] == "limp"


@pytest.mark.parametrize("physics", ["kinematic", "hold"])
def test_the_physics_of_the_stand_in_are_engines_too(physics):
    assert gzserver.parse([f"--physics={physics}"])[0]["physics"] == physics


@pytest.mark.parametrize(
    ("line", "physics"),
    [("-e mujoco", "limp"), ("-e hold --engine mujoco", "hold")],
)
def test_mujoco_is_an_engine_too(line, physics):
    given, _ = gzserver.parse(line.split())
    assert (given["physics"], given["engine"]) == (physics, "mujoco")


def test_gazebo_falls_in_an_empty_world_unless_told_otherwise():
    assert gzserver.parse([]) == ({"physics": "limp", "world": ""}, [])


@pytest.mark.parametrize("flag", ["-u", "--pause"])
def test_it_starts_paused(flag):
    assert gzserver.parse([flag])[0]["paused"] is True


def test_what_means_nothing_is_named_once():
    line = """--lockstep -r --record_resources --minimal_comms -r -p log.gz --seed 3
        --record_encoding txt --record_path /tmp --record_period 0.1 --iters 5
        --record_filter * --initial_sim_time 2 -s a.so -s b.so --server-plugin c.so
        -o fast -g gui.so --gui-client-plugin d.so --verbose worlds/empty.world e f"""
    _, ignored = gzserver.parse(line.split())
    assert ignored == [
        *("--lockstep", "-r", "--record_resources", "--minimal_comms", "-p", "--seed"),
        *("--record_encoding", "--record_path", "--record_period", "--iters"),
        *("--record_filter", "--initial_sim_time", "-s", "--server-plugin", "-o", "-g"),
        *("--gui-client-plugin", "e", "f"),
    ]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--bogus", "--bogus"),
        ("-e magic", "'magic'"),
        ("-e", "expected one argument"),
        ("nowhere.world", "no world file nowhere.world in /"),
    ],
)
def test_a_mistake_is_told_in_one_sentence(arguments, words, capsys):
    assert words in refusal(arguments, capsys)


@pytest.mark.parametrize("name", ["", "worlds/empty.world"])
def test_the_empty_world_needs_no_file(name):
    assert gzserver.find_world(name) == ""


def test_a_world_is_found_here_before_the_resource_path(tmp_path, monkeypatch):
    here, resources = tmp_path / "here", tmp_path / "resources"
    for file in (here / "a.world", resources / "a.world", resources / "worlds/b.world"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    monkeypatch.chdir(here)
    monkeypatch.setenv("GAZEBO_RESOURCE_PATH", f"/nowhere:{resources}")
    assert gzserver.find_world("a.world") == str(here / "a.world")
    assert gzserver.find_world("worlds/b.world") == str(resources / "worlds/b.world")
    world = str(here / "a.world")
    assert gzserver.find_world(world) == world
    assert gzserver.parse(["-u", "a.world"])[0]["world"] == world


def test_the_sentence_names_the_resource_path(monkeypatch, capsys):
    monkeypatch.setenv("GAZEBO_RESOURCE_PATH", "/nowhere")
    assert "below GAZEBO_RESOURCE_PATH (/nowhere)" in refusal("b.world", capsys)


def test_the_client_takes_gzclients_arguments():
    line = "--verbose -g a.so --gui-client-plugin b.so"
    ignored = gzclient.parser().parse_args(line.split()).ignored
    assert ignored == ["-g", "--gui-client-plugin"]


def test_the_client_opens_rviz_with_the_robot():
    program, option, file = gzclient.rviz()
    assert (program, option) == ("rviz", "-d")
    assert file.endswith("/rviz/g1.rviz")
