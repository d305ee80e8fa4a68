"""The code calls what Python 3.8, numpy 1.17 and scipy 1.3 have, Ubuntu 20.04's.

Those are rarely where the tests run; test/data/old_names.json tells what they offer.
"""

import importlib.util
import json
import warnings

import pytest
from conftest import REPOSITORY
from old_names import Names, Reader

FOLDERS = ("examples", "interfaces", "scripts", "src", "test", "tools")


def load_inventory():
    """Load the tool that lists libraries."""
    path = REPOSITORY / "tools" / "inventory.py"
    spec = importlib.util.spec_from_file_location("inventory", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def names():
    old = json.loads((REPOSITORY / "test" / "data" / "old_names.json").read_text())
    assert old.pop("versions") == {"numpy": "1.17.4", "scipy": "1.3.3", "python": "3.8"}
    inventory = load_inventory()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it touches what is deprecated
        return Names(old, inventory.inventory(inventory.modules()))


def programs():
    """Give all files of Python, with those whose first line says so."""
    for folder in FOLDERS:
        for path in sorted((REPOSITORY / folder).rglob("*")):
            if path.suffix == ".py":
                yield path, path.read_text(encoding="utf-8")
            elif not path.suffix and path.is_file() and path.stat().st_size < 100_000:
                text = path.read_text(encoding="utf-8", errors="replace")
                if text.startswith("#!") and "python" in text.splitlines()[0]:
                    yield path, text


@pytest.mark.slow
def test_all_code_calls_what_the_oldest_versions_have(names):
    found = {
        str(path.relative_to(REPOSITORY)): lines
        for path, text in programs()
        for lines in [Reader(names).read(text)]
        if lines
    }
    assert found == {}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("import numpy as np\nnp.linalg.norm(a, axis=1)", None),
        ("import numpy as np\nnp.broadcast_shapes(a)", "numpy has no broadcast_shapes"),
        ("import numpy.typing", "numpy has no typing"),
        (
            "from numpy.lib.stride_tricks import sliding_window_view",
            "has no sliding_wi",
        ),
        ("import numpy as np\nnp.mean(a, where=b)", "numpy.mean takes no where"),
        ("import numpy as np\nnp.concatenate(a, axis=0, dtype=int)", "takes no dtype"),
        ("from numpy import linalg\nlinalg.cholesky(a, upper=True)", "takes no upper"),
        ("from scipy.spatial.transform import Rotation\na = Rotation", None),
        (
            "from scipy.spatial.transform import Rotation\n"
            "Rotation.from_quat(q).as_matrix()",
            "Rotation has no as_matrix",
        ),
        (
            "from scipy.spatial.transform import Rotation as R\n"
            "a = R.from_quat(q)\n(a.inv() * a).magnitude()",
            "Rotation has no magnitude",
        ),
        (
            "from scipy.spatial.transform import Rotation\nRotation.from_matrix(m)\n",
            "Rotation has no from_matrix",
        ),
        (
            "from scipy.spatial.transform import Rotation\n"
            "Rotation.from_rotvec(v).mean()",
            "Rotation has no mean",
        ),
        (
            "from scipy.spatial.transform import Rotation\n"
            "Rotation.from_rotvec(v, degrees=True)",
            "from_rotvec takes no degrees",
        ),
        ("def f(turn):\n    return turn.magnitude()", "Rotation has no magnitude"),
        ("def f(turn):\n    return turn.as_rotvec()", None),
        ("import math\nmath.lcm(1, 2)", "math has no lcm"),
        ("from functools import cache", "functools has no cache"),
        ("a.removeprefix('b')", "has no removeprefix"),
        ("import numpy as np\nif TYPE_CHECKING:\n    import numpy.typing", None),
        ("import os, sys\nif sys.version_info >= (3, 9):\n    os.pidfd_open", None),
    ],
)
def test_what_is_newer_is_found(names, text, problem):
    of_a_class = "Rotation has no" in str(problem) or "import" not in text
    if problem and "has no " in problem and of_a_class:
        member = problem.split()[-1]
        if member not in names.new_members:
            pytest.skip(f"no version is installed that has {member}")
    found = Reader(names).read(text)
    assert len(found) == bool(problem), found
    assert not problem or problem in found[0]
