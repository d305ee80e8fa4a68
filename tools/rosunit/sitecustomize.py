"""Note down what rosunit loses: skipped tests, and errors around tests.

It reports a skipped test as passed, and of an error in setUpClass only that
there was one. Python imports a module of this name when it starts; tools/test
puts this folder on the path of the rostests and names a file per kind.
"""

import os
import traceback
import unittest

SKIPPED = os.environ.get("G1_DESCRIPTION_SKIPPED")
ERRORS = os.environ.get("G1_DESCRIPTION_ERRORS")

add_error_as_usual = unittest.TestResult.addError


def add_skip(self, test, reason):
    """Do what unittest does, and write one line to the file."""
    self.skipped.append((test, reason))
    with open(SKIPPED, "a") as file:
        file.write(f"{test.id()}: {reason}\n")


def add_error(self, test, error):
    """Do what unittest does; write the traceback if the error is not a test's."""
    add_error_as_usual(self, test, error)
    if not isinstance(test, unittest.TestCase):
        with open(ERRORS, "a") as file:
            file.write(f"{test.id()}\n")
            traceback.print_exception(*error, file=file)


if SKIPPED and ERRORS:
    unittest.TestResult.addSkip = add_skip
    unittest.TestResult.addError = add_error
