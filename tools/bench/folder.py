"""A folder of many motions: described, checked, interrupted and opened."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from .graph import MeasurementError

ROOT = Path(__file__).resolve().parents[2]
LAYOUTS = {
    "csv": "",
    "npz": "",
    "pkl": "gmr",
    "lafan1.csv": "lafan1",
    "qpos.npz": "qpos",
}
"""Endings of the files, and their formats."""


def folder(bench):
    """A folder of motions of 2 s, cut from those of the package, in five layouts.

    `motion info`, `check` and `check --dask` go through it, two at a time; memory is
    that of the largest process. `check` is interrupted after a third of its time. The
    page lists the folder from a report.
    """
    count = bench.files or bench.length(1000, 50)
    with TemporaryDirectory(prefix="bench_") as place:
        motions, report = Path(place, "motions"), Path(place, "report.csv")
        motions.mkdir()
        size = _fill(bench, motions, count)
        bench.add("files", count)
        bench.add("size", size / 1e6, "MB")
        jobs = ["--jobs", "2"]
        _run(bench, "motion info", ["motion", "info", motions, *jobs], count)
        check = ["check", motions, "--csv", report, "--quiet"]
        seconds = _run(bench, "check", [*check, *jobs], count)
        _interrupt(bench, [*check[:2], "--json", Path(place, "a.json"), *jobs], seconds)
        with bench.attempt("check --dask"):
            _with_dask(bench, check, count, place)
        _open(bench, motions, report)


def _fill(bench, motions, count):
    """Write the files; return their size in bytes."""
    robot, made = bench.robot, []
    for source in sorted((ROOT / "motions").glob("*.csv")):
        motion = robot.read_motion(source)
        for begin in range(int(motion.duration) - 1):
            part = motion.cut(float(begin), begin + 2.0)
            for ending, format in LAYOUTS.items():
                file = motions / f"{source.stem}_{begin}_50hz.{ending}"
                robot.write_motion(file, part, format=format or None)
                made.append(file)
    for number in range(len(made), count):
        file = made[number % len(made)]
        shutil.copy(file, motions / f"{number}_{file.name}")
    for file in made[count:]:
        file.unlink()
    return sum(file.stat().st_size for file in motions.iterdir())


def _start(words):
    """Start a command of the package."""
    command = [sys.executable, ROOT / "scripts" / words[0], *words[1:]]
    streams = dict.fromkeys(("stdout", "stderr"), subprocess.DEVNULL)
    return subprocess.Popen([*map(str, command)], **streams)


def _run(bench, name, words, count):
    """Run a command over the folder; return how long it took."""
    bench.say(name)
    begin = time.monotonic()
    _, status, usage = os.wait4(_start(words).pid, 0)
    seconds = time.monotonic() - begin
    if os.WEXITSTATUS(status) > 1 or os.WIFSIGNALED(status):
        raise MeasurementError(f"{name} ended with the status {status}")
    bench.add(name, seconds, "s")
    bench.add(f"{name}, files", count / seconds, "1/s")
    bench.add(f"{name}, processor", usage.ru_utime + usage.ru_stime, "s")
    bench.add(f"{name}, memory of the largest process", usage.ru_maxrss / 1e3, "MB")
    return seconds


def _interrupt(bench, words, seconds):
    """Interrupt it, and measure until it has written its report."""
    bench.say("check, interrupted")
    process = _start(words)
    time.sleep(seconds / 3.0)
    process.send_signal(signal.SIGINT)
    begin = time.monotonic()
    process.wait()
    bench.add("check, from Ctrl-C to its report", time.monotonic() - begin, "s")
    if process.returncode != 130 or not Path(words[3]).is_file():
        raise MeasurementError(f"Ctrl-C: exit code {process.returncode}")


def _with_dask(bench, words, count, place):
    """Check on the workers of a cluster."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=place
    ) as cluster:
        address = cluster.scheduler_address.partition("://")[2]
        _run(bench, "check --dask", [*words, "--dask", address], count)


def _open(bench, motions, report):
    """Open the page of the folder; measure until its list is there."""
    from page_client import PageClient

    bench.say("page")
    command = [ROOT / "scripts" / "web", motions, "--report", report, "--port", "0"]
    begin = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, *map(str, command)], stdout=subprocess.PIPE, text=True
    )
    try:
        address = process.stdout.readline().split()[-1]
        with PageClient(address) as client:
            client.wait_until_whole()
            bench.add("page, from its start to the list", time.monotonic() - begin, "s")
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()
