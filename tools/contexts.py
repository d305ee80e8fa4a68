"""For pytest: record lines by the test that executed them, also those of its processes.

tools/mutate names this as a plugin. coverage.py runs already, from a .pth file.
"""

import os
import time

import coverage
import pytest


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    """Switch to the context of a test function, and write down how long it took."""
    name = item.nodeid.partition("[")[0]
    os.environ["G1_DESCRIPTION_TEST"] = name  # for the processes that it starts
    current = coverage.Coverage.current()
    current.switch_context(name)
    begin, failed = time.monotonic(), item.session.testsfailed
    yield
    current.switch_context("")
    seconds = time.monotonic() - begin
    if item.session.testsfailed > failed:  # it says nothing of a mutant
        seconds = float("inf")
    with open(os.environ["COVERAGE_TIMES"], "a") as file:
        file.write(f"{seconds:.3f} {name}\n")
