"""Draw lines of the package at random, and change one syntax node of each."""

import ast
import itertools
import random
import re
from collections import Counter, defaultdict
from dataclasses import dataclass

OPPOSITES = {"<": ">=", ">": "<=", "==": "!=", "is": "is not", "in": "not in"}
OPPOSITES.update({"+": "-", "*": "/", "//": "*", "%": "*", "|": "&", "and": "or"})
OPPOSITES.update({new: old for old, new in OPPOSITES.items() if new != "*"})
OPERATOR = re.compile(r"[<>=!]=|//|is not|not in|[-+*/%|&<>]|is|in|and|or")
LOGGING = re.compile(r"(\w+\.)*_?(log|warn)\w*(\.\w+)?\(", re.IGNORECASE)
NAME = re.compile(r"[a-z][a-z0-9_/]*")
"""Texts that are names: of keys, links or topics, not a sentence."""
INSIDE = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
OPERANDS = {
    ast.Compare: ("left", "comparators"),
    ast.BinOp: ("left", "right"),
    ast.BoolOp: ("values",),
    ast.AugAssign: ("target", "value"),
}
TESTED = (ast.If, ast.IfExp, ast.While, ast.Assert)
OWN = (ast.Compare, ast.Constant, ast.UnaryOp)
"""Tests that have mutants of their own."""


@dataclass(frozen=True)
class Mutant:
    """A change of a file's bytes from begin to end."""

    kind: str
    begin: int
    end: int
    new: str
    line: int  # where it begins
    statement: int  # the line in which its statement begins
    is_inside: bool  # of a function; else it is executed by an import

    def apply(self, data):
        """Change the file's bytes."""
        return data[: self.begin] + self.new.encode() + data[self.end :]


class Finder:
    """Finds the mutants of a module."""

    def __init__(self, data):
        """Read the module, as bytes: those are what columns count."""
        self.data, self.found, self._starts = data, [], [0]
        for line in data.splitlines(True):
            self._starts.append(self._starts[-1] + len(line))
        for node in ast.parse(data).body:
            self._visit(node, node, False)

    def _span(self, node):
        """Give begin and end of a node in bytes."""
        place = vars(node)  # where the end is since Python 3.8
        begin = self._starts[node.lineno - 1] + node.col_offset
        return begin, self._starts[place["end_lineno"] - 1] + place["end_col_offset"]

    def _text(self, node):
        begin, end = self._span(node)
        return self.data[begin:end].decode()

    def _visit(self, node, statement, is_inside):
        """Gather the mutants of a node and of those below it."""
        if is_left_out(node):
            return
        head = node.value if isinstance(node, ast.Expr) else node
        if isinstance(head, ast.Call) and LOGGING.match(self._text(head)):
            return
        for kind, target, new in self._changes(node):
            begin, end = target if isinstance(target, tuple) else self._span(target)
            place = self.data.count(b"\n", 0, begin) + 1, statement.lineno
            self.found.append(Mutant(kind, begin, end, new, *place, is_inside))
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "exc"):
                continue
            is_body = is_inside or (isinstance(node, INSIDE) and name == "body")
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    head = child if isinstance(child, ast.stmt) else statement
                    self._visit(child, head, is_body)

    def _changes(self, node):
        """Give the changes of a node alone: kind, node or span, and the new text."""
        if isinstance(node, ast.Constant):
            yield from changed_constant(node)
        elif isinstance(node, ast.UnaryOp):
            yield "sign", node, f"({self._text(node.operand)})"
        elif isinstance(node, ast.Raise) or is_call_statement(node):
            yield "statement", node, "pass"
        elif gives_value(node):
            yield "value", node.value, "None"
        tests = [node.test] if isinstance(node, TESTED) else getattr(node, "ifs", [])
        for test in tests:
            if not isinstance(test, OWN):
                yield "condition", test, f"(not ({self._text(test)}))"
        yield from self._other_operator(node)

    def _other_operator(self, node):
        """Give the change of what stands between two operands."""
        fields = OPERANDS.get(type(node), ())
        values = [getattr(node, name) for name in fields]
        values = [v for value in values for v in (value if is_list(value) else [value])]
        if len(values) != 2 or any(map(is_text, values)):
            return
        begin, end = self._span(values[0])[1], self._span(values[1])[0]
        between = self.data[begin:end].decode()
        old = OPERATOR.search(between)
        if old and old.group() in OPPOSITES and "#" not in between:
            begin += len(between[: old.start()].encode())
            end = begin + len(old.group())
            yield "operator", (begin, end), OPPOSITES[old.group()]


