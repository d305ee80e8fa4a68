"""The command that a launch file loads the robot with."""

from __future__ import annotations

import sys

from .command_line import OneSentenceParser
from .errors import DescriptionError, G1DescriptionError
from .model_files import find_folder
from .model_text import read_model
from .resources import with_absolute_uris


def absolute_urdf(asked: str) -> str:
    """Read a robot whose meshes may lie anywhere.

    Args:
        asked: The model, as for ``read_model``. Its file stays as it is.

    Returns:
        URDF text with absolute mesh URIs.

    Raises:
        DescriptionError: If there is no such model, or it is no robot.
    """
    try:
        model = read_model(asked)
        return with_absolute_uris(model.text, model.path.parent, find_folder)
    except G1DescriptionError as error:
        raise DescriptionError(f"The model {asked} cannot be used: {error}") from error


def main() -> None:
    """Print a URDF file with absolute mesh URIs, or say why it is none."""
    parser = OneSentenceParser(
        description="Print a robot with absolute mesh URIs, for the parameter "
        "robot_description. The file stays as it is."
    )
    parser.add_argument(
        "model",
        help="URDF or xacro file, or package://PACKAGE/FILE; its meshes may be "
        "relative; for xacro with arguments in the same word: 'FILE NAME=VALUE'",
    )
    try:
        text = absolute_urdf(parser.parse_args().model)
    except DescriptionError as error:
        sys.exit(str(error))
    sys.stdout.buffer.write(text.encode("utf-8") + b"\n")
