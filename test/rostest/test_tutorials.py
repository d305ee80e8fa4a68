"""Commands of README and the tutorials, and all programs, run as they are printed.

Those that need no robot run in test/repository/test_pages.py and test/api. Launch files
and tools are started by other tests; here a robot runs already.
"""

import os
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import rospy
from pages import (
    PAGES,
    ROOT,
    WITHOUT_LIBRARY,
    copy_motions,
    programs,
    tutorial_commands,
)
from std_srvs.srv import Empty
from support.ros_testing import DEADLINE, program, step_by

ENDLESS = ("tf_echo", "record")


class TestTutorials(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        copy_motions(cls.folder)
        step_by(0.05)  # the display runs beside all of them
        cls.environment = {**os.environ, "HOME": folder.name, "PYTHONUNBUFFERED": "1"}

    def start(self, words):
        """Start a command in the folder."""
        if words[0] == "rosrun":
            words = [program(words[2], words[1]), *words[3:]]  # rosrun takes a second
        return subprocess.Popen(
            words,
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def test_commands_do_what_they_say(self):
        found = tutorial_commands(offline=False)
        self.assertGreater(len(found), 8)
        for words, page in found.items():
            with self.subTest(page=page, command=" ".join(words)):
                process = self.start(words)
                codes = {0}
                if any(part in words for part in ENDLESS):
                    process.stdout.readline()
                    process.send_signal(signal.SIGINT)
                    codes = {0, 130, -signal.SIGINT}
                output = process.communicate(timeout=DEADLINE)[0]
                self.assertIn(process.returncode, codes, output)

    def test_programs_run(self):
        rospy.wait_for_service("/checker/solve_ik", DEADLINE)
        unpause = rospy.ServiceProxy("/gazebo/unpause_physics", Empty)
        shown = [(str(page.relative_to(ROOT)), page) for page in PAGES]
        for name, page in shown:
            found = () if name in WITHOUT_LIBRARY else programs(page, robot=True)
            for text in found:
                with self.subTest(page=name, program=text[:60]):
                    process = self.start([sys.executable, "-c", text])
                    output = process.communicate(timeout=DEADLINE)[0]
                    self.assertEqual(process.returncode, 0, output)
                unpause()  # one of them leaves time paused
