"""Examples that need no master print what their page shows.

The others run in test/rostest/test_examples.py.
"""

from pathlib import Path

import pytest
from forked import run_script

pytest.importorskip("rospy", reason="rospy is not installed")

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.py"))
WITH_ROBOT = ("rospy", "Client")
"""What programs import that need a running robot."""


def needs_robot(path):
    text = path.read_text()
    return any(f"import {name}" in text for name in WITH_ROBOT)


ALONE = [path for path in EXAMPLES if not needs_robot(path)]


@pytest.mark.slow
@pytest.mark.parametrize("path", ALONE, ids=[path.stem for path in ALONE])
def test_an_example_prints_what_the_page_shows(path, tmp_path):
    run = run_script(path, folder=tmp_path)
    assert run.returncode == 0, run.stderr
    assert run.stdout == (path.parent / "output" / f"{path.stem}.txt").read_text()


def test_examples_are_short_and_each_has_an_output():
    assert len(EXAMPLES) >= 12
    for path in EXAMPLES:
        assert len(path.read_text().splitlines()) < 40, path.name
    outputs = {path.stem for path in EXAMPLES[0].parent.glob("output/*.txt")}
    assert outputs == {path.stem for path in EXAMPLES}
