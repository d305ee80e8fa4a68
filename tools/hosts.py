"""Hosts on one machine: network namespaces, each with a cable to a common switch.

All of it is inside namespaces that end with this process and with what runs in them.
None of it has a name in /run/netns, and no packet leaves. Where users may make
namespaces of their own, root is not needed.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

NET = "10.71.13"
"""First three numbers of all addresses."""

PROGRAMS = ("ip", "unshare", "nsenter")
ALONE = ("--net", "--uts", "--mount")
"""What a host has of its own: its network, its name and its files in /etc."""

HOLD = "exec cat"
"""What keeps a namespace: it ends when nobody holds its input any more."""

BEGIN = """
set -e
mount --make-rprivate /
mount --bind "$2/hosts" /etc/hosts
if [ -e /etc/resolv.conf ]; then mount --bind "$2/resolv.conf" /etc/resolv.conf; fi
hostname "$1"
ip link set lo up
echo made
"""


class HostsError(Exception):
    """This machine has no such hosts; the text says why."""


class Network:
    """A switch; hosts are added to it."""

    def __init__(self):
        """Make the switch.

        Raises:
            HostsError: If that is not possible here.
        """
        missing = [name for name in PROGRAMS if not shutil.which(name)]
        if missing:
            raise HostsError(f"there is no program {missing[0]} (Debian: iproute2)")
        self.hosts = []
        self._folder = tempfile.TemporaryDirectory(prefix="g1_hosts_")
        own_root = () if os.getuid() == 0 else ("--user", "--map-root-user")
        self._enter_user = ("--user", "--preserve-credentials") if own_root else ()
        self._holder = self._held(["unshare", *own_root, *ALONE], "switch")
        self._run("ip", "link", "add", "switch", "type", "bridge")
        self._run("ip", "link", "set", "switch", "up")

    def __enter__(self):
        """Give itself."""
        return self

    def __exit__(self, *_):
        """End all."""
        self.close()

    def close(self):
        """Kill all that runs on hosts, and take the network away."""
        for host in self.hosts:
            host.kill()
            _let_go(host.holder)
        _let_go(self._holder)
        self._folder.cleanup()

    def add(self, name):
        """Add a host; its name leads to the loopback, as Debian sets it up."""
        host = Host(self, name, len(self.hosts) + 2)
        host.holder = self._held([*self._inside(self._holder), "unshare", *ALONE], name)
        self.hosts.append(host)
        port = host.port
        end = ("peer", "name", "eth0", "netns", str(host.holder.pid))
        self._run("ip", "link", "add", port, "type", "veth", *end)
        self._run("ip", "link", "set", port, "master", "switch", "up")
        address = f"{host.address}/24"
        host.run("ip", "addr", "add", address, "dev", "eth0")
        host.run("ip", "link", "set", "eth0", "up")
        return host

    def _inside(self, holder):
        """Give the words that run a command in a namespace."""
        spaces = (*self._enter_user, *ALONE)
        return ["nsenter", "--target", str(holder.pid), *spaces, "--"]

    def _held(self, words, name):
        """Begin a namespace.

        Args:
            words: Command that makes it.
            name: Its host's name.
        """
        folder = Path(self._folder.name, name)
        folder.mkdir()
        (folder / "hosts").write_text(f"127.0.0.1 localhost\n127.0.1.1 {name}\n")
        (folder / "resolv.conf").touch()
        holder = subprocess.Popen(
            [*words, "sh", "-c", BEGIN + HOLD, "sh", name, str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
            text=True,
        )
        if holder.stdout.readline() != "made\n":
            text = holder.stderr.read().strip()
            raise HostsError(f"no network namespaces here: {text}")
        return holder

    def _run(self, *words):
        """Run a command in the namespace of the switch."""
        _checked([*self._inside(self._holder), *words])


class Host:
    """One host."""

    def __init__(self, network, name, number):
        """Name it; the network makes it."""
        self._network = network
        self.name = name
        self.address = f"{NET}.{number}"
        self.port = f"port{number}"
        """The switch's end of its cable."""
        self.holder = None

    def command(self, *words):
        """Give the command that runs another one here."""
        return [*self._network._inside(self.holder), *words]

    def run(self, *words):
        """Run a command here to its end."""
        _checked(self.command(*words))

    def start(self, words, **options):
        """Start a program here; give its Popen, with the program's own process id."""
        options.setdefault("stdin", subprocess.DEVNULL)
        # To enter a host leads to its root folder.
        begin = ("env", f"--chdir={options.pop('cwd', None) or Path.cwd()}")
        command = self.command(*begin, *(str(word) for word in words))
        return subprocess.Popen(command, start_new_session=True, **options)

    def processes(self):
        """Give the ids of all that runs here."""
        own = _network_of(self.holder.pid)
        numbers = [int(name) for name in os.listdir("/proc") if name.isdigit()]
        others = [n for n in numbers if n != self.holder.pid]
        return [n for n in others if own and _network_of(n) == own]

    def kill(self):
        """Kill all that runs here."""
        for number in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)


def _checked(words):
    """Run a command.

    Raises:
        HostsError: With its words and what it said, if it fails.
    """
    done = subprocess.run(words, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL)
    if done.returncode:
        text = done.stderr.decode().strip()
        raise HostsError(f"{' '.join(words)}: {text}")


def _network_of(pid):
    """Name the network namespace of a process; None if it is gone."""
    try:
        return os.readlink(f"/proc/{pid}/ns/net")
    except OSError:
        return None


def _let_go(holder):
    """Let a namespace end."""
    holder.communicate()
