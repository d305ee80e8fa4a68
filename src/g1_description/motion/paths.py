"""Paths of motions: a file or folder, or ``FILE#NAME`` for one of several in a file.

Those of this package also have a bare name, such as ``squat.csv``.
"""

from __future__ import annotations

import re
from os import PathLike, fspath
from pathlib import Path

from g1_description.text import did_you_mean

RATE_IN_NAME = re.compile(
    r"(?<![\d.])0*(?P<before>[1-9]\d{0,5})[ _-]?(?:hz|fps)(?![a-z0-9])"
    r"|(?<![a-z])(?:hz|fps)[ _-]?0*(?P<behind>[1-9]\d{0,5})(?![a-z0-9.])"
    r"|_(?=\d{1,3}_jpos)0*(?P<jpos>[1-9]\d{0,2})_jpos(?![a-z0-9])",
    re.IGNORECASE,
)
"""A rate in the name of a file: ``walk.bvh_60hz``, ``walk-50fps``, ``fps50_walk`` and,
as AMASS for the G1 has it, ``walk_120_jpos``."""


def rate_in(path: Path) -> float | None:
    """Return the rate in the name of a file in [Hz]; None: none, or several."""
    rates = {float(path.stem[digits]) for _, digits in _rates(path.stem)}
    return rates.pop() if len(rates) == 1 else None


def with_rate(path: Path, rate: float) -> Path:
    """Return a path whose name has this rate in [Hz] in place of another.

    A rate that is no integer is left out of the name; a name without a rate stays.
    """
    stem, found = path.stem, _rates(path.stem)
    if not found or rate_in(path) == rate:
        return path
    for whole, digits in reversed(found):
        if rate == int(rate):
            stem = f"{stem[: digits.start]}{rate:.0f}{stem[digits.stop :]}"
        else:
            stem = stem[: whole.start] + stem[whole.stop :]
    return path.with_name((stem.strip(" _-") or path.stem) + path.suffix)


def _rates(stem: str) -> list[tuple[slice, slice]]:
    """Find rates in a name: each as a whole, and its digits."""
    return [
        (slice(*match.span()), slice(*match.span(str(match.lastgroup))))
        for match in RATE_IN_NAME.finditer(stem)
    ]


def plain(name: str) -> str:
    """Return the part of a motion's name that conversions keep.

    Its extension and its rate change, and ``FILE#NAME`` becomes a file in a folder.
    """
    file, _, part = name.partition("#")
    stem = re.sub(r"\.[A-Za-z]+$", "", file)
    stem = RATE_IN_NAME.sub("", stem).strip(" _-") or stem
    return f"{stem}/{as_file(part)}" if part else stem


def as_file(name: str) -> str:
    """Return the name of a motion in a file as that of a file of its own."""
    return re.sub(r"[^\w.+-]+", "_", name).strip(".")


def split(path: Path) -> tuple[Path, str | None]:
    """Split ``FILE#NAME``, which names one of the motions in a file.

    Returns:
        The path, and the name; None: the path is a whole file.
    """
    text = str(path)
    for found in re.finditer("#", text):
        file = Path(text[: found.start()])
        if not path.exists() and file.exists():
            return file, text[found.end() :]
    return path, None


def motion_path(name: str | PathLike[str]) -> Path:
    """Convert a user's name of a motion to a path, which need not exist.

    Args:
        name: A path, ``~`` for the home; ``package://PACKAGE/PATH`` or ``file://``; or
            the name of a motion of this package, if there is no such file.

    Raises:
        DescriptionError: If the package or scheme is unknown.
    """
    # Only where it is needed: doctor must run without rospkg.
    from g1_description.files.find import named_path
    from g1_description.files.model_files import share_folder

    path = named_path(fspath(name))
    packaged = share_folder() / "motions" / path
    is_bare = len(path.parts) == 1 and not split(path)[0].exists()
    return packaged if is_bare and packaged.is_file() else path


def absent(path: Path) -> str:
    """Say that a motion does not exist, and which ones are called nearly so."""
    # Only where it is needed, as above.
    from g1_description.files.model_files import share_folder

    folders = [path.parent]
    if len(path.parts) == 1:
        folders.append(share_folder() / "motions")
    end = path.suffix or ".csv"
    files = (file for folder in folders for file in folder.glob("*"))
    known = {file.stem: file.name for file in files if file.suffix == end}
    return f"{path} does not exist{did_you_mean(path.stem, known, known)}."
