"""Hooks of mkdocs: the navigation of docs/README.md, and files outside of docs/.

Paths are those of the repository, from its top, unless they are places on the site.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
INDEX = "docs/README.md"
MOVED = {"README.md": "index.md", INDEX: "contents.md"}
"""Places of files that would both be the site's first page."""

LINK = re.compile(r"(?<=\]\()[^)\s:#]+")
ENTRY = re.compile(r"^- \[([^\]]+)\]\(([^)]+)\)", flags=re.M)


def target(path: str, link: str) -> str:
    """Return the file that a link of a page leads to."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(path), link))


def place(path: str) -> str:
    """Return where a file is on the site."""
    return MOVED.get(path) or re.sub("^docs/", "", path)


def on_config(config: Any) -> None:
    """Take the navigation from the index."""
    text = (ROOT / INDEX).read_text(encoding="utf-8")
    config.nav = [{"Home": [place("README.md"), place(INDEX)]}]
    for part in re.split("^## ", text, flags=re.M)[1:]:
        entries = [
            {title: place(target(INDEX, link))} for title, link in ENTRY.findall(part)
        ]
        config.nav.append({part.splitlines()[0]: entries})


def on_files(files: Files, config: Any) -> None:
    """Add the files outside of docs/ that pages link to."""
    files.remove(files.src_uris["README.md"])
    pages = [INDEX, *(f"docs/{file.src_uri}" for file in files.documentation_pages())]
    for path in pages:  # which grows
        text = (ROOT / path).read_text(encoding="utf-8")
        for found in (target(path, link) for link in LINK.findall(text)):
            if (ROOT / found).is_file() and place(found) not in files.src_uris:
                source = str(ROOT / found)
                files.append(File.generated(config, place(found), abs_src_path=source))
                pages += [found] if found.endswith(".md") else []


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Let links lead to the places of files on the site."""
    path = Path(page.file.abs_src_path).relative_to(ROOT).as_posix()
    folder = posixpath.dirname(page.file.src_uri)

    def replaced(link: re.Match[str]) -> str:
        found = target(path, link[0])
        if not (ROOT / found).is_file():
            return link[0]
        return posixpath.relpath(place(found), folder)

    return LINK.sub(replaced, markdown)
