"""The robot description that a file holds, whatever it is written in."""

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
from g1_description.robot.urdf import parse_urdf

UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""How text begins that is full of zero bytes."""

XACRO_TIMEOUT = 60.0
"""Longest time that xacro may take, in [s]."""


@dataclass(frozen=True)
class ModelText:
    """A robot description and where it came from."""

    path: Path
    text: str
    """URDF; file names in it are as written."""

    description: Description


def read_model(requested: str) -> ModelText:
    """Read a robot description.

    Args:
        requested: URDF file or xacro file as a path, ``package://`` or ``file://``; for
            xacro with arguments behind it: ``robot.urdf.xacro hand=true``.

    Returns:
        The robot, checked to be one.

    Raises:
        DescriptionError: If there is no such file, or no robot in it.
    """
    name, arguments = split_arguments(requested)
    path = find_model_file(name)
    text = _read(path)
    if path.suffix == ".xacro":
        text = _expand(path, arguments)
    elif arguments:
        raise DescriptionError(
            f"{path.name} is no .xacro file and takes no arguments: "
            f"{', '.join(arguments)}."
        )
    return ModelText(path, text, parse_urdf(text))


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
                f"{path} is a binary file, as meshes are; a robot description is text."
            ) from error
        line = data.count(b"\n", 0, error.start) + 1
        raise DescriptionError(
            f"Line {line} of {path} is not UTF-8, and no other encoding is declared "
            "that it could be."
        ) from error


def _expand(path: Path, arguments: dict[str, str]) -> str:
    """Have xacro write URDF, in a process of its own."""
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
            f"xacro has not written {path.name} within {XACRO_TIMEOUT:.0f} s."
        ) from error
    if run.returncode:
        raise DescriptionError(run.stdout.strip() or f"xacro fails for {path.name}.")
    return run.stdout


def absolute_urdf(requested: str) -> str:
    """Give the text that ``read_absolute`` reads."""
    return read_absolute(requested).text


def read_absolute(requested: str) -> ModelText:
    """Read a robot whose meshes may lie anywhere.

    Args:
        requested: The model, as for ``read_model``. Its file stays as it is.

    Returns:
        The robot; its text has absolute mesh URIs, and the names that RViz wants: for
        the robot that of the file.

    Raises:
        DescriptionError: If there is no such model, or it is no robot.
    """
    try:
        model = read_model(requested)
        file = model.path
        text = with_absolute_uris(model.text, file.parent, find_folder, file.stem)
    except G1DescriptionError as error:
        raise DescriptionError(
            f"The model {requested} cannot be used: {error}"
        ) from error
    return replace(model, text=text)