def is_list(value):
    """Tell lists."""
    return isinstance(value, list)


def changed_constant(node):
    """Give the change of a constant, if it has one."""
    value, new = node.value, None
    if isinstance(value, bool):
        new = str(not value)
    elif isinstance(value, int):  # of a large one, one more is nothing
        new = str(2 * value if value > 9 else value + 1)
    elif isinstance(value, float):
        new = str(2.0 * value or 1.0)
    elif isinstance(value, str) and NAME.fullmatch(value):
        new = f'"{value}x"'
    if new is not None:
        yield "constant", node, new


def gives_value(node):
    """Tell what returns or keeps a value, other than a constant."""
    is_kept = isinstance(node, ast.Assign) and isinstance(
        node.targets[0], ast.Attribute
    )
    is_given = is_kept or isinstance(node, ast.Return)
    return is_given and not isinstance(node.value, (ast.Constant, type(None)))


def is_call_statement(node):
    """Tell statements that only call."""
    return isinstance(node, ast.Expr) and isinstance(node.value, (ast.Call, ast.Await))


def is_text(node):
    """Tell whether a node is a literal text: such are joined by plus alone."""
    is_constant_text = isinstance(getattr(node, "value", None), str)
    return is_constant_text or isinstance(node, ast.JoinedStr)


def is_left_out(node):
    """Tell what is no code, or is run by type checkers and shells alone."""
    if isinstance(node, ast.If):
        names = {n.id for n in ast.walk(node.test) if isinstance(n, ast.Name)}
        return bool(names & {"TYPE_CHECKING", "__name__"})
    if isinstance(node, ast.Assign):
        return getattr(node.targets[0], "id", "").startswith("__")
    if isinstance(node, ast.keyword):
        return node.arg == "frozen"  # of a dataclass that nobody changes
    is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return is_docstring or isinstance(node, ast.JoinedStr)


def is_other(data, changed):
    """Tell whether changed code compiles, and is not the same."""
    try:
        return ast.dump(ast.parse(changed)) != ast.dump(ast.parse(data))
    except SyntaxError:
        return False


def rank(*words):
    """Give a number from 0 to 1 that depends on words alone."""
    return random.Random(" ".join(map(str, words))).random()


def draw(root, count, seed):
    """Draw lines below src, and a mutant of each.

    A line's chance depends on its text, so a change elsewhere leaves a sample alone.

    Returns:
        Pairs of the file's name and the mutant; the same for the same files and seed.
    """
    lines, files = [], {}
    for file in sorted(root.glob("src/**/*.py")):
        name, seen, mutants = str(file.relative_to(root)), Counter(), defaultdict(list)
        data = files[name] = file.read_bytes()
        for mutant in Finder(data).found:
            mutants[mutant.line].append(mutant)
        texts = data.decode().split("\n")
        for number, found in sorted(mutants.items()):
            text = texts[number - 1].strip()
            seen[text] += 1
            lines.append((rank(seed, name, seen[text], text), name, number, found))
    drawn = []
    for _, name, _, mutants in sorted(lines, key=lambda line: line[:3]):
        data, places = files[name], {m: n for n, m in enumerate(mutants)}
        mutants.sort(key=lambda m: rank(seed, places[m], m.kind, m.new))
        fit = (m for m in mutants if is_other(data, m.apply(data)))
        drawn += [(name, mutant) for mutant in itertools.islice(fit, 1)]
        if len(drawn) == count:
            break
    return drawn
