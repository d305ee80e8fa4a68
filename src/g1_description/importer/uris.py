"""How a URDF of the result names its meshes."""

from __future__ import annotations

import os
import re
from pathlib import Path

from g1_description.core.files.model_files import find_folder
from g1_description.core.files.uris import package_name


def mesh_prefix(folder: Path) -> tuple[str, str]:
    """Choose how a URDF names its meshes.

    Args:
        folder: Where the result will be, an absolute path.

    Returns:
        What stands before a mesh's name, and a sentence about it.
    """
    for place in (folder, *folder.parents):
        package = package_name(place / "package.xml")
        if package is None:
            continue
        inside = folder.relative_to(place)
        known = find_folder(package)
        is_plain = re.fullmatch(r"[\w./+-]*", str(inside), re.ASCII) is not None
        if (
            known
            and is_plain
            and os.path.realpath(Path(known) / inside) == os.path.realpath(folder)
        ):
            uri = "/".join([f"package://{package}", *inside.parts, "meshes"])
            return uri, f"Meshes are named by `{uri}/...`."
        break
    return "../meshes", (
        "Meshes are named relative to the URDF file (`../meshes/...`), as ROS finds no "
        "package around it; `model:=` of the launch files makes these names absolute."
    )
