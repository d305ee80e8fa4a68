"""What is asked of this machine and this shell, with the standard library alone."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

IMPORT_TIMEOUT = 20.0
"""Longest wait for imports in [s]: the disk may be slow the first time."""

ROS_FOLDER = "/usr/bin"
"""Where the Python of ROS' distributions is."""

NAME_TIMEOUT = 2.0
"""Longest wait for the address of a host, in [s]."""

IMPORTS = """
import importlib, json, sys
found = {}
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except BaseException as error:
        found[name] = "%s: %s" % (type(error).__name__, error)
print("\\n" + json.dumps(found))
"""


def within(seconds: float, function: Callable[..., Any], *given: Any) -> Any:
    """Call a function that may hang, in a thread that is left to itself then.

    Args:
        seconds: Longest wait in [s].
        function: What is called.
        given: Its arguments.

    Raises:
        TimeoutError: If it takes longer; and what the function raises.
    """
    results: queue.Queue = queue.Queue()

    def call() -> None:
        try:
            results.put((function(*given), None))
        except Exception as error:  # which the caller gets
            results.put((None, error))

    threading.Thread(target=call, daemon=True).start()
    try:
        value, error = results.get(timeout=seconds)
    except queue.Empty:
        raise TimeoutError(f"no answer within {seconds:g} s") from None
    if error is not None:
        raise error
    return value


def failed_imports(python: str, names: list[str] | tuple[str, ...]) -> dict[str, str]:
    """Import modules in a process of its own, which may crash.

    Args:
        python: The interpreter.
        names: The modules.

    Returns:
        What is wrong, by the name of the module; nothing where all can be imported.
    """
    try:
        run = subprocess.run(
            [python, "-c", IMPORTS, *names],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=IMPORT_TIMEOUT,
            check=False,
        )
        return dict(json.loads(run.stdout.decode().splitlines()[-1]))
    except subprocess.TimeoutExpired:
        reason = f"it takes more than {IMPORT_TIMEOUT:g} s to import"
    except OSError as error:
        reason = f"it cannot be run ({error.strerror})"
    except (ValueError, IndexError):
        reason = f"importing it ends with {run.returncode}"
    return dict.fromkeys(names, reason)


def python_on_path() -> str:
    """Return the python3 that stands first on PATH; empty if there is none."""
    return shutil.which("python3") or ""


def is_same_python(one: str, other: str) -> bool:
    """Whether two names are of one interpreter in one environment."""
    return bool(one) and os.path.abspath(one) == os.path.abspath(other)


def setup_file() -> str:
    """Return the file that a shell has to source."""
    root = package_root()
    own = root / ".ws" / "devel" / "setup.bash" if root else None
    return str(own) if own and own.is_file() else "~/catkin_ws/devel/setup.bash"


def is_sourced() -> bool:
    """Whether this shell has the workspace: its messages lie beside the code then."""
    return find_spec("g1_description.srv") is not None


def package_root() -> Path | None:
    """Return the clone that this code is part of; None where it is installed."""
    for folder in Path(__file__).resolve().parents:
        if (folder / "tools" / "setup").is_file():
            return folder
    return None


def own_name(environment: Mapping[str, str]) -> tuple[str, str]:
    """Return what nodes of this shell give as their host, and where that is from.

    Args:
        environment: The variables.

    Returns:
        The variable, and its value. ROS takes ROS_HOSTNAME before ROS_IP.
    """
    found = [name for name in ("ROS_HOSTNAME", "ROS_IP") if name in environment]
    if found and environment[found[0]]:  # an empty one hides the other
        return found[0], environment[found[0]]
    return "The name of this host", socket.gethostname()


def addresses_of(host: str) -> list[str]:
    """Return the addresses of a host; empty if it has none, or nobody knows."""
    try:
        found = within(NAME_TIMEOUT, socket.getaddrinfo, host, None)
    except (OSError, UnicodeError):
        return []
    return list(dict.fromkeys(entry[4][0] for entry in found))


def is_own(address: str) -> bool:
    """Whether an address is one of this machine: only those can be bound."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_STREAM) as one:
        one.bind((address, 0))
        return True
    return False


def listening_process(port: int) -> str:
    """Find the process of this machine that listens on a port of TCP.

    Returns:
        Its number; empty if there is none, or only another user's.
    """
    sockets = _listening(port)
    for process in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):  # it has ended, or is another user's
            if sockets & _open_files(process):
                return process
    return ""


def is_stopped(process: str) -> bool:
    """Whether a process has been stopped, as by Ctrl-Z."""
    with contextlib.suppress(OSError):
        status = Path("/proc", process, "stat").read_text().rpartition(")")[2]
        return status.split()[0] == "T"
    return False


def _open_files(process: str) -> set[str]:
    """Read what a process has open, as Linux names it."""
    folder = f"/proc/{process}/fd"
    return {os.readlink(f"{folder}/{number}") for number in os.listdir(folder)}


def _listening(port: int) -> set[str]:
    """Find the sockets that listen on a port of TCP, as Linux names open files."""
    state = "0A"  # Linux's number for it
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        with contextlib.suppress(OSError):
            for line in Path(table).read_text().splitlines()[1:]:
                row = line.split()
                if row[3] == state and int(row[1].rpartition(":")[2], 16) == port:
                    found.add(f"socket:[{row[9]}]")
    return found


def address_towards(host: str) -> str:
    """Return this machine's address on the way to another; empty if there is none."""
    with contextlib.suppress(OSError), socket.socket(type=socket.SOCK_DGRAM) as one:
        one.connect((host, 9))  # sends nothing
        return str(one.getsockname()[0])
    return ""


def own_python() -> str:
    """Return this interpreter."""
    return sys.executable
