"""Reading robot descriptions from URDF and xacro files."""

from __future__ import annotations

import codecs
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from g1_description.errors import DescriptionError, G1DescriptionError
from g1_description.files.find import find_model_file, split_arguments
from g1_description.files.model_files import find_folder
from g1_description.files.uris import with_absolute_uris
from g1_description.files.xml import check_size, decoded
from g1_description.robot.description import Description
from g1_description.robot.profile import Profile, find_profile, is_profile
from g1_description.robot.urdf import parse_urdf

UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""Byte order marks of UTF-16, whose text contains zero bytes."""

XACRO_TIMEOUT = 60.0
"""Longest time that xacro may take, in [s]."""


@dataclass(frozen=True)
class ModelText:
    """A robot description and its file."""

    path: Path
    text: str
    """URDF; file names in it are as written."""

    description: Description


def read_model(requested: str) -> ModelText:
    """Read a robot description.

    Args:
        requested: A profile's name or folder; or a URDF or xacro file as a path,
            ``package://`` or ``file://``, for xacro optionally followed by arguments:
            ``robot.urdf.xacro hand=true``.

    Returns:
        The robot, checked.

    Raises:
        DescriptionError: If the file cannot be read, or is not a robot.
    """
    path, text, profile = _read_model(requested)
    return ModelText(path, text, replace(parse_urdf(text), given_profile=profile))


def _read_model(requested: str) -> tuple[Path, str, Profile | None]:
    """Read a URDF; return also its file and the profile that was named."""
    profile = find_profile(requested) if is_profile(requested) else None
    if profile and not profile.model:
        raise DescriptionError(
            f"the profile {profile.name} names no URDF; give the robot's own file "
            f"instead, such as /path/to/{profile.names[0]}.urdf"
        )
    name, arguments = split_arguments(profile.model if profile else requested)
    path = find_model_file(name)
    text = _read(path)
    if path.suffix == ".xacro":
        text = _expand(path, arguments)
    elif arguments:
        raise DescriptionError(
            f"{path.name} is not a .xacro file and takes no arguments (got "
            f"{', '.join(arguments)})."
        )
    return path, text, profile


def _read(path: Path) -> str:
    """Read a file of a size that a robot description can have."""
    try:
        check_size(str(path), path.stat().st_size)
        data = path.read_bytes()
    except OSError as error:
        raise DescriptionError(f"{path} cannot be read: {error.strerror}.") from error
    try:
        return decoded(data)
    except UnicodeDecodeError as error:
        if b"\0" in data and not data.startswith(UTF_16):
            raise DescriptionError(
                f"{path} is a binary file; a robot description must be text."
            ) from error
        line = data.count(b"\n", 0, error.start) + 1
        raise DescriptionError(
            f"Line {line} of {path} is not UTF-8, and no other encoding is declared."
        ) from error


def _expand(path: Path, arguments: dict[str, str]) -> str:
    """Expand xacro to URDF, in a separate process."""
    given = [f"{name}:={value}" for name, value in arguments.items()]
    runner = "g1_description.files.run_xacro"
    try:
        run = subprocess.run(
            [sys.executable, "-m", runner, str(path), *given],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            encoding="utf-8",
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(sys.path),
                "PYTHONIOENCODING": "utf-8:backslashreplace",
            },
            timeout=XACRO_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise DescriptionError(
            f"xacro did not finish {path.name} within {XACRO_TIMEOUT:.0f} s."
        ) from error
    if run.returncode:
        raise DescriptionError(run.stdout.strip() or f"xacro failed for {path.name}.")
    return run.stdout


def read_description(requested: str) -> Description:
    """Return the robot of ``read_absolute``, whose meshes are found from anywhere."""
    return read_absolute(requested).description


def read_absolute(requested: str) -> ModelText:
    """Read a robot, and make its mesh URIs absolute.

    Args:
        requested: The model, as for ``read_model``.

    Returns:
        The robot; its text has absolute mesh URIs, and all names that RViz requires.

    Raises:
        DescriptionError: If the file cannot be read, or is not a robot.
    """
    try:
        path, written, profile = _read_model(requested)
        text = with_absolute_uris(written, path.parent, find_folder, path.stem)
        read = replace(parse_urdf(text), given_profile=profile, urdf=written)
        return ModelText(path, text, read)
    except G1DescriptionError as error:
        why = str(error).rstrip(".")
        end = "" if why.endswith("?") else "."
        raise DescriptionError(
            f"Cannot use the model {requested}: {why}{end}"
        ) from error
