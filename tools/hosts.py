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

PROGRAMS = ("ip", "tc", "unshare", "nsenter")
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

DROP = "4,32 0 0 4294963256,37 0 1 {most},6 0 0 0,6 0 0 2"
"""Program of the kernel's packet filter: draw a number of 32 bits, let the packet pass
if it is above `most`, else drop it."""


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

    def add(self, name, known=()):
        """Add a host.

        Args:
            name: Its name.
            known: Hosts whose names it can look up; its own leads to the loopback, as
                Debian sets it up.
        """
        host = Host(self, name, len(self.hosts) + 2)
        lines = [f"{other.address} {other.name}" for other in known]
        host.holder = self._held(
            [*self._inside(self._holder), "unshare", *ALONE], name, lines
        )
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

    def _held(self, words, name, lines=()):
        """Begin a namespace.

        Args:
            words: Command that makes it.
            name: Its host's name.
            lines: Of its /etc/hosts, beside those of every host.
        """
        folder = Path(self._folder.name, name)
        folder.mkdir()
        lines = ["127.0.0.1 localhost", f"127.0.1.1 {name}", *lines]
        (folder / "hosts").write_text("\n".join(lines) + "\n")
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

    def die(self):
        """Vanish, as a host without power: no packet tells anyone."""
        self.pull()
        self.kill()

    def pull(self):
        """Pull the cable out of the switch."""
        self._network._run("ip", "link", "set", self.port, "down")

    def plug(self):
        """Put the cable back."""
        self._network._run("ip", "link", "set", self.port, "up")

    def lose(self, share):
        """Lose packets on the cable, at random, in both directions.

        Args:
            share: Of all packets, 0 to 1.

        Raises:
            HostsError: If the kernel cannot.
        """
        # As they arrive: the sender is not told, as it would be of its own queue.
        drop = DROP.format(most=int(share * 0xFFFFFFFF))
        for run, end in ((self._network._run, self.port), (self.run, "eth0")):
            run("tc", "qdisc", "replace", "dev", end, "clsact")
            filters = ("tc", "filter", "replace", "dev", end, "ingress", "pref", "1")
            run(*filters, "handle", "1", "bpf", "direct-action", "bytecode", drop)


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
