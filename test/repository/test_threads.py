"""How many threads linear algebra takes in programs of ours."""

import os
import subprocess
import sys

import pytest

from g1_description.threads import THREADS

WATCH = """
import os, sys

class Watch:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            print(*(os.environ.get(variable) for variable in {threads}), flush=True)
            os._exit(0)  # the rest of the imports takes a second

sys.meta_path.insert(0, Watch())
import {module}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "module",
    [
        "g1_description.cli.check",
        "g1_description.checker.node",
        "g1_description.gazebo.node",
    ],
)
def test_a_program_takes_one_before_it_loads_numpy(module):
    program = WATCH.format(module=module, threads=THREADS)
    environment = {k: v for k, v in os.environ.items() if k not in THREADS}
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}\n{program}"],
        env=environment,
        stdout=subprocess.PIPE,
        check=True,
    )
    assert done.stdout.decode().split() == ["1"] * len(THREADS)
