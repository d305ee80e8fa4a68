"""tools/mutate draws mutants that are what they say."""

import ast
import sys
from collections import Counter

import pytest
from conftest import REPOSITORY

sys.path.insert(0, str(REPOSITORY / "tools"))

from mutate import draw, find

CASES = {
    "x = a < b": "x = ((a) >= (b))",
    "x = (a) + b * c": "x = (a) + ((b) / (c))",
    "x = a and b": "x = ((a) or (b))",
    "x += y": "x -= (y)",
    "x = [a for a in b if f(a)]": "x = [a for a in b if (not (f(a)))]",
    "x = 0.0": "x = 1.0",
    "x = 84": "x = 168",
    "x = 'left_knee'": "x = 'left_kneex'",
    "x = -a": "x = (a)",
    "'é'; f(a)": "'é'; pass",
    "def f():\n    return é, g(a)": "def f():\n    return None",
}
LEFT_OUT = """__all__ = ["name"]
x: Level["name"]
def f(a: "name") -> Literal["name"]:
    self._log.warn("name", 1)
    raise E(f"{1 + 2}")
"""


@pytest.mark.parametrize("code", CASES)
def test_each_kind_changes_one_node(code):
    data = code.encode()
    assert CASES[code] in [mutant.apply(data).decode() for mutant in find("", data)]


def test_what_is_no_code_is_left_out():
    assert not [*find("", LEFT_OUT.encode())]


def test_a_seed_draws_lines_whose_changes_are_python():
    drawn = draw(REPOSITORY, 200, 1)
    assert len({(mutant.file, mutant.line) for mutant in drawn}) == 200
    assert draw(REPOSITORY, 200, 1) == drawn != draw(REPOSITORY, 200, 2)
    for mutant in drawn:
        ast.parse(mutant.apply((REPOSITORY / mutant.file).read_bytes()))


def test_pytest_can_run_all_folders_at_once():
    """Modules of tests have no packages, so their names are unique."""
    files = (REPOSITORY / "test").glob("*/test_*.py")
    names = Counter(file.name for file in files if file.parent.name != "rostest")
    assert [name for name, count in names.items() if count > 1] == []
