"""An output folder that is written completely or not at all."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from g1_description.errors import DescriptionError
from g1_description.interrupts import ENDING_SIGNALS


class Folder:
    """The folder that an import writes, kept aside until it is complete.

    Args:
        target: The folder; it may exist.
        replace: Whether files that are there may be replaced by those written.
    """

    def __init__(self, target: Path, replace: bool) -> None:
        self.target = Path(os.path.abspath(target))
        self._replace = replace
        self._aside = Path()
        self._written: list[str] = []
        self._sources: set[str] = set()

    def protect(self, sources: Iterable[Path]) -> None:
        """Name files that stay as they are, whatever may be replaced."""
        self._sources = {os.path.realpath(source) for source in sources}

    def check(self, names: Iterable[str]) -> None:
        """Check that nothing is in the way of some files.

        Raises:
            DescriptionError: If something is; the message names it.
        """
        if self.target.exists() and not self.target.is_dir():
            raise DescriptionError(f"{self.target} is in the way: it is not a folder.")
        for name in names:
            path = self.target / name
            blocks = [p for p in path.parents if p.exists() and not p.is_dir()]
            if blocks or path.is_dir():
                raise DescriptionError(f"{(blocks or [path])[0]} is in the way.")
            if os.path.lexists(path) and not self._replace:
                raise DescriptionError(f"{path} exists; --force replaces it.")
            if os.path.realpath(path) in self._sources:
                raise DescriptionError(
                    f"{path} is one of the imported files; choose another folder."
                )

    def write(self, name: str, data: bytes) -> None:
        """Write a file aside.

        Raises:
            DescriptionError: If its name leads out of the folder.
        """
        if ".." in Path(name).parts:
            raise DescriptionError(f"{name} would be outside of {self.target}.")
        path = self._aside / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        self._written.append(name)

    @contextmanager
    def completed(self) -> Iterator[None]:
        """Put everything in its place at the end, or nothing if there is an error.

        Raises:
            DescriptionError: If something came in the way meanwhile.
        """
        above = next(p for p in self.target.parents if p.is_dir())
        self._aside = Path(tempfile.mkdtemp(prefix=".import_model-", dir=above))
        try:
            yield
            with undisturbed():
                self._put_in_place()
        finally:
            with undisturbed():
                shutil.rmtree(self._aside, ignore_errors=True)

    def _put_in_place(self) -> None:
        """Move what was written: in one step where there is no such folder yet."""
        self.check(self._written)
        if not self.target.exists():
            self.target.parent.mkdir(parents=True, exist_ok=True)
            self._aside.chmod(0o777 & ~_umask())
            self._aside.rename(self.target)
            return
        for name in self._written:
            path = self.target / name
            path.parent.mkdir(parents=True, exist_ok=True)
            (self._aside / name).replace(path)


def _umask() -> int:
    """Return the permission bits that new files don't get."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ignore signals for the moment that a few renames take."""
    former = {n: signal.signal(n, signal.SIG_IGN) for n in ENDING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
