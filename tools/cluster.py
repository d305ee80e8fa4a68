"""Check motions on a Dask cluster of hosts; called by tools/cluster."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from hosts import HostsError, Network

ROOT = Path(__file__).resolve().parents[1]
PYTHON = ROOT / ".venv" / "bin" / "python"
CHECK = ("rosrun", "g1_description", "check", "motions")
PORT = 8786


def say(text):
    """Print a line of progress."""
    print(f"tools/cluster: {text}", flush=True)


def copy(files, folder):
    """Copy files and folders of motions into a folder."""
    folder.mkdir()
    for path in map(Path, files):
        if path.is_dir():
            shutil.copytree(path, folder / path.name)
        else:
            shutil.copy(path, folder)


def start(host, folder, module, *arguments):
    """Start a part of Dask on a host where a folder is hidden; give its Popen."""
    host.run("mount", "-t", "tmpfs", "none", str(folder))
    return host.start(
        [PYTHON, "-m", module, *arguments],
        cwd="/",
        env={
            **os.environ,
            "DASK_TEMPORARY_DIRECTORY": str(folder),
            "PYTHONPATH": str(ROOT / "src"),
        },
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def check_on(network, folder):
    """Check the motions on a cluster, and kill a worker at the first result."""
    names = ("client", "scheduler", "first", "second")
    client, scheduler, *others = (network.add(name) for name in names)
    options = ("--port", PORT, "--no-dashboard")
    start(scheduler, folder, "distributed.cli.dask_scheduler", *options)
    address = f"{scheduler.address}:{PORT}"
    options = (f"tcp://{address}", "--nthreads", 1, "--no-dashboard", "--no-nanny")
    workers = [
        start(host, folder, "distributed.cli.dask_worker", *options) for host in others
    ]
    places = " and ".join(host.address for host in others)
    say(f"a scheduler at {address}, workers at {places}; one dies at the first result")
    words = [*CHECK, "--json", "cluster.json", "--dask", address]
    checking = client.start(words, cwd=folder, stdout=subprocess.PIPE)
    lines = [checking.stdout.readline()]
    workers[-1].kill()
    lines += [*checking.stdout]
    sys.stdout.buffer.write(b"".join({0: lines[0], 1: lines[-1]}.values()))
    sys.stdout.flush()
    checking.wait()


def main():
    """Check twice, and compare."""
    with tempfile.TemporaryDirectory() as name, Network() as network:
        folder = Path(name)
        copy(sys.argv[1:], folder / "motions")
        say("one process")
        subprocess.run([*CHECK, "--quiet", "--json", "one.json"], cwd=folder)
        check_on(network, folder)
        reports = [folder / name for name in ("one.json", "cluster.json")]
        if len({path.read_bytes() for path in reports}) > 1:
            sys.exit("tools/cluster: the reports differ")
        say("both reports are the same")


if __name__ == "__main__":
    try:
        main()
    except (HostsError, OSError) as error:
        sys.exit(f"tools/cluster: {error}")
