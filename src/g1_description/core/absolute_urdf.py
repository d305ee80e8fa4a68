"""The command that a launch file loads the robot with."""

from __future__ import annotations

import sys

from .command_line import OneSentenceParser
from .errors import G1DescriptionError
from .model_files import find_folder
from .model_text import read_model
from .resources import with_absolute_uris


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
    asked = parser.parse_args().model
    try:
        model = read_model(asked)
        text = with_absolute_uris(model.text, model.path.parent, find_folder)
    except G1DescriptionError as error:
        sys.exit(f"The model {asked} cannot be used: {error}")
    sys.stdout.buffer.write(text.encode("utf-8") + b"\n")
