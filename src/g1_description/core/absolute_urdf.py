"""The command that a launch file loads the robot with."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .description import parse_urdf
from .errors import DescriptionError, G1DescriptionError
from .resources import with_absolute_uris


def read_urdf_file(file: Path) -> str:
    """Read a URDF file.

    Args:
        file: The file; its meshes may be relative. It stays as it is.

    Returns:
        Its text with absolute mesh URIs, checked to be a robot.

    Raises:
        DescriptionError: If it cannot be read or makes no robot.
    """
    try:
        text = with_absolute_uris(file.read_text(encoding="utf-8"), file.parent)
        parse_urdf(text)
    except OSError as error:
        raise DescriptionError(
            f"The model {file} cannot be read: {error.strerror}."
        ) from error
    except (G1DescriptionError, UnicodeDecodeError) as error:
        raise DescriptionError(f"The model {file} cannot be used: {error}") from error
    return text


def main() -> None:
    """Print a URDF file with absolute mesh URIs, or say why it is none."""
    parser = argparse.ArgumentParser(
        description="Print a URDF file with absolute mesh URIs, for the parameter "
        "robot_description. The file stays as it is."
    )
    parser.add_argument("file", type=Path, help="URDF file; its meshes may be relative")
    try:
        print(read_urdf_file(parser.parse_args().file))
    except DescriptionError as error:
        sys.exit(str(error))
