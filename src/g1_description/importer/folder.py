"""Atomic writing of an output folder."""

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
    """An output folder, which is written to a temporary place until it is complete.

    Args:
        target: The folder; it may exist.
        replace: Whether existing files may be replaced.
        sources: Files that must not be replaced.
    """

    def __init__(self, target: Path, replace: bool, sources: Iterable[Path]) -> None:
        self.target = Path(os.path.abspath(target))
        self._replace = replace
        self._aside = Path()
        self._written: list[str] = []
        self._sources = {os.path.realpath(source) for source in sources}

    def check(self, names: Iterable[str]) -> None:
        """Check that files can be written.

        Raises:
            DescriptionError: If a path is blocked or exists.
        """
        if self.target.exists() and not self.target.is_dir():
            raise DescriptionError(
                f"Cannot write to {self.target}: it is not a folder."
            )
        for name in names:
            path = self.target / name
            blocks = [p for p in path.parents if p.exists() and not p.is_dir()]
            if blocks or path.is_dir():
                raise DescriptionError(
                    f"Cannot write {path}: {(blocks or [path])[0]} is in the way."
                )
            if os.path.lexists(path) and not self._replace:
                raise DescriptionError(
                    f"{path} already exists; use --force to replace it."
                )
            if os.path.realpath(path) in self._sources:
                raise DescriptionError(
                    f"Refusing to overwrite {path}, which is one of the imported "
                    "files; choose another folder."
                )

    def write(self, name: str, data: bytes) -> None:
        """Write a file to the temporary folder.

        Raises:
            DescriptionError: If its path is outside of the folder.
        """
        if ".." in Path(name).parts:
            raise DescriptionError(f"{name} is outside of {self.target}.")
        path = self._aside / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        self._written.append(name)

    @contextmanager
    def completed(self) -> Iterator[None]:
        """Move all files to the target on success; on errors, discard them.

        Raises:
            DescriptionError: If a path was blocked meanwhile.
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
        """Move the files to the target, in one step if it does not exist."""
        self.check(self._written)
        if not self.target.exists():
            self.target.parent.mkdir(parents=True, exist_ok=True)
            mask = os.umask(0)
            os.umask(mask)
            self._aside.chmod(0o777 & ~mask)
            self._aside.rename(self.target)
            return
        for name in self._written:
            path = self.target / name
            path.parent.mkdir(parents=True, exist_ok=True)
            (self._aside / name).replace(path)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ignore signals during a few renames."""
    former = {n: signal.signal(n, signal.SIG_IGN) for n in ENDING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
