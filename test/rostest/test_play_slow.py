"""The command play, while its bridge does not answer."""

import re
import signal
import subprocess
import sys
import tempfile
import termios
import unittest
from pathlib import Path

from support.ros_testing import DEADLINE
from support.terminal import Terminal

BRIDGE = Path(__file__).resolve().parent / "support" / "slow_bridge.py"
CTRL_C = b"\x03"


class TestPlaySlow(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.file = Path(folder.name) / "wave.csv"
        self.file.write_text("time,left_elbow_joint\n0,0\n60,1\n")
        self.bridge = subprocess.Popen(
            [sys.executable, BRIDGE, "slow"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.addCleanup(self.bridge.communicate, timeout=DEADLINE)
        self.addCleanup(self.bridge.kill)

    def play(self, *arguments):
        return Terminal("play", self.file, "--namespace", "slow", *arguments)

    def asked(self):
        """Wait until the bridge is asked for something; give what."""
        return self.bridge.stdout.readline().strip()

    def answer(self):
        self.bridge.stdin.write("\n")
        self.bridge.stdin.flush()

    def test_the_terminal_is_as_it_was_when_no_answer_comes(self):
        playing = self.play()
        before = playing.settings()
        self.assertEqual(self.asked(), "play")
        playing.press(CTRL_C)
        self.assertEqual(playing.end(), 130)
        self.assertEqual(playing.settings_left, before)
        self.assertTrue(before[3] & termios.ICANON)

    def test_that_it_may_go_on_is_told(self):
        playing = self.play()
        self.assertEqual(self.asked(), "play")
        self.answer()
        playing.wait("sample 1 of 2")
        self.bridge.kill()
        self.bridge.wait()
        playing.press(CTRL_C)
        self.assertEqual(playing.end(), 130)
        self.assertIn("the robot may keep moving", playing.text)

    def test_that_time_is_paused_is_told_and_waited_for(self):
        playing = self.play("--speed", "0.1")
        self.assertEqual(self.asked(), "play")
        self.answer()
        playing.wait("sample 1 of 2")
        for _ in range(2):
            self.bridge.send_signal(signal.SIGSTOP)
            playing.wait("waiting: no messages on /slow/joint_states after")
            shown = re.findall(r"([\d.]+) of 60", playing.text)[-1]
            playing.text = ""
            self.bridge.send_signal(signal.SIGCONT)
            playing.wait(rf"\] +(?!{shown})[\d.]+ of 60")
            playing.text = ""
        playing.press(b"q")
        self.assertEqual(self.asked(), "stop")
        self.answer()
        self.assertEqual(playing.end(), 0)

    def test_a_bridge_that_is_gone_ends_it(self):
        playing = self.play()
        self.assertEqual(self.asked(), "play")
        self.answer()
        playing.wait("sample 1 of 2")
        self.bridge.kill()
        self.assertEqual(playing.end(), 1)
        self.assertIn("play: /slow/joint_states has no publisher any", playing.text)
