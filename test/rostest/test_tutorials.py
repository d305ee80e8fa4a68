"""Commands of README and the tutorials, and all programs, run as they are printed.

Launch files and tools are started by other tests; here a robot runs already.
"""

import os
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import rospy
from gazebo_msgs.srv import DeleteModel
from pages import (
    PAGES,
    ROOT,
    WITHOUT_LIBRARY,
    blocks,
    commands,
    copy_motions,
    programs,
)
from std_srvs.srv import Empty
from support.ros_testing import DEADLINE, program

TUTORIALS = [ROOT / "README.md", *sorted((ROOT / "docs" / "tutorials").glob("*.md"))]
RUN = ("rosrun", "rostopic", "rosservice")
FOREIGN = ("/path/to", "my_robot", "doctor")
"""What needs files of a user or programs that are not there; the doctor would find
nodes of other tests."""

PACKAGE = "$(rospack_find_g1_description)"
"""As ``commands`` writes it."""

DELETE = "/gazebo/delete_model"
ENDLESS = ("tf_echo", "--watch", "web", "record")
FAULTY = ("motions/faulty.csv", "motions/")
"""Motions that ``check`` fails, and ends with 1."""


def shown():
    """List the commands of the pages, each once."""
    found = {}
    for page in TUTORIALS:
        lines = "".join(blocks(page.read_text(encoding="utf-8"), "bash"))
        for words in commands(f"```bash\n{lines}```\n"):
            text = " ".join(words)
            if words[0] in RUN and not any(part in text for part in FOREIGN):
                found.setdefault(tuple(words), page.name)
    return found


class TestTutorials(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        copy_motions(cls.folder)
        cls.environment = {**os.environ, "HOME": folder.name, "PYTHONUNBUFFERED": "1"}

    def start(self, words):
        """Start a command in the folder."""
        words = [str(word).replace(PACKAGE, str(ROOT)) for word in words]
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
        found = shown()
        self.assertGreater(len(found), 15)
        for words, page in found.items():
            with self.subTest(page=page, command=" ".join(words)):
                if words[2] == "spawn_model":  # beside the robot that runs
                    words = ["spawned" if w == "g1_robot" else w for w in words]
                    self.addCleanup(rospy.ServiceProxy(DELETE, DeleteModel), "spawned")
                process = self.start(words)
                codes = {0}
                if any(part in words for part in ENDLESS):
                    process.stdout.readline()
                    process.send_signal(signal.SIGINT)
                    codes = {0, 1, 130, -signal.SIGINT}
                elif words[2] == "check" and words[3] in FAULTY:
                    codes = {1}
                output = process.communicate(timeout=DEADLINE)[0]
                self.assertIn(process.returncode, codes, output)

    def test_programs_run(self):
        rospy.wait_for_service("/checker/solve_ik", DEADLINE)
        unpause = rospy.ServiceProxy("/gazebo/unpause_physics", Empty)
        shown = [(str(page.relative_to(ROOT)), programs(page)) for page in PAGES]
        for page, texts in shown:
            for text in texts if page not in WITHOUT_LIBRARY else ():
                with self.subTest(page=page, program=text[:60]):
                    process = self.start([sys.executable, "-c", text])
                    output = process.communicate(timeout=DEADLINE)[0]
                    self.assertEqual(process.returncode, 0, output)
                unpause()  # one of them leaves time paused
