"""What spawn_model makes of its arguments, and where it finds the model."""

import shlex
from types import SimpleNamespace

import pytest

pytest.importorskip("gazebo_msgs", reason="no workspace is sourced")

from g1_description.errors import DescriptionError
from g1_description.gazebo.programs import spawn_model

WANTED = "-urdf -file f -model m"


def parsed(arguments):
    return spawn_model.parse(shlex.split(arguments))


def test_position_and_rotation_are_zero_unless_given():
    asked = parsed(WANTED)
    assert [getattr(asked, name) for name in "xyzRPY"] == [0.0] * 6
    asked = parsed(f"{WANTED} -x 1 -y -2 -z -.5 -R -1e-3 -P 4 -Y 1e-2")
    assert [getattr(asked, name) for name in "xyzRPY"] == [1, -2, -0.5, -1e-3, 4, 1e-2]


def test_joints_are_collected():
    assert parsed(WANTED).joints == {}
    assert parsed(f"{WANTED} -J a 1 -J b -2e-3").joints == {"a": 1.0, "b": -2e-3}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("-urdf -file f", "required: -model"),
        ("-urdf -model m", "-file -param -database -stdin is required"),
        ("-file f -model m", "-urdf -sdf is required"),
        ("-urdf -sdf -file f -model m", "not allowed with argument -urdf"),
        ("-urdf -file f -param p -model m", "not allowed with argument -file"),
        (f"{WANTED} -x wide", "argument -x: must be a number (got 'wide')"),
        (f"{WANTED} -x nan", "argument -x: must be a number (got 'nan')"),
        (f"{WANTED} -J a bent", "argument -J: must be a number (got 'bent')"),
        (f"{WANTED} -J a", "argument -J: expected 2 arguments"),
        (f"{WANTED} -namespace n", "unrecognized arguments: -namespace n"),
    ],
)
def test_a_mistake_is_told_in_one_sentence(arguments, words, capsys):
    with pytest.raises(SystemExit) as end:
        parsed(arguments)
    assert end.value.code == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1


def source(**given):
    nothing = dict.fromkeys(("file", "param", "database", "stdin"))
    return SimpleNamespace(**{**nothing, "package_to_model": False, **given})


def test_a_file_is_sent_as_it_is(tmp_path):
    file = tmp_path / "robot.urdf"
    text = '<?xml version="1.0" encoding="UTF-8"?>\n<robot><!-- ü --></robot>\n'
    file.write_text(text, encoding="utf-8")
    assert spawn_model.read_text(source(file=str(file))) == text


def test_a_file_in_another_encoding_is_sent_without_its_declaration(tmp_path):
    file = tmp_path / "robot.urdf"
    text = '<?xml version="1.0" encoding="ISO-8859-1"?><robot name="ü"/>'
    file.write_bytes(text.encode("latin-1"))
    assert spawn_model.read_text(source(file=str(file))) == '<robot name="ü"/>'


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty or missing"),
        (b"hello", "is not XML: Start tag expected"),
        (b"\xff", "is not text"),
    ],
)
def test_a_useless_file_is_named(content, words, tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_bytes(content)
    with pytest.raises(DescriptionError, match=words):
        spawn_model.read_text(source(file=str(file)))


@pytest.mark.parametrize(
    ("name", "words"), [("none", "No such file"), ("", "Is a dir")]
)
def test_a_file_that_is_none_is_named(name, words, tmp_path):
    with pytest.raises(DescriptionError, match=f"{tmp_path}.*{words}"):
        spawn_model.read_text(source(file=f"{tmp_path}/{name}"))


def test_the_database_is_the_model_path(tmp_path, monkeypatch):
    file = tmp_path / "box" / "model.sdf"
    file.parent.mkdir()
    file.write_text("<sdf/>")
    monkeypatch.setenv("GAZEBO_MODEL_PATH", f"/nowhere:{tmp_path}")
    assert spawn_model.read_text(source(database="box")) == "<sdf/>"
    with pytest.raises(DescriptionError, match=r"ball/model\.sdf below GAZEBO_MODEL"):
        spawn_model.read_text(source(database="ball"))


def test_packages_become_models_in_meshes_alone():
    text = """<robot><!-- package://a -->
        <mesh scale="1 1 1" filename="package://a/b.stl"/>
        <mesh filename='package://a/c.stl'/><texture filename="package://a/d.png"/>
    </robot>"""
    assert spawn_model.package_to_model(text) == text.replace(
        '"package://a/b', '"model://a/b'
    ).replace("'package", "'model")
