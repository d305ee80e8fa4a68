"""Names of motions, as users write them."""

from pathlib import Path

import pytest

from g1_description import Robot
from g1_description.errors import DescriptionError, MotionError
from g1_description.motion.paths import motion_path

MOTIONS = Path(__file__).resolve().parents[2] / "motions"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_motion_of_the_package_has_a_bare_name():
    assert motion_path("squat.csv").resolve() == MOTIONS / "squat.csv"
    assert Robot().read_motion("squat.csv").duration == 6.0


def test_a_file_of_the_working_folder_comes_first(folder):
    (folder / "squat.csv").touch()
    assert motion_path("squat.csv") == Path("squat.csv")
    assert motion_path("squat.csv#walk") == Path("squat.csv#walk")


@pytest.mark.parametrize("name", ["no.csv", "./no.csv", "a/squat.csv", "/squat.csv"])
def test_other_names_are_paths(name):
    assert motion_path(name) == Path(name)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("squt.csv", "squt.csv does not exist (did you mean squat.csv?)."),
        ("sqat", "sqat does not exist (did you mean squat.csv?)."),
        (
            "./to_left.npz",
            "to_left.npz does not exist (did you mean to_the_left.npz?).",
        ),
        ("no/squt.csv", "no/squt.csv does not exist."),
        ("x.csv", "x.csv does not exist."),
    ],
)
def test_a_missing_motion_is_told_with_similar_names(folder, name, told):
    for file in ("to_the_left.npz", "squt.md"):
        (folder / file).touch()
    with pytest.raises(MotionError) as error:
        Robot().read_motion(name)
    assert str(error.value) == told


def test_files_of_packages_and_of_the_home_are_found(monkeypatch):
    uri = "package://g1_description/motions/wave.csv"
    assert motion_path(uri).resolve() == MOTIONS / "wave.csv"
    monkeypatch.setenv("HOME", "/home/me")
    assert motion_path("~/walk.csv") == Path("/home/me/walk.csv")


def test_an_unknown_package_is_refused():
    with pytest.raises(DescriptionError, match="There is no package 'unknown'"):
        motion_path("package://unknown/walk.csv")
