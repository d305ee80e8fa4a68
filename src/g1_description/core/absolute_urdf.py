"""The command that a launch file loads the robot with."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .description import parse_urdf
from .errors import G1DescriptionError
from .resources import with_absolute_uris


def main() -> None:
    """Print a URDF file with absolute mesh URIs, or say why it is none."""
    parser = argparse.ArgumentParser(
        description="Print a URDF file with absolute mesh URIs, for the parameter "
        "robot_description. The file stays as it is."
    )
    parser.add_argument("file", type=Path, help="URDF file; its meshes may be relative")
    file = parser.parse_args().file
    try:
        text = with_absolute_uris(file.read_text(encoding="utf-8"), file.parent)
        parse_urdf(text)
    except OSError as error:
        sys.exit(f"The model {file} cannot be read: {error.strerror}.")
    except (G1DescriptionError, UnicodeDecodeError) as error:
        sys.exit(f"The model {file} cannot be used: {error}")
    print(text)
