"""The wheel, which pip installs where there is neither ROS nor a compiler.

On Python 3.8 and the newest one that is found; on all with EVERY_PYTHON=1.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import pytest
from waiting import DEADLINE

ROOT = Path(__file__).resolve().parents[2]
OLDEST = 8
PIP = ("-m", "pip", "--disable-pip-version-check", "--quiet")
OTHERS = re.compile("PYTHON|ROS_|CMAKE_|LD_|PKG_")
"""Variables through which programs would find more than is installed."""

pytestmark = pytest.mark.slow


def interpreters():
    """Find a Python 3 of each minor version, of pyenv or on PATH."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    found = {}
    for minor in range(OLDEST, 30):
        places = [*pyenv.glob(f"3.{minor}.*/bin/python")]
        found[minor] = places[0] if places else shutil.which(f"python3.{minor}")
    return {minor: path for minor, path in found.items() if path}


FOUND = interpreters()
CHOSEN = FOUND if os.environ.get("EVERY_PYTHON") else {OLDEST, max(FOUND)}


class Environment:
    """A virtual environment, whose programs see nothing else."""

    def __init__(self, python, wheel, place):
        subprocess.run([python, "-m", "venv", place / "venv"], check=True)
        self.bin, self.place, self.wheel = place / "venv" / "bin", place, wheel
        kept = {n: text for n, text in os.environ.items() if not OTHERS.match(n)}
        own = {"PATH": str(self.bin), "ROS_HOME": str(place / "ros")}
        self.given = {"env": {**kept, **own}, "cwd": place, "text": True}

    def run(self, program, *words):
        """Run a program to its end; return its exit code and what it prints."""
        command = [self.bin / program, *words]
        done = subprocess.run(command, **self.given, capture_output=True)
        return done.returncode, done.stdout + done.stderr

    def install(self, extra=""):
        """Install the wheel."""
        code, text = self.run("python", *PIP, "install", f"{self.wheel}{extra}")
        assert code == 0, text


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build it, from a copy, as others may build in the clone at this moment."""
    clone, folder = tmp_path_factory.mktemp("c") / "clone", tmp_path_factory.mktemp("w")
    left_out = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "docs", "test")
    shutil.copytree(ROOT, clone, ignore=left_out)
    words = ("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, clone)
    subprocess.run([sys.executable, *PIP, *words], check=True)
    [made] = folder.iterdir()
    assert re.fullmatch(r"g1_description-[\d.]+-py3-none-any\.whl", made.name)
    return made


@pytest.fixture(scope="module", params=sorted(CHOSEN), ids="3.{}".format)
def installed(request, wheel, tmp_path_factory):
    """Install it."""
    if request.param not in FOUND:
        pytest.skip(f"Python 3.{request.param} is not installed")
    place = tmp_path_factory.mktemp("place")
    made = Environment(FOUND[request.param], wheel, place)
    if made.run("python", *PIP, "download", "--no-deps", "--dest", "probe", "tqdm")[0]:
        pytest.skip("PyPI is not reachable")
    made.install()
    return made


def test_motions_are_checked_and_converted(installed):
    run = installed.run
    assert run("g1", "check", "squat.csv")[0] == 0
    code, text = run("g1", "check", "squat.csv", "faulty.csv", "--jobs", "2")
    assert code == 1 and "2 files: 1 passed, 1 failed." in text
    converted = "motion", "convert", "squat.csv", "--out", "squat.npz"
    assert run("g1-description", *converted)[0] == 0
    assert run("g1", "motion", "info", "squat.npz")[0] == 0


def test_a_motion_is_drawn(installed):
    code, text = installed.run("g1", "snapshot", "a.png", "--motion", "squat.csv")
    assert code == 0, text
    assert (installed.place / "a.png").read_bytes()[1:4] == b"PNG"


def test_the_page_is_an_extra_and_answers_until_ctrl_c(installed):
    words = "web", "squat.csv", "--port", "0"
    code, text = installed.run("g1", *words)
    assert code == 2
    assert re.search(r"needs \w+; install it with: .* 'g1_description\[page\]'$", text)
    installed.install("[page]")
    command, output = [installed.bin / "g1", *words], subprocess.PIPE
    with subprocess.Popen(command, **installed.given, stdout=output) as page:
        try:
            address = re.search(r"http://\S+", page.stdout.readline()).group()
            with urlopen(address, timeout=DEADLINE) as answer:
                assert answer.status == 200
            page.send_signal(signal.SIGINT)
            assert page.wait(DEADLINE) == 0
        finally:
            page.kill()
