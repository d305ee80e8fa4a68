"""Command lines that answer a mistake with one sentence."""

from __future__ import annotations

import argparse
import math
import sys

import rospy


class OneSentenceParser(argparse.ArgumentParser):
    """A parser whose errors fit into one line of a launch's output."""

    def error(self, message: str) -> None:
        """End with a sentence, without the usage."""
        self.exit(1, f"{self.prog}: {message}; {self.prog} -h tells more.\n")


class Ignored(argparse.Action):
    """Remember that an option was given which means nothing here.

    It needs ``ignored`` among the parser's defaults.
    """

    def __call__(self, parser, namespace, values, option_string=None) -> None:
        """Put the option into the list, once."""
        namespace.ignored = [*dict.fromkeys([*namespace.ignored, option_string])]


def number(text: str) -> float:
    """Read a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isfinite(value):
        return value
    raise argparse.ArgumentTypeError(f"'{text.strip()}' is not a number")


def own_arguments() -> list[str]:
    """Give this program's arguments without ROS' remappings."""
    return rospy.myargv(sys.argv)[1:]
