"""The pages of the documentation: their links, headings, code and commands."""

import re
import shlex
import shutil
from itertools import takewhile
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

OF_FILES = ("docs/examples.md",)
"""Pages whose Python is in files that other tests run."""

WITHOUT_LIBRARY = ("docs/tutorials/moveit.md",)
"""Pages whose Python needs a library that is not installed: its names are checked."""

SEVERAL = ("docs/tutorials/first_planner.md",)
"""Pages whose blocks are programs of their own; any other page is one program."""

RUN = ("rosrun", "rostopic", "rosservice")
OFFLINE = ("check", "moveit_config")
"""Commands of ours that need no robot."""

OTHERS = ("/path/to", "my_robot", "doctor", " web ", "--watch", "--physics")
"""What needs files of a user, finds nodes of other tests, takes long or never ends: the
commands doctor, web and check have tests of their own."""

IMPORT = re.compile(r"^(?:import|from) .*$", flags=re.M)
WITH_ROBOT = re.compile(r"^(import|from) .*\b(rospy|Client|Stream)\b", flags=re.M)
"""Imports of blocks that need a running robot."""


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


def programs(page, *, robot=None):
    """List the programs of a page, except those of ``OF_FILES``.

    Args:
        page: Its path.
        robot: False: the first blocks, as far as they need no robot; True: the others,
            with the imports of the first; None: all.
    """
    name = str(page.relative_to(ROOT))
    found = blocks(page.read_text(encoding="utf-8"), "python")
    if robot is not None:
        first = [*takewhile(lambda block: not WITH_ROBOT.search(block), found)]
        others = found[len(first) :]
        if first and others:
            others.insert(0, "\n".join(IMPORT.findall("".join(first))))
        found = others if robot else first
    if name in OF_FILES or not found:
        return []
    return found if name in SEVERAL else ["\n".join(found)]


def tutorial_commands(*, offline):
    """List the commands of README and the tutorials, each once, and their pages.

    Args:
        offline: Whether to list those that need no robot, or those that do.
    """
    found = {}
    for page in (ROOT / "README.md", *sorted((ROOT / "docs/tutorials").glob("*.md"))):
        lines = "".join(blocks(page.read_text(encoding="utf-8"), "bash"))
        for words in commands(f"```bash\n{lines}```\n"):
            is_known = words[0] in RUN and not any(w in " ".join(words) for w in OTHERS)
            if is_known and (words[2] in OFFLINE) == offline:
                found.setdefault(tuple(words), page.name)
    return found


def copy_motions(folder):
    """Copy what commands and programs of the pages read from the working folder."""
    shutil.copytree(ROOT / "motions", folder / "motions")
    selection = folder / "motions" / "selection.yaml"  # as check --write-selection does
    selection.write_text("faulty.csv: exclude\n", encoding="utf-8")


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
