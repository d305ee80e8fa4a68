"""Change random lines of the package, one at a time, and run the tests they concern.

Nothing happens in the working tree: clones of the last commit are changed.
"""

# Of mutmut and cosmic-ray, no version for Python 3.8 chooses tests by line or knows
# rostests, so we have our own.

import argparse
import ast
import queue
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor, as_completed
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

from coverage import CoverageData

from processes import end_processes, marked_environment

MAPS = Path(__file__).resolve().parents[1] / ".ws" / "maps"
OPPOSITES = {
    **{ast.Lt: ">=", ast.GtE: "<", ast.Gt: "<=", ast.LtE: ">"},
    **{ast.Eq: "!=", ast.NotEq: "==", ast.Is: "is not", ast.IsNot: "is"},
    **{ast.In: "not in", ast.NotIn: "in", ast.And: "or", ast.Or: "and"},
    **{ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*"},
}
OTHERS = {
    bool: lambda value: not value,
    int: lambda value: 2 * value or 1,
    float: lambda value: 2.0 * value or 1.0,
    # A name, of a key, a link or a topic, and no sentence.
    str: lambda value: f"{value}x" if re.fullmatch("[a-z][a-z0-9_/]*", value) else None,
}
# What is for readers, type checkers, shells and logs alone: parts and statements.
SKIPPED = {"annotation", "returns", "exc", "decorator_list"}
LEFT_OUT = re.compile(
    r"__\w+__ =|if (TYPE_CHECKING|__name__)\b|(\w+\.)*_?(log|warn)\w*(\.\w+)?\(", re.I
)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
MOST_SECONDS = 120.0  # of pytest's tests for one mutant, as they took for the map
MOST_ROSTESTS = 3
ENOUGH = 0.8  # of the lines of a module that the most thorough rostest executes
MARK = "G1_DESCRIPTION_MUTANT={}"  # of what runs for a clone; tests set their own
PYTEST = ".venv/bin/python -m pytest -q -p no:cacheprovider"
COVERAGE = [sys.executable, "-m", "coverage"]
START = "import coverage; coverage.process_startup()\n"  # of each Python of a clone
SETTINGS = """[run]
parallel = true
sigterm = true
relative_files = true
data_file = {data}
disable_warnings = no-data-collected
source = {clone}/src/g1_description
context = ${{G1_DESCRIPTION_TEST-}}
[paths]
source =
    src/g1_description
    */src/g1_description
"""


class Mutant(NamedTuple):
    """A change of a file's bytes from begin to end."""

    file: str
    line: int  # where its statement begins
    is_inside: bool  # of a function; else an import executes it
    begin: int
    end: int
    new: str

    def apply(self, data):
        """Change the file's bytes."""
        return data[: self.begin] + self.new.encode() + data[self.end :]


def find(file, data):
    """Find the mutants of a module, given as bytes: those are what columns count."""
    starts = [0, *accumulate(len(line) for line in data.splitlines(True))]

    def span(node):
        begin, place = starts[node.lineno - 1] + node.col_offset, vars(node)
        return begin, starts[place["end_lineno"] - 1] + place["end_col_offset"]

    def text(node):
        return data[slice(*span(node))].decode()

    def visit(parent, line, is_inside):
        for field, value in ast.iter_fields(parent):
            inside = is_inside or (field == "body" and isinstance(parent, FUNCTIONS))
            for node in value if isinstance(value, list) else [value]:
                is_statement = isinstance(node, ast.stmt)
                # Where the parts of an f-string are, Python knows since 3.12.
                if not isinstance(node, ast.AST) or isinstance(node, ast.JoinedStr):
                    continue
                if field in SKIPPED or (is_statement and LEFT_OUT.match(text(node))):
                    continue
                begin = node.lineno if is_statement else line
                for new in changes(node, parent, field, text):
                    yield Mutant(file, begin, inside, *span(node), new)
                yield from visit(node, begin, inside)

    return visit(ast.parse(data), 0, False)


def changes(node, parent, field, text):
    """Give what may stand for a node."""
    if isinstance(node, ast.Constant):
        other = OTHERS.get(type(node.value), lambda value: None)(node.value)
        yield from [] if other is None else [repr(other)]
    elif field in ("test", "ifs"):
        yield f"(not ({text(node)}))"
    elif isinstance(parent, ast.Return):
        yield "None"
    if isinstance(node, ast.UnaryOp):
        yield f"({text(node.operand)})"
    elif isinstance(node, ast.Expr) and isinstance(node.value, (ast.Call, ast.Await)):
        yield "pass"
    kinds = [type(kind) for kind in getattr(node, "ops", [getattr(node, "op", None)])]
    if len(kinds) == 1 and kinds[0] in OPPOSITES:
        new = OPPOSITES[kinds[0]]
        parts = [n for n in ast.iter_child_nodes(node) if isinstance(n, ast.expr)]
        if isinstance(node, ast.AugAssign):
            yield f"{text(parts[0])} {new}= ({text(parts[1])})"
        else:
            yield "(" + f" {new} ".join(f"({text(part)})" for part in parts) + ")"


def draw(root, count, seed):
    """Draw lines below src, and a mutant of each.

    A line is drawn by its text: changes elsewhere leave the sample as it is.
    """
    lines = defaultdict(list)
    for path in sorted(root.glob("src/**/*.py")):
        file, data = str(path.relative_to(root)), path.read_bytes()
        texts = data.decode().splitlines()
        for mutant in find(file, data):
            lines[f"{seed} {file} {texts[mutant.line - 1]}"].append(mutant)
    drawn = sorted(lines, key=lambda line: random.Random(line).random())[:count]
    return [random.Random(line).choice(lines[line]) for line in drawn]


def run(clone, script, seconds=None, **variables):
    """Run a script in a clone's workspace; what it starts ends. None: not in time."""
    home = tempfile.mkdtemp(dir=clone.parent)
    variables.update(ROS_HOME=home, ROS_LOG_DIR=home, ROS_HOSTNAME="localhost")
    script = f". tools/common.sh; source_workspace; {script}"
    try:
        return subprocess.run(
            ["bash", "-c", script, "tools/mutate"],
            **dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL),
            cwd=clone,
            env={**marked_environment(MARK.format(clone)), **variables},
            start_new_session=True,
            timeout=seconds,
        ).returncode
    except subprocess.TimeoutExpired:
        return None
    finally:
        end_processes(MARK.format(clone))


