"""The rostests that run."""

from pathlib import Path
from xml.etree import ElementTree

FOLDER = Path(__file__).resolve().parents[1] / "rostest"


def test_each_rostest_file_runs_once():
    named = [
        name
        for file in FOLDER.glob("*.test")
        for test in ElementTree.parse(file).iter("test")
        for name in test.get("args").split()
    ]
    assert sorted(named) == sorted(file.name for file in FOLDER.glob("test_*.py"))
