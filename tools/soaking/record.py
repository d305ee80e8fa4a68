"""What was seen on the way."""

import json
import os
import re
import time
from collections import Counter

TRACEBACK = re.compile(r"Traceback \(most recent call last\)")
TF_WARNING = re.compile(r"TF_(?:REPEATED|OLD|NAN|SELF|DENORM|NO)_[A-Z_]+")


class Record:
    """Samples, events, and what was printed."""

    def __init__(self, world, plan):
        """Begin.

        Args:
            world: What is watched.
            plan: What is to come.
        """
        self._world, self.plan = world, plan
        self.has_rviz = world.has_rviz
        self.begin = time.monotonic()
        self.samples, self.events, self.lost = [], [], []
        self.latencies, self.kinds, self.counts = [], Counter(), Counter()
        self.unknown, self.texts = [], Counter()
        self.tracebacks, self.restarts = [], {}
        self.ended_early = False
        self._moves = (self.begin, 0)
        self._cpu, self._lines = {}, 0

    @property
    def passed(self):
        """Time since the beginning in [s]."""
        return time.monotonic() - self.begin

    def say(self, text):
        """Print a line of progress."""
        minutes, seconds = divmod(int(self.passed), 60)
        print(f"[{minutes:2d}:{seconds:02d}] {text}", flush=True)

    def note(self, kind):
        """Keep that something is disturbed now."""
        self.say({"kill": "the simulator is killed", "master": "another master"}[kind])
        self.events.append((self.passed, kind))

    def sample(self):
        """Look at each process, and take what the probe has told."""
        load = os.getloadavg()[0]
        seen = {"time": self.passed, "load": load, "memory": {}, "processor": {}}
        for what in self._world.names:
            process = self._world.find(what)
            if process is None:
                continue
            try:
                now = process.pid, process.cpu_seconds(), self.passed
                seen["memory"][what] = process.memory()
            except (OSError, ValueError):
                continue  # it has just ended
            before = self._cpu.get(what)
            if before and before[0] == now[0]:
                share = 100.0 * (now[1] - before[1]) / (now[2] - before[2])
                seen["processor"][what] = share
            self._cpu[what] = now
        seen["rates"] = self._take()
        self.samples.append(seen)

    def _take(self):
        """Give the rates in [Hz] of what came since the last sample."""
        moves = self._world.moves()
        passed = moves[0] - self._moves[0]
        rates = {}
        if passed > 0.0 and moves[1] >= self._moves[1]:
            rates["browser"] = (moves[1] - self._moves[1]) / passed
        self._moves = moves
        self._world.probe.check()
        lines = self._world.probe.output().split("\n")[:-1]
        told = [json.loads(line) for line in lines[self._lines :] if line[:1] == "{"]
        self._lines = len(lines)
        warnings = 0
        for one in told:
            self.counts.update(one["counts"])
            self.kinds.update(one["kinds"])
            warnings += sum(n for kind, n in one["kinds"].items() if "TF_" in kind)
            self.latencies += one["latencies"]
            for moment in one["lost"]:
                self.lost.append(moment - self.begin)
                self.say(f"a command was lost at {moment - self.begin:.1f} s")
        if warnings:
            self.say(f"{warnings} TF warnings")
        seconds = sum(one["seconds"] for one in told)
        for topic in ("/joint_states", "/tf", "/clock"):
            if seconds:
                number = sum(one["counts"].get(topic, 0) for one in told)
                rates[topic] = number / seconds
        return rates

    def finish(self):
        """Look a last time, at what was printed as well."""
        self.sample()
        self.unknown = self._world.unknown()
        text = self._world.printed()
        self.texts.update(TF_WARNING.findall(text))
        self.tracebacks = [
            text[max(found.start() - 300, 0) : found.end() + 1500]
            for found in TRACEBACK.finditer(text)
        ]
        self.restarts = {
            "play": len(self._world.player.programs) - 1,
            "browser": len(self._world.browser.programs) - 1,
        }

    def told(self):
        """Give all of it for JSON."""
        return {
            "hours": self.plan.length / 3600.0,
            "events": self.events,
            "samples": self.samples,
            "lost": self.lost,
            "latencies": self.latencies,
            "warnings": self.kinds,
            "texts": self.texts,
            "tracebacks": self.tracebacks[:20],
        }
