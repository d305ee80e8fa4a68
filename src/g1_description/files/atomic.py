"""Atomic writing of files."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from g1_description.errors import InvalidValueError


def write_whole(path: Path, content: bytes) -> None:
    """Write a file atomically.

    Args:
        path: The file; an existing one is replaced and its mode kept.
        content: The content.

    Raises:
        InvalidValueError: If it cannot be written; an existing file is kept.
    """
    with whole_file(path) as part:
        part.write_bytes(content)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path, which replaces the file on success.

    Raises:
        InvalidValueError: If it cannot be written; an existing file is kept.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        if path.exists():
            shutil.copymode(str(path), str(part))
        part.replace(path)
    except OSError as error:
        raise InvalidValueError(
            f"The file {path} cannot be written: {error.strerror}."
        ) from error
    finally:
        with suppress(OSError):
            part.unlink()
