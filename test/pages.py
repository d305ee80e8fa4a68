"""The pages of the documentation: their links, headings, code and commands."""

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    ROOT / "urdf" / "README.md",
]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.M | re.S)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
INLINE = re.compile(r"`([^`\n]+)`")
HEADING = re.compile(r"^#+ (.+)$", flags=re.M)
COMMAND = re.compile(r"(tools/|roslaunch |rosrun |rostest )")


def prose(text):
    """Return a page's text without its blocks of code."""
    return FENCE.sub("", text)


def links(text):
    """List the targets of links and pictures."""
    return LINK.findall(prose(text))


def inline_code(text):
    """List what stands between single backticks."""
    return INLINE.findall(prose(text))


def anchors(text):
    """Return the anchors that GitHub makes of headings."""
    words = [re.sub(r"[^\w\- ]", "", head.lower()) for head in HEADING.findall(text)]
    return {word.replace(" ", "-") for word in words}


def broken_links(page):
    """List links of a page whose file or heading does not exist."""
    text = page.read_text(encoding="utf-8")
    return [link for link in links(text) if not _resolves(page, link)]


def _resolves(page, link):
    """Check one link; addresses of the web are not opened."""
    if re.match(r"https?://", link):
        return True
    name, _, anchor = link.partition("#")
    file = (page.parent / name).resolve() if name else page
    if not file.exists() or (name and ROOT not in file.parents):
        return False
    return not anchor or anchor in anchors(file.read_text(encoding="utf-8"))


def blocks(text, language):
    """List the blocks of code in a language."""
    return [block for name, block in FENCE.findall(text) if name == language]


def commands(text):
    """List the commands that a page shows, in blocks and between backticks.

    Args:
        text: Markdown.

    Returns:
        Lists of words; what ``&&`` joins is several commands.
    """
    lines = [code for code in inline_code(text) if COMMAND.match(code)]
    for language, block in FENCE.findall(text):
        if language == "bash":
            lines += re.sub(r"\\\n", " ", block).splitlines()
    parts = [part for line in lines for part in _split(line)]
    return [words for words in parts if words]


def _split(line):
    """Split a line into commands, and these into words."""
    words = shlex.split(re.sub(r"\$\(([^)]*)\)", _without_spaces, line), comments=True)
    while "&&" in words:
        position = words.index("&&")
        yield words[:position]
        words = words[position + 1 :]
    yield words


def _without_spaces(match):
    """Keep a command substitution in one word."""
    return match.group(0).replace(" ", "_")