def record(clone, file, name):
    """Add the lines and the time of a rostest, or of all of pytest's, to the map."""
    (packages,) = clone.glob(".venv/lib/python3*/site-packages")
    (packages / "coverage_start.pth").write_text(START)
    settings, times = clone.with_suffix(".coverage"), file.with_suffix(".times")
    variables = {"COVERAGE_PROCESS_START": settings, "COVERAGE_TIMES": times}
    begin = time.monotonic()
    if name == "test":
        code = run(clone, f"{PYTEST} -p tools.contexts test", **variables)
        if code not in (0, 1):
            sys.exit(f"tools/mutate: pytest cannot run the tests (exit code {code})")
    else:
        code = run(clone, f"rostest {name}", **variables, G1_DESCRIPTION_TEST=name)
    seconds = time.monotonic() - begin if code == 0 else float("inf")
    command = [*COVERAGE, "combine", "-q", "--append", f"--rcfile={settings}"]
    subprocess.run(command, cwd=clone, check=True)
    with times.open("a") as stream:
        stream.write(f"{seconds:.1f} {name}\n")
    print(f"mapped {name}: {seconds:.0f} s", flush=True)


def read_seconds(clone, file):
    """Read how long the map's tests took, of those that are still there."""
    times, seconds = file.with_suffix(".times"), Counter()
    for line in times.read_text().splitlines() if times.exists() else []:
        seconds_of_case, test = line.split(" ", 1)
        path, _, name = test.partition("::")
        if (clone / path).exists() and (not name or name in (clone / path).read_text()):
            seconds[test] += float(seconds_of_case)
    return seconds


def tests_of(mutant, data, seconds):
    """Give the tests that a mutant concerns: of pytest, and rostests."""
    by_line = data.contexts_by_lineno(mutant.file)
    executing = {*by_line.get(mutant.line, [])}
    found = executing if mutant.is_inside else set()
    if executing and (not mutant.is_inside or "" in executing):
        folder = f"test/{Path(mutant.file.split('/')[2]).stem}/"
        found = found.union(test for test in seconds if test.startswith(folder))
    passing = (test for test in seconds if seconds[test] != float("inf"))
    order = sorted(passing, key=seconds.get)
    tests = [test for test in order if "::" in test and test in found]
    totals = accumulate(seconds[test] for test in tests)
    tests = tests[: sum(total < MOST_SECONDS for total in totals)]
    # Those that execute nearly as much of the module as any are about it.
    lines = Counter(test for tests in by_line.values() for test in tests)
    rostests = [test for test in order if ".test" in test and test in executing]
    most = max((lines[test] for test in rostests), default=0)
    about = [test for test in rostests if lines[test] >= ENOUGH * most]
    return tests, about[:MOST_ROSTESTS]


