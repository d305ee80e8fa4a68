"""Files that are written as a whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from g1_description.errors import InvalidValueError


def write_whole(path: Path, content: bytes) -> None:
    """Write a file under another name first, so that it is never half there.

    Args:
        path: The file; one that is there is replaced and its mode kept.
        content: All that will be in it.

    Raises:
        InvalidValueError: If it cannot be written; what was there stays.
    """
    with whole_file(path) as part:
        part.write_bytes(content)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give another name to write a file under; it gets its own when it is whole.

    Raises:
        InvalidValueError: If it cannot be written; what was there stays.
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
