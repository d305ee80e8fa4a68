"""Which version of this package a machine has, to the last letter."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

from g1_description.core.files.share import share_folder

ROOMS = ("core", "sim")
"""What judges motions."""

CONFIG = "collisions*.yaml"
"""What it reads, of the package's folder config."""


@lru_cache(maxsize=None)
def fingerprint() -> str:
    """Compute a digest of the code that judges motions, and of what it reads."""
    found = hashlib.sha256()
    folder = Path(__file__).resolve().parents[2]
    files = sorted((share_folder() / "config").glob(CONFIG))
    for room in ROOMS:
        files += sorted((folder / room).rglob("*.py"))
    for file in files:
        found.update(file.name.encode("utf-8") + file.read_bytes())
    return found.hexdigest()