def judge(mutant, free, data, seconds):
    """Run a mutant's tests in a free clone; give the verdict, and all in words."""
    tests, rostests = tests_of(mutant, data, seconds)
    commands = [" ".join([PYTEST, "-x", *tests])] if tests else []
    commands += [f"rostest {test}" for test in rostests]
    limit = 60.0 + 3.0 * sum(seconds[test] for test in [*tests, *rostests])
    clone = free.get()
    file = clone / mutant.file
    old = file.read_bytes()
    file.write_bytes(mutant.apply(old))
    # The compiled file of the original stays as it is.
    script = " && ".join(commands) or ":"
    code = run(clone, script, limit, PYTHONDONTWRITEBYTECODE="1")
    file.write_bytes(old)
    free.put(clone)
    # Others than 1 say that tests could not even be imported.
    verdict = {None: "timeout", 0: "SURVIVED"}.get(code, "killed")
    text = f"{verdict:8} {mutant.file}:{mutant.line} "
    text += f"({', '.join([f'{len(tests)} tests', *rostests])})"
    number = old.count(b"\n", 0, mutant.begin)
    for sign, code in (("-", old), ("+", mutant.apply(old))):
        text += f"\n    {sign} {code.decode().splitlines()[number].strip()}"
    return verdict, text


def work(given, clones):
    """Do what was asked for."""
    for clone in clones:
        subprocess.run(["git", "clone", "-q", MAPS.parents[1], clone], check=True)
    trees = ["git", "rev-parse", "HEAD:src", "HEAD:test"]
    src, test = subprocess.check_output(trees, cwd=clones[0], text=True).split()
    MAPS.mkdir(exist_ok=True)
    new = MAPS / f"{src[:12]}_{test[:12]}.coverage"
    file = next(MAPS.glob(f"{src[:12]}_*.coverage"), new)
    rostests = sorted(clones[0].glob("test/rostest/*.test")) if given.rostests else []
    names = ["test", *(str(test.relative_to(clones[0])) for test in rostests)]
    settings = clones[0].with_suffix(".coverage")
    settings.write_text(SETTINGS.format(data=file, clone=clones[0]))
    seconds = read_seconds(clones[0], file)
    missing = [name for name in names if name not in seconds]
    for clone in clones if missing or not given.coverage else []:
        if run(clone, "tools/setup --tests") != 0:
            sys.exit("tools/mutate: tools/setup failed in a clone of the last commit")
    for name in missing:
        record(clones[0], file, name)
    if given.coverage:
        report = [*COVERAGE, "report", "--sort=cover", f"--rcfile={settings}"]
        subprocess.run(report, cwd=clones[0], check=True)
        return
    if file != new:
        print(f"the map is older than the tests: {file}")
    data, seconds = CoverageData(str(file)), read_seconds(clones[0], file)
    data.read()
    free, verdicts = queue.Queue(), Counter()
    for clone in clones:
        free.put(clone)
    with ThreadPoolExecutor(given.jobs) as pool:
        sample = draw(clones[0], given.sample, given.seed)
        futures = [pool.submit(judge, mutant, free, data, seconds) for mutant in sample]
        try:
            for future in as_completed(futures):
                verdict, text = future.result()
                print(text, flush=True)
                verdicts[verdict] += 1
        finally:
            for future in futures:
                future.cancel()
            for clone in clones:
                end_processes(MARK.format(clone))
    print(", ".join(f"{count} {verdict}" for verdict, count in verdicts.items()))


def main():
    """Read the options; the clones are gone with the end."""
    parser = argparse.ArgumentParser(prog="tools/mutate")
    for name, default in (("sample", 20), ("seed", 1), ("jobs", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    for name in ("rostests", "coverage"):
        parser.add_argument(f"--{name}", action="store_true")
    given = parser.parse_args()
    # Also where SIGINT is ignored, as under nohup.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit("tools/mutate: interrupted"))
    with tempfile.TemporaryDirectory(prefix="g1_mutate_") as folder:
        place = Path(folder).resolve()
        work(given, [place / str(number) for number in range(given.jobs)])


if __name__ == "__main__":
    main()
