"""tools/mutate draws mutants that are what they say."""

import ast
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))

from mutants import Finder, draw

CASES = {
    "x = a < b": "x = a >= b",
    "x = a is not b": "x = a is b",
    "x = (a) + (b)": "x = (a) - (b)",
    "x = a and b": "x = a or b",
    "x += y": "x -= y",
    "x = [a for a in b if f(a)]": "x = [a for a in b if (not (f(a)))]",
    "x = 0.0": "x = 1.0",
    "x = 3": "x = 4",
    "x = 84": "x = 168",
    "x = True": "x = False",
    "x = 'left_knee'": 'x = "left_kneex"',
    "x = -a": "x = (a)",
    "f(a)": "pass",
    "if a(b):\n    raise E('é' + 1)": "if a(b):\n    pass",
    "def f():\n    return é, g(a)": "def f():\n    return None",
    "self.x = a.b": "self.x = None",
}
LEFT_OUT = '''"""name"""
from __future__ import annotations
__all__ = ["name"]
if TYPE_CHECKING:
    f(1)
x: Level[1]
def f(a: "name") -> Literal["name"]:
    """name"""
    rospy.logwarn("name", 1)
    self._log.warn("name", 1)
    "name"
    return f"{1 + 2}"[:]
if __name__ == "__main__":
    f(1)
'''
LAST = "".join(f"{code}\n" for code in CASES)


def changed(code):
    """Give all mutants of a text."""
    data = code.encode()
    return [mutant.apply(data).decode() for mutant in Finder(data).found]


@pytest.mark.parametrize("code", CASES)
def test_each_kind_changes_one_node(code):
    assert CASES[code] in changed(code)
    for text in changed(code):
        ast.parse(text)
        assert text != code


def test_what_is_no_code_is_left_out():
    assert {m.kind for m in Finder(LEFT_OUT.encode()).found} == {"value"}


def test_a_mutant_knows_its_line_and_whether_an_import_runs_it():
    code = b"def f(a=1):\n    return (\n        a\n        + b\n    )\n"
    found = {m.kind: (m.line, m.statement, m.is_inside) for m in Finder(code).found}
    assert found["constant"] == (1, 1, False)
    assert found["operator"] == (4, 2, True)


def test_the_same_seed_draws_the_same_lines_whatever_else_changes(tmp_path):
    file = tmp_path / "src" / "package" / "module.py"
    file.parent.mkdir(parents=True)
    file.write_text(LAST)
    drawn = draw(tmp_path, 5, 1)
    assert len(drawn) == 5
    assert len({mutant.line for _, mutant in drawn}) == 5
    assert draw(tmp_path, 5, 1) == drawn
    assert draw(tmp_path, 5, 2) != drawn
    file.write_text(f"pass\n{LAST}")
    moved = draw(tmp_path, 5, 1)
    assert [m.line for _, m in moved] == [m.line + 1 for _, m in drawn]
