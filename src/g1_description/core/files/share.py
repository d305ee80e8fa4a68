"""Where this package's own robot and files lie, with ROS or without.

In the source tree they are on top. catkin and pip install them in
``share/g1_description`` below a prefix.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from g1_description.core.errors import DescriptionError

PACKAGE = "g1_description"

ROBOT = "urdf/g1_29dof.urdf"
"""The robot of this package, in the folder that is looked for."""


@lru_cache(maxsize=None)
def share_folder() -> Path:
    """Find the folder that holds ``config``, ``meshes`` and ``urdf``.

    Raises:
        DescriptionError: If there is none: somebody copied the code alone.
    """
    own = Path(__file__).resolve().parents[2]
    for above in own.parents:
        for folder in (above, above / "share" / PACKAGE):
            if (folder / ROBOT).is_file():
                return folder
    raise DescriptionError(
        f"{own} lacks the robot and the files of {PACKAGE}: no folder above it has "
        f"share/{PACKAGE}/{ROBOT}."
    )
