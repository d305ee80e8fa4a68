"""Which motions of a folder are used: a file with a choice and a note for each."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from g1_description.errors import InvalidValueError
from g1_description.files.atomic import write_whole
from g1_description.files.yaml import YamlError, parse_yaml
from g1_description.motion.paths import plain, split

FILE = "selection.yaml"
"""Usual name of the file, in the folder of the motions."""

KEEP, EXCLUDE, UNDECIDED = "keep", "exclude", "undecided"
CHOICES = (KEEP, EXCLUDE, UNDECIDED)

OTHERS = "*"
"""Entry for all motions without one of their own, or that are undecided."""

HEAD = """\
# Which motions are used, by their paths from the folder of this file. For each: choice
# (keep, exclude or undecided) and note. "*": all others; without it, they are kept.
"""

WRITTEN = re.compile(
    r'("(?:[^"\\]|\\.)*"): \{choice: (\w+)(?:, note: ("(?:[^"\\]|\\.)*"))?\}'
)
"""A line as ``write`` makes it: YAML takes 20 s to read 10 000 of them."""


@dataclass(frozen=True)
class Choice:
    """A person's decision on a motion."""

    choice: str = UNDECIDED
    """One of ``CHOICES``."""

    note: str = ""


class Selection:
    """The choices of a file. Motions are named by their paths."""

    def __init__(self, path: str | os.PathLike[str], must_exist: bool = True) -> None:
        """Read a file.

        Args:
            path: The file. Its folder is the one from which it names motions.
            must_exist: Whether a missing file is an error; else nothing is chosen.

        Raises:
            InvalidValueError: If it cannot be read, or holds something else.
        """
        self.path = Path(path)
        self.choices: dict[str, Choice] = {}
        """By the path of the motion from the file's folder, and ``*``."""
        self._folder = os.path.realpath(self.path.parent)
        self.used: set[str] = set()
        """Entries of motions that were requested."""
        self._folders: dict[str, str] = {}
        """Paths of folders of motions from this one."""
        self._plain: dict[str, list[str]] = {}
        """Entries by the common part of their names."""
        if must_exist or self.path.exists():
            self.choices = _read(self.path)

    def name(self, motion: str | os.PathLike[str]) -> str:
        """Return the name in the file of a motion, whose path may end in ``#NAME``."""
        file, part = split(Path(motion))
        folder, name = os.path.split(os.path.abspath(file))
        if folder not in self._folders:  # a motion that is a link has its own choice
            real = os.path.realpath(folder)
            self._folders[folder] = os.path.relpath(real, self._folder)
        found = Path(self._folders[folder], name).as_posix()
        return found if part is None else f"{found}#{part}"

    def of(
        self,
        motion: str | os.PathLike[str],
        folder: str | os.PathLike[str] | None = None,
    ) -> Choice:
        """Return the choice for a motion; undecided if it is not in the file.

        That for a file of several motions is for those without one of their own. A
        motion that was converted has the choice of the one that it was, if there is
        only one of its name.

        Args:
            motion: Its path.
            folder: The folder of converted motions in which it is, if it is not in the
                folder of this file.
        """
        entry = self._entry(motion, folder)
        self.used |= {entry}
        found = self.choices.get(entry, Choice())
        file, part = split(Path(motion))
        if found.choice == UNDECIDED and part is not None:
            return replace(found, choice=self.of(file, folder).choice)
        return found

    def _entry(
        self,
        motion: str | os.PathLike[str],
        folder: str | os.PathLike[str] | None,
    ) -> str:
        """Return the name in the file of a motion, or the one that it was."""
        name = self.name(motion)
        if name in self.choices or not self.choices:
            return name
        is_away = folder is not None and name.startswith("../")
        if is_away:
            name = Path(os.path.relpath(motion, folder)).as_posix()
        if name in self.choices:
            return name
        if not self._plain or sum(map(len, self._plain.values())) != len(self.choices):
            self._plain = {}
            for entry in self.choices:
                self._plain.setdefault(plain(entry), []).append(entry)
        found = self._plain.get(plain(name), [])
        is_other = is_away or not any(map(self._exists, found))
        return found[0] if len(found) == 1 and is_other else name

    def _exists(self, entry: str) -> bool:
        """Return whether there is a file of an entry."""
        return os.path.exists(os.path.join(self._folder, entry.partition("#")[0]))

    def unmatched(self) -> list[str]:
        """List the entries that were requested and that no motion has."""
        names = [name for name in self.choices if name != OTHERS]
        if self.used & {*names}:
            names = [n for n in names if n not in self.used and not self._exists(n)]
        return names

    def keeps(
        self,
        motion: str | os.PathLike[str],
        folder: str | os.PathLike[str] | None = None,
    ) -> bool:
        """Return whether a motion is used; arguments are those of ``of``."""
        found = self.of(motion, folder)
        if found.choice == UNDECIDED:
            found = self.choices.get(OTHERS, Choice(KEEP))
        return found.choice != EXCLUDE

    def choose(self, motion: str | os.PathLike[str], choice: Choice) -> None:
        """Decide on a motion; ``write`` saves it."""
        if choice == Choice():
            self.choices.pop(self.name(motion), None)
        else:
            self.choices[self.name(motion)] = choice

    def write(self) -> None:
        """Write the file; a comment that somebody has added is lost.

        Raises:
            InvalidValueError: If it cannot be written.
        """
        lines = [HEAD]
        for name, found in sorted(self.choices.items()):
            note = f", note: {_quoted(found.note)}" if found.note else ""
            lines.append(f"{_quoted(name)}: {{choice: {found.choice}{note}}}\n")
        text = "".join(lines)
        write_whole(self.path, text.encode("utf-8", "surrogateescape"))


def _quoted(text: str) -> str:
    """Write a text as both JSON and YAML read it."""
    return json.dumps(text, ensure_ascii=not text.isprintable())


def _read(path: Path) -> dict[str, Choice]:
    """Read a file."""
    try:
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise InvalidValueError(f"{path} cannot be read: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise InvalidValueError(f"{path} is not text in UTF-8.") from error
    found: dict[str, Choice] = {}
    lines = text.splitlines()
    for number, line in enumerate(lines):
        written = WRITTEN.fullmatch(line.rstrip())
        if written is None:
            continue
        try:
            name, note = json.loads(written[1]), json.loads(written[3] or '""')
        except ValueError:  # by hand: YAML has more escapes than JSON
            continue
        _add(found, path, name, {"choice": written[2], "note": note})
        lines[number] = ""
    try:
        content = parse_yaml("\n".join(lines).encode())
    except YamlError as error:
        raise InvalidValueError(f"{path}: {error}.") from error
    if not isinstance(content, (dict, type(None))):
        raise InvalidValueError(f"{path} must map motions to choices.")
    for name, value in (content or {}).items():
        _add(found, path, str(name), value)
    return found


def _add(found: dict[str, Choice], path: Path, name: str, value: Any) -> None:
    """Add an entry of a file."""
    if name in found:
        raise InvalidValueError(f"{path}: {name} is there twice.")
    if isinstance(value, str):
        value = {"choice": value}
    if not isinstance(value, Mapping) or not set(value) <= {"choice", "note"}:
        raise InvalidValueError(
            f"{path}: {name} must be a choice, or have choice and note (got {value!r})."
        )
    choice, note = value.get("choice", UNDECIDED), value.get("note")
    if choice not in CHOICES:
        raise InvalidValueError(
            f"{path}: the choice of {name} must be one of {', '.join(CHOICES)} "
            f"(got {choice!r})."
        )
    found[name] = Choice(choice, "" if note is None else str(note))
