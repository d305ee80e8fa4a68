"""Note down what rosunit loses: skipped tests, subtests that fail, errors around tests.

It reports a skipped test as passed, and so a test of which a subtest failed; of an
error in setUpClass it says only that there was one. Python imports a module of this
name when it starts; tools/test puts this folder on the path of the rostests and names
a file per kind.
"""

import os
import traceback
import unittest

SKIPPED = os.environ.get("G1_DESCRIPTION_SKIPPED")
ERRORS = os.environ.get("G1_DESCRIPTION_ERRORS")

add_error_as_usual = unittest.TestResult.addError
add_subtest_as_usual = unittest.TestResult.addSubTest


def add_skip(self, test, reason):
    """Do what unittest does, and write one line to the file."""
    self.skipped.append((test, reason))
    with open(SKIPPED, "a") as file:
        file.write(f"{test.id()}: {reason}\n")


def add_error(self, test, error):
    """Do what unittest does; write the traceback if the error is not a test's."""
    add_error_as_usual(self, test, error)
    if not isinstance(test, unittest.TestCase):
        note_down(test, error)


def add_subtest(self, test, subtest, error):
    """Do what unittest does; write the traceback of a subtest that failed."""
    add_subtest_as_usual(self, test, subtest, error)
    if error:
        note_down(subtest, error)


def note_down(test, error):
    """Write what went wrong to the file."""
    with open(ERRORS, "a") as file:
        file.write(f"{test.id()}\n")
        traceback.print_exception(*error, file=file)


if SKIPPED and ERRORS:
    unittest.TestResult.addSkip = add_skip
    unittest.TestResult.addError = add_error
    unittest.TestResult.addSubTest = add_subtest
