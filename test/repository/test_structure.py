"""tools/structure counts modules, names and circles from the source."""

import subprocess
import sys
from pathlib import Path

TOOL = Path(__file__).resolve().parents[2] / "tools" / "structure"
FILES = {
    "a/__init__.py": "",
    "a/one.py": "from g1_description.b import two\n\nclass Twice:\n    pass\n",
    "a/alone.py": "X = 1\n",
    "b/__init__.py": "",
    "b/two.py": 'from ..a.alone import X\n\ndef f():\n    """Doc."""\n    return X\n',
    "b/three.py": "from . import four\n\nclass Twice:\n    pass\n",
    "b/four.py": "import g1_description.b.three\n",
    "c.py": "import os\n",
}


def counted(root, *arguments):
    """Run it on a folder; return its rows by name."""
    command = [sys.executable, str(TOOL), "--root", str(root), *arguments]
    text = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout
    rows = (line.rsplit(None, 1) for line in text.splitlines()[1:])
    return {name.strip(): int(value) for name, value in rows}


def test_a_small_tree_is_counted(tmp_path):
    for name, text in FILES.items():
        file = tmp_path / "src" / "g1_description" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools" / "run").write_text("#!/bin/sh\ntrue\n")
    (tmp_path / "tools" / "table.json").write_text("{\n}\n")
    expected = {
        "modules": 6,
        "lines of a module, median": 2,
        "folders": 3,
        "classes": 2,
        "class names used twice": 1,
        "functions": 1,
        "lines of a function, median": 1,
        "modules with one importer": 4,
        "which is in the same folder": 2,
        "circles between packages": 1,
        "circles between folders": 1,
        "circles between modules": 1,
        "lines of src": 16,
        "lines of tools": 2,
        "lines of test": 0,
    }
    assert counted(tmp_path) == expected

    git = ["git", "-C", str(tmp_path), "-c", "user.name=t", "-c", "user.email=t@t"]
    (tmp_path / "test").mkdir()
    (tmp_path / "test" / "empty").write_text("")
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "All"]):
        subprocess.run([*git, *words], check=True)
    (tmp_path / "src" / "g1_description" / "c.py").unlink()
    assert counted(tmp_path, "HEAD") == expected
    assert counted(tmp_path)["modules"] == 5
