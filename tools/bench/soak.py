"""The bridge at 1 kHz for a long time.

It gets the messages of the bridge's part. Memory is the resident memory after a minute
(or a tenth of the time, if that is less) and at the end.
"""

from contextlib import closing

from . import stream
from .bridge import OURS, RATE, WARM_UP, prepare
from .nodes import Graph
from .peer import Peer


def run(bench):
    """Feed it for ``bench.soak`` seconds."""
    with bench.attempt(f"{bench.soak:.0f} s"):
        soak(bench)


def soak(bench):
    """Feed the bridge, and look at it at the beginning and at the end."""
    urdf = stream.read_urdf(bench.model)
    recording = stream.record(urdf, bench.seed)
    answers = stream.Answers(keep=False)
    first = min(60.0, 0.1 * bench.soak)
    with Graph() as graph, closing(Peer()) as peer:
        prepare(graph, urdf, recording)
        with graph.start(OURS) as program:
            messages = stream.encoded(recording)
            player = stream.Feed(peer, messages, answers, is_stamped=True)
            player.listen("/joint_states")
            player.wait_for(program)
            player.play(RATE, WARM_UP)
            player.drain()
            answers.clear()
            sent = len(player.play(RATE, first))
            early = program.memory()
            bench.say(f"{early:.1f} MB after {first:.0f} s")
            sent += len(player.play(RATE, bench.soak - first))
            player.drain()
            late, lines = program.memory(), program.output().splitlines()
    bench.add(f"memory after {first:.0f} s", early, "MB")
    bench.add(f"memory after {bench.soak:.0f} s", late, "MB")
    bench.add("growth", late - early, "MB", "< 1")
    bench.add("messages sent", sent)
    bench.add("messages lost", sent - answers.count, "", "= 0")
    bench.add("lines of log", len(lines))
