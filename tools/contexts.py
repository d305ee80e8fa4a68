"""For pytest: record lines by the test that executed them, also those of its processes.

tools/mutate names this as a plugin. coverage.py runs already, from a .pth file.
"""

import os
import time

import coverage
import pytest

VARIABLE = "G1_DESCRIPTION_TEST"
"""Names the test to coverage.py in processes that the test starts."""


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    """Switch to the context of a test function, and write down how long it took."""
    current = coverage.Coverage.current()
    name = item.nodeid.partition("[")[0]
    os.environ[VARIABLE] = name
    current.switch_context(name)
    begin, failed = time.monotonic(), item.session.testsfailed
    yield
    current.switch_context("")
    seconds = time.monotonic() - begin
    if item.session.testsfailed > failed:  # it says nothing of a mutant
        seconds = float("inf")
    with open(os.environ["COVERAGE_TIMES"], "a") as file:
        file.write(f"{seconds:.3f} {name}\n")


def pytest_unconfigure():
    """Save what this process recorded: workers of xdist just end."""
    current = coverage.Coverage.current()
    if current:
        current.stop()
        current.save()
