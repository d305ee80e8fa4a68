"""What users read has the words of the field."""

import ast
import re

import pytest
from pages import PAGES, ROOT, prose

SOURCES = sorted((ROOT / "src" / "g1_description").rglob("*.py"))
TOOLS = [file for file in sorted((ROOT / "tools").rglob("*")) if file.is_file()]
OTHERS = [
    *sorted((ROOT / "launch").glob("*")),
    *(
        f
        for f in sorted((ROOT / "config").rglob("*.yaml"))
        if "collision" not in f.name
    ),
    *sorted(ROOT.glob("msg/*.msg")),
    *sorted(ROOT.glob("srv/*.srv")),
    *(file for file in TOOLS if not file.suffix),
    *sorted((ROOT / "examples").rglob("*.*")),
]
WORDS = {
    r"\bbears?\b": "is in contact, supports",
    r"\b(wanted|told|asked)\b": "commanded or desired; reported or logged; requested",
    r"\bjudge[sd]?\b": "check",
    r"\b(left out|passed over)\b": "ignored",
    r"(?<!there )\b(is|are) no (link|joint|number|text|robot|motion|file)\b": "not a",
    r"\b(anew|likewise|beside|so many|in turn)\b": "again, also, next to, N",
    r"\bmend(s|ed)?\b": "fix",
    r"\bwhoever\b": "anyone who",
    r"\bfilms?\b(?!\.)": "animation, video",
    r"\b(front door|desk|hands out)\b": "gateway, UI loop",
}
"""Expressions that users shall not read, and what to write instead."""


class Messages(ast.NodeVisitor):
    """Collects the texts of a module that have three words and are no docstrings."""

    def __init__(self):
        self.found = []

    def visit_Expr(self, node):
        """Ignore docstrings."""
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_Constant(self, node):
        """Take a text."""
        self._add(node.value)

    def visit_JoinedStr(self, node):
        """Take a text with values, each as ``{}``."""
        parts = (getattr(part, "value", None) for part in node.values)
        self._add("".join(p if isinstance(p, str) else "{}" for p in parts))

    def _add(self, text):
        is_text = isinstance(text, str) and re.search(r"\w+ \S+ \S*\w", text)
        if is_text and "\n" not in text.strip():
            self.found.append(" ".join(text.split()))


def messages(file):
    """List the messages of a module."""
    visitor = Messages()
    visitor.visit(ast.parse(file.read_text(encoding="utf-8")))
    return visitor.found


@pytest.fixture(scope="module")
def lines():
    """List the lines that users read, each with its place."""
    return [(p, line.strip()) for p, text in texts() for line in text.splitlines()]


def texts():
    """Give what users read, by its place."""
    for page in PAGES:
        code = re.compile(r"`[^`\n]*`|\]\([^)]*\)")
        yield page.relative_to(ROOT), code.sub("", prose(page.read_text("utf-8")))
    for file in OTHERS:
        yield file.relative_to(ROOT), file.read_text("utf-8")
    for file in (*SOURCES, *(file for file in TOOLS if file.suffix == ".py")):
        yield file.relative_to(ROOT), "\n".join(messages(file))


@pytest.mark.parametrize("pattern", WORDS)
def test_words_are_those_of_the_field(lines, pattern):
    word = re.compile(pattern, re.I)
    found = [f"{place}: {line}" for place, line in lines if word.search(line)]
    assert not found, f"write {WORDS[pattern]}"
