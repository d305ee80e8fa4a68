"""Names of the G1 are in its profile and its URDF, and the default robot in one place.

Tools that measure or draw the package's own robot, tests, pages and examples name them,
too. Orders of joints in motion/files are facts of other people's formats.
"""

import re

from conftest import REPOSITORY

from g1_description.choices import DEFAULT
from g1_description.robot.urdf import parse_urdf

G1S = [parse_urdf(file.read_text()) for file in (REPOSITORY / "urdf").glob("*.urdf")]
NAMES = {n for g1 in G1S for n in (*g1.link_names, *(j.name for j in g1.joints))}
FORMATS = REPOSITORY / "src" / "g1_description" / "motion" / "files"
FOLDERS = ("src", "launch", "scripts", "rviz", "cmake", "interfaces")


def texts(*folders):
    """Yield the files of some folders that are text, with their text."""
    for folder in folders:
        for file in sorted((REPOSITORY / folder).rglob("*")):
            if file.is_file() and file.suffix != ".pyc":
                yield file, file.read_text(encoding="utf-8")


def places(pattern, *folders):
    """List the places of a pattern as FILE: TEXT."""
    return [
        f"{file.relative_to(REPOSITORY)}: {found[0]}"
        for file, text in texts(*folders)
        for found in re.finditer(pattern, text)
        if FORMATS not in file.parents
    ]


def test_nothing_but_the_profile_names_a_joint_or_link_of_the_g1():
    assert places(rf"(?<![\w-])(?:{'|'.join(NAMES)})(?![\w-])", *FOLDERS) == []


def test_the_default_robot_is_named_in_one_place():
    found = places(rf'"[^"\n]*\b{DEFAULT}\b[^"\n]*"', *FOLDERS)
    assert found == [f'src/g1_description/choices.py: "{DEFAULT}"']
