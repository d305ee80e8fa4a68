"""What became of it: tables, a page, a plot."""

import datetime
import os
import platform
import sys
from pathlib import Path

import numpy as np

PICTURE = "soak.png"
RATES = ("/joint_states", "/tf", "/clock", "browser")
SETTLED = 0.1
"""Part of the time after which memory should grow no more."""
INTRODUCTION = """# Reliability

<!-- {command} writes this page. -->

Soak test with fault injection:
display.launch with{rviz} the browser view, a browser, and the checks, while a
motion is played in a loop. {kills} times the simulator is killed, and roslaunch
starts it again; {masters} times the master is killed, and another one takes its
place; {resets} times the simulator is reset.

| | |
| --- | --- |
| command | `{command}` |
| length | {length} |
| day | {day} |
| system | {system}, Python {python} |
| processes ready to run, median | {load} on {cores} cores |

![Memory, processor time and rates]({picture})
"""
NOTES = """
Rates are of wall time: on a machine with more to do than it has cores, simulated
time runs slowly, and everything comes less often. Memory is the resident memory.
The simulator's falls back where it is killed.

A command is lost if no joint states show it within 20 s, whatever happens on the
way. `play` ends when the robot is reset, as it should, and is then started again.

Nodes written with roscpp register once with a master; for robot_state_publisher
and RViz the tool does it again. The nodes of this package do it themselves, with
their services. Parameters live in the master; the tool puts them into the new one.

TF warnings are those of RViz: from the end of a master until it knows the next
one, RViz gets transforms of robot_state_publisher twice, which others do not.
"""


def summary(record):
    """Condense a record to what the tables show.

    Args:
        record: A ``Record`` that is finished.
    """
    late = record.latencies or [float("nan")]
    warnings = sum(record.texts.values())
    counts = {
        "commands sent": len(record.latencies) + len(record.lost),
        "commands lost": len(record.lost),
        "time until a command is seen, median, ms": 1e3 * float(np.median(late)),
        "the same, longest, s": float(max(late)),
        "resets": record.counts["resets"],
        "resets refused": record.counts["resets refused"],
        "simulators killed": sum(kind == "kill" for _, kind in record.events),
        "masters killed": sum(kind == "master" for _, kind in record.events),
        "tracebacks": len(record.tracebacks),
        "TF warnings": warnings,
        "browser connected again": record.restarts["browser"],
        "nodes unknown at the end": len(record.unknown),
    }
    names = ("commands lost", "tracebacks", "nodes unknown at the end")
    return {
        "counts": counts,
        "nodes": {what: _node(record, what) for what in _names(record)},
        "rates": {name: _rate(record, name) for name in RATES},
        "faults": [name for name in names if counts[name]],
        "unknown": record.unknown,
    }


def _names(record):
    """List the nodes that were ever seen."""
    names = {}
    for sample in record.samples:
        names.update(sample["memory"])
    return list(names)


def _series(record, kind, name):
    """Give times and values of one curve."""
    found = [
        (sample["time"], sample[kind][name])
        for sample in record.samples
        if name in sample[kind]
    ]
    return np.array(found).reshape(-1, 2).T


def _node(record, what):
    """Condense what a process used."""
    times, memory = _series(record, "memory", what)
    _, processor = _series(record, "processor", what)
    settled = times >= SETTLED * record.plan.length
    early = memory[settled][0] if settled.any() else memory[0]
    return {
        "early": float(early),
        "late": float(memory[-1]),
        "most": float(memory.max()),
        "processor": float(np.median(processor)) if processor.size else 0.0,
    }


def _rate(record, name):
    """Condense a rate."""
    _, values = _series(record, "rates", name)
    if not values.size:
        return {"median": float("nan"), "least": float("nan")}
    return {"median": float(np.median(values)), "least": float(values.min())}


def tables(result):
    """Give the lines of the tables."""
    minute = f"after {100 * SETTLED:.0f} % of the time"
    lines = [
        "",
        f"| node | memory {minute}, MB | at the end | most | of a core, median, % |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for what, node in result["nodes"].items():
        numbers = (node[key] for key in ("early", "late", "most", "processor"))
        lines.append(f"| {what} | {' | '.join(f'{n:.1f}' for n in numbers)} |")
    lines += ["", "| rate | median, Hz | least, Hz |", "| --- | ---: | ---: |"]
    for name, rate in result["rates"].items():
        shown = "moves in the browser" if name == "browser" else f"`{name}`"
        lines.append(f"| {shown} | {rate['median']:.1f} | {rate['least']:.1f} |")
    lines += ["", "| count | |", "| --- | ---: |"]
    for name, number in result["counts"].items():
        lines.append(f"| {name} | {f'{number:.3f}'.rstrip('0').rstrip('.')} |")
    if result["unknown"]:
        lines += ["", f"Unknown at the end: {', '.join(result['unknown'])}."]
    return lines


def write_page(record, result, page):
    """Write the page and its picture."""
    folder = page.parent / "images"
    folder.mkdir(exist_ok=True)
    plot(record, folder / PICTURE)
    counts = result["counts"]
    text = INTRODUCTION.format(
        command=" ".join(["tools/soak", *sys.argv[1:]]),
        rviz=" RViz," if record.has_rviz else "",
        kills=counts["simulators killed"],
        masters=counts["masters killed"],
        resets=counts["resets"],
        length=f"{record.passed / 60.0:.0f} min",
        day=datetime.date.today(),
        system=f"{platform.system()} {platform.machine()}",
        python=platform.python_version(),
        load=f"{np.median([sample['load'] for sample in record.samples]):.0f}",
        cores=os.cpu_count(),
        picture=f"images/{PICTURE}",
    )
    lines = [text, *tables(result), NOTES]
    Path(page).write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")


def plot(record, file):
    """Draw memory, rates and events over time."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, 1, figsize=(9.0, 9.0), sharex=True)
    panels = ("memory", "memory [MB]"), ("processor", "of a core [%]")
    for (kind, label), axis in zip(panels, axes):
        for what in _names(record):
            times, values = _series(record, kind, what)
            axis.plot(times / 60.0, values, label=what, linewidth=1.0)
        axis.set_ylabel(label)
    axes[0].legend(ncol=3, fontsize="small")
    for name in RATES:
        times, values = _series(record, "rates", name)
        shown = "moves in the browser" if name == "browser" else name
        axes[2].plot(times / 60.0, values, label=shown, linewidth=1.0)
    axes[2].set(ylabel="rate [Hz]", xlabel="time [min]")
    axes[2].legend(ncol=4, fontsize="small")
    for axis in axes:
        axis.set_ylim(bottom=0.0)
        for moment, kind in record.events:
            colour = "tab:red" if kind == "kill" else "black"
            axis.axvline(moment / 60.0, color=colour, linewidth=0.8, linestyle=":")
    for moment in record.lost:
        axes[2].plot(moment / 60.0, 0.0, "rv", clip_on=False)
    axes[0].set_title("dotted: simulator killed (red), master killed (black)")
    figure.tight_layout()
    figure.savefig(file, dpi=90)
