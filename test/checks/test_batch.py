"""Many motions: processes and a Dask cluster find what one does, and lose nothing.

The robot is small, so that little but the start of processes takes time.
"""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import distributed
import pytest
from checked import POST, read, read_or_die, write_motions
from conftest import REPOSITORY
from waiting import DEADLINE, wait_for

from g1_description import Robot
from g1_description.checks import batch
from g1_description.checks import cluster as clusters
from g1_description.checks.batch import (
    DIED,
    FileChecker,
    Here,
    Processes,
    Task,
    check_files,
)
from g1_description.checks.cluster import Cluster, packed
from g1_description.checks.report import json_text
from g1_description.errors import ClusterError
from g1_description.files.model_files import find_folder
from g1_description.files.uris import local_path
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions

pytestmark = pytest.mark.slow

REACHES = (0.3, 1.2, 0.5)


def tasks_of(files):
    return [Task(number, file.name, file) for number, file in enumerate(files)]


def in_order(found):
    return [outcome for _, outcome in sorted(found, key=lambda item: item[0].number)]


def checked(pool, files):
    """Check files with a pool; give the outcomes in the order of the files."""
    try:
        return in_order(check_files(pool, tasks_of(files)))
    finally:
        pool.close()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Give motions, and a file that is none."""
    folder = tmp_path_factory.mktemp("motions")
    junk = folder / "junk.csv"
    junk.write_text("a,b\n1,2\n")
    return [*write_motions(folder, *REACHES), junk]


@pytest.fixture(scope="module")
def checker():
    return FileChecker(Robot(POST).checker(), plot=True, reader=read)


@pytest.fixture(scope="module")
def alone(checker, files):
    """Give what this process finds."""
    return checked(Here(checker), files)


def test_one_process_checks_all(alone):
    results = [outcome.result for outcome in alone]
    assert results == ["passed", "failed", "passed", "not read"]
    assert alone[-1].problem == "Line 1 has the columns a, b, but lacks time."
    assert all(outcome.plot for outcome in alone[:-1])


def test_processes_find_the_same_and_lose_no_file(checker, files, alone, tmp_path):
    """One file kills its process each time, another one once.

    Of the files in the queue of a process that dies, nobody knows which it was.
    """
    deadly, once = tmp_path / "deadly.csv", tmp_path / "once.csv"
    for file in (deadly, once):
        file.write_bytes(files[0].read_bytes())
    dying = FileChecker(checker.checker, reader=read_or_die)
    found = checked(Processes(dying, 1), [deadly, once, *files])
    assert json_text(found[2:], 0) == json_text(alone, 0)
    assert found[0].result == "not checked"
    assert found[0].problem == DIED
    assert found[1].verdict.as_dict() == alone[0].verdict.as_dict()


def test_a_process_that_dies_with_nothing_to_do_is_replaced(checker, files, alone):
    n_threads = threading.active_count()
    workers = Processes(FileChecker(checker.checker, reader=read), 1)
    workers.ahead = 1
    try:
        found = []
        for task, outcome in check_files(workers, tasks_of(files[:2])):
            found.append((task, outcome))
            for process in multiprocessing.active_children():
                process.kill()
                process.join()
            wait_for(lambda: threading.active_count() == n_threads, "it to be seen")
    finally:
        workers.close()
    assert json_text(in_order(found), 0) == json_text(alone[:2], 0)


WAITING = """
import os, sys
sys.path[:0] = {path!r}
from pathlib import Path
from g1_description import Robot
from g1_description.checks.batch import FileChecker, Processes, Task, check_files
from checked import POST, stay

if __name__ == "__main__":
    checker = FileChecker(Robot(POST).checker(), reader=stay)
    next(check_files(Processes(checker, 1), [Task(0, "a", Path("a"))]))
"""


def test_processes_end_with_the_one_that_started_them(tmp_path):
    script = tmp_path / "waits.py"
    script.write_text(WAITING.format(path=sys.path))
    parent = subprocess.Popen([sys.executable, script], cwd=tmp_path)
    try:
        pid = int(wait_for(lambda: text_of(tmp_path / "pid"), "the process"))
    finally:
        parent.kill()
        parent.wait()
    try:
        wait_for(lambda: not Path(f"/proc/{pid}").exists(), "the end of the process")
    except AssertionError:
        os.kill(pid, signal.SIGKILL)
        raise


def text_of(file):
    return file.read_text() if file.exists() else ""


def test_a_cluster_finds_the_same_though_a_worker_dies_until_all_went(
    cluster, files, alone, checker, monkeypatch
):
    """Bags are read here: their motions are sent, with all that is noted of them."""
    monkeypatch.setattr(clusters, "TIMEOUT", DEADLINE)

    def read_here(path, robot, options):
        assert options.topic == "states"
        motion = read_motion(path, robot)
        return replace(motion, notes=(*motion.notes, "read here"))

    bags = FileChecker(
        checker.checker, options=ReadOptions(topic="states"), reader=read_here
    )
    (bag,) = checked(Cluster(bags, cluster.scheduler_address), files[1:2])
    assert bag.verdict.notes[-1] == "read here"
    assert bag.verdict.findings == alone[1].verdict.findings
    connected = Cluster(checker, cluster.scheduler_address)
    try:
        found, workers = [], cluster.workers.values()
        for item in check_files(connected, tasks_of(files)):
            if not found:
                os.kill(next(iter(workers)).process.pid, signal.SIGKILL)
            found.append(item)
        assert json_text(in_order(found), 0) == json_text(alone, 0)
        assert [o.plot for o in in_order(found)] == [o.plot for o in alone]
        monkeypatch.setattr(batch, "PATIENCE", 1.0)
        with pytest.raises(ClusterError, match="has no workers left"):
            for _ in check_files(connected, tasks_of(files * 3)):
                cluster.scale(0)
    finally:
        connected.close()


@pytest.fixture
def cluster(tmp_path_factory):
    """Give a scheduler with two workers, each a process."""
    path = os.pathsep.join([str(REPOSITORY / "src"), *sys.path])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", path)
        with distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address=None,
            local_directory=str(tmp_path_factory.mktemp("dask")),
        ) as made:
            yield made


def test_no_cluster_is_told(checker, monkeypatch):
    monkeypatch.setattr(clusters, "TIMEOUT", 0.3)
    with pytest.raises(ClusterError, match="There is no Dask scheduler at tcp://"):
        Cluster(checker, "127.0.0.1:9")


def test_a_cluster_gets_all_that_a_robot_needs():
    """Hulls of the meshes; for physics the meshes, too, whose files are not there."""
    robot = Robot()
    kinematic = FileChecker(robot.checker())
    found = pickle.loads(packed(kinematic)).checker
    assert found.collisions.pairs == kinematic.checker.collisions.pairs
    assert len(found.collisions.shapes) == len(kinematic.checker.collisions.shapes)
    physics = pickle.loads(packed(FileChecker(robot.checker(physics=True))))
    sent = physics.checker.description
    for link, own in zip(sent.links, robot.description.links):
        for shape, original in zip(link.visuals, own.visuals):
            if shape.kind == "mesh":
                assert shape.filename != original.filename
                content = Path(local_path(original.filename, find_folder)).read_bytes()
                assert (
                    Path(local_path(shape.filename, find_folder)).read_bytes()
                    == content
                )
