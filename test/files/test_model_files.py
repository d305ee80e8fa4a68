"""The file that an include of SDF means."""

import os

import pytest

from g1_description.errors import DescriptionError, NoSuchModelError
from g1_description.files.model_files import find_model
from g1_description.files.uris import package_name
from g1_description.files.xml import decoded
from g1_description.gazebo import node as gazebo_node


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(tmp_path))
    folder = tmp_path / "my lamp"
    folder.mkdir()
    (folder / "model.sdf").write_text("model.sdf")
    return folder


def refusal(uri):
    with pytest.raises(NoSuchModelError) as caught:
        find_model(uri)
    return str(caught.value)


def write_config(folder, **files):
    sdfs = "".join(
        f'<sdf version="{name[1:].replace("_", ".")}">{file}</sdf>'.replace(
            ' version="none"', ""
        )
        for name, file in files.items()
    )
    text = f'\n<?xml version="1.0"?><model><name>lamp</name>{sdfs}</model>'
    (folder / "model.config").write_text(text)
    for file in files.values():
        (folder / file.strip()).write_text(file.strip())


def test_a_folder_without_a_config_has_a_model_sdf(folder):
    assert find_model("model://my lamp") == "model.sdf"
    assert find_model("model://my lamp/") == "model.sdf"
    assert refusal("model://nowhere") == (
        "There is no package 'nowhere', and no folder 'nowhere' below "
        f"GAZEBO_MODEL_PATH ({folder.parent}), ~/.gazebo/models and the folders that "
        "packages export."
    )
    (folder / "model.sdf").unlink()
    assert refusal("model://my lamp") == f"There is no file {folder}/model.sdf."


@pytest.mark.parametrize(
    ("files", "best"),
    [
        ({"v1_6": "lamp.sdf"}, "lamp.sdf"),
        ({"v1_6": " new.sdf ", "v1_4": "old.sdf"}, "new.sdf"),
        ({"v1_4": "old.sdf", "v1_6": "new.sdf"}, "new.sdf"),
        ({"v1_9": "known.sdf", "v1_10": "later.sdf"}, "known.sdf"),
        ({"v2_0": "later.sdf", "v1_5": "known.sdf"}, "known.sdf"),
        ({"v1_10": "later.sdf"}, "later.sdf"),
        ({"vnone": "first.sdf", "vx": "second.sdf"}, "first.sdf"),
    ],
)
def test_the_file_of_the_highest_known_version_is_read(folder, files, best):
    write_config(folder, **files)
    assert find_model("model://my lamp") == best


def test_a_folder_may_be_named_by_its_path(folder):
    write_config(folder, v1_6="lamp.sdf")
    for uri in (f"file://{folder}", str(folder), f"file://{folder}/lamp.sdf"):
        assert find_model(uri) == "lamp.sdf"
    assert find_model(f"file://{folder}".replace(" ", "%20")) == "lamp.sdf"
    assert find_model("model://my lamp/lamp.sdf") == "lamp.sdf"
    assert refusal(f"file://{folder}/x") == f"There is no file {folder}/x."
    for unknown in ("lamp.sdf", "http://host/lamp"):
        assert refusal(unknown).startswith("A model must be given as model://NAME, ")
    assert refusal("model://").startswith("There is no package ''")


def test_a_config_that_is_wrong_is_told(folder):
    config = folder / "model.config"
    for text, words in (
        ("<model>", "model.config is not XML"),
        ("<model/>", "names no SDF file"),
        ("<model><sdf/></model>", "names no SDF file"),
        ("<model><sdf>x.sdf</sdf></model>", "names x.sdf, which is not a file"),
    ):
        config.write_text(text)
        with pytest.raises(DescriptionError, match=words):
            find_model("model://my lamp")


def test_a_model_is_in_the_encoding_that_it_declares(folder):
    text = '<?xml version="1.0" encoding="ISO-8859-1"?><model><sdf>ü.sdf</sdf></model>'
    (folder / "model.config").write_bytes(text.encode("latin-1"))
    (folder / "ü.sdf").write_bytes(
        '<?xml version="1.0" encoding="cp1252"?>€'.encode("cp1252")
    )
    assert find_model("model://my lamp") == "€"
    for begin in (b"", b'<?xml version="1.0" encoding="us-ascii"?>'):
        (folder / "ü.sdf").write_bytes(begin + b"\xff")
        assert find_model("model://my lamp") == f"{begin.decode()}\ufffd"


@pytest.mark.parametrize("codec", ["idna", "unicode_escape", "punycode", "palmos"])
def test_what_is_an_encoding_of_python_alone_does_not_count(codec):
    text = f'<?xml version="1.0" encoding="{codec}"?><a>\\u0041.xn--9.'
    assert decoded(text.encode() + b"\xff", "replace") == f"{text}\ufffd"


def test_a_world_and_a_manifest_are_in_the_encoding_that_they_declare(tmp_path):
    begin = '<?xml version="1.0" encoding="ISO-8859-1"?>'
    world = f'{begin}<sdf version="1.7"><light name="ü"/></sdf>'.encode("latin-1")
    (tmp_path / "l.world").write_bytes(world)
    (light,) = gazebo_node._content(str(tmp_path / "l.world")).lights
    assert light.name == "ü"
    manifest = f"{begin}<package><name>p</name><author>ü</author></package>"
    (tmp_path / "package.xml").write_bytes(manifest.encode("latin-1"))
    assert package_name(tmp_path / "package.xml") == "p"


def test_what_no_model_can_be_is_not_read(folder):
    os.truncate(folder / "model.sdf", 100_000_000)
    with pytest.raises(DescriptionError, match="100 MB"):
        find_model("model://my lamp")
    with pytest.raises(DescriptionError, match="too long"):
        find_model("file:///" + "x" * 300)
