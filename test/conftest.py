"""What all tests share: repeatable random tests, and the robots they use."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

from g1_description.threads import one_thread

one_thread()  # as our programs do, before anything imports numpy

if "ROS_HOME" not in os.environ:  # no profile, pose or pair of the user's
    os.environ["ROS_HOME"] = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, os.environ["ROS_HOME"])

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

import g1_description.web  # noqa: E402, F401  completes old libraries before viser comes


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    """Leave no result of a run that was cut short: it would count as passed."""
    results = session.config.option.xmlpath
    is_cut_short = exitstatus > pytest.ExitCode.TESTS_FAILED
    if is_cut_short and results and not session.testsfailed:
        Path(results).unlink()


settings.register_profile(
    "repeatable", derandomize=True, deadline=None, max_examples=40
)
settings.load_profile("repeatable")

REPOSITORY = Path(__file__).resolve().parents[1]
PROFILE = REPOSITORY / "config" / "robots" / "g1_29dof"
VENDOR = REPOSITORY.parent / "shared" / "data" / "unitree_g1" / "g1_29dof.urdf"


@pytest.fixture(params=["ours", "vendor"], scope="session")
def g1_file(request):
    """Give both G1 files in turn."""
    if request.param == "ours":
        return REPOSITORY / "urdf" / "g1_29dof.urdf"
    if not VENDOR.exists():
        pytest.skip("the vendor's g1_29dof.urdf is not beside the repository")
    return VENDOR


@pytest.fixture(scope="session")
def g1_text(g1_file):
    """Give the text of both G1 files in turn, with absolute mesh URIs."""
    from g1_description.files.uris import with_absolute_uris

    return with_absolute_uris(g1_file.read_text(), g1_file.parent)


@pytest.fixture(scope="session")
def g1():
    """Give the robot of our G1 file."""
    from g1_description import Robot

    return Robot()


@pytest.fixture(scope="session")
def vendors_g1():
    """Give the text of the vendor's file, with absolute mesh URIs."""
    from g1_description.files.uris import with_absolute_uris

    if not VENDOR.exists():
        pytest.skip("the vendor's g1_29dof.urdf is not beside the repository")
    return with_absolute_uris(VENDOR.read_text(), VENDOR.parent)


@pytest.fixture
def file(tmp_path):
    """Give what writes a file and returns its path."""

    def write(content, name="motion"):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def pytest_addoption(parser):
    parser.addoption("--engine", default="bullet", help="physics engine of the worlds")


def pytest_generate_tests(metafunc):
    if metafunc.definition.get_closest_marker("both_engines"):
        metafunc.parametrize("engine", ("bullet", "mujoco"), indirect=True)


@pytest.fixture
def engine(request, pytestconfig):
    """Give the name of a physics engine."""
    return getattr(request, "param", pytestconfig.getoption("engine"))


@pytest.fixture
def make_world(engine):
    """Give what makes worlds, which end with the test."""
    from worlds import Bench

    worlds = []

    def make(*args, **kwargs):
        kwargs.setdefault("engine", engine)
        worlds.append(Bench(*args, **kwargs))
        return worlds[-1]

    yield make
    for world in worlds:
        world.close()
