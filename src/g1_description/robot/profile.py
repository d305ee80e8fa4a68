"""Profiles: settings of a robot in addition to its URDF, in a folder with robot.yaml.

Profiles are found below ~/.ros/g1_description/robots and in the package's
config/robots; a profile of the user's hides one of the package's of the same name.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from g1_description.errors import ProfileError, UnknownNameError
from g1_description.files.model_files import PACKAGE, ros_home, share_folder
from g1_description.files.yaml import YamlError, read_yaml
from g1_description.text import listed, similar_first

FILE = "robot.yaml"
"""The file of a profile's folder that makes it one."""

PARTS = ("poses", "motors", "collisions")
"""Further files; a part ``NAME`` is by default the file ``NAME.yaml`` of the folder."""

KEYS = ("like", "names", "joints", "model", "standing_pose", "links", "points", *PARTS)


class LinkPoint(NamedTuple):
    """A point of a link that has a name, such as a palm."""

    link: str
    """Name of the link."""

    point: tuple[float, ...]
    """x y z in the frame of the link, in [m]."""

    axis: tuple[float, ...] = (1.0, 0.0, 0.0)
    """Where it faces: a vector x y z in the frame of the link."""


@dataclass(frozen=True)
class Profile:
    """Settings of a robot in addition to its URDF; by default none."""

    name: str = ""
    """Name of its folder; empty: the robot has no profile."""

    names: tuple[str, ...] = ()
    """Names of the robot in its URDF."""

    joints: tuple[str, ...] = ()
    """All its movable joints, where other robots have its name; else empty."""

    model: str = ""
    """URDF, as for ``read_model``; empty if the user has to give it."""

    standing_pose: str = ""
    """Name of the pose in which it stands; empty if unknown."""

    links: Mapping[str, str] = field(default_factory=dict)
    """Links by their role, such as ``left_foot``."""

    points: Mapping[str, LinkPoint] = field(default_factory=dict)
    """Points of links by their names, such as ``left_palm``."""

    poses: Path | None = None
    """File of its named poses."""

    motors: Path | None = None
    """File of its motors; None: they are as in the URDF."""

    collisions: Path | None = None
    """File of its allowed collisions; None: they have to be found."""

    missing_links: Mapping[str, str] = field(default_factory=dict)
    """Links that the robot does not have, by their role."""

    def fits(self, robot: str, joints: Collection[str]) -> bool:
        """Return whether it is that of a robot.

        Args:
            robot: The robot's name in its URDF.
            joints: Its movable joints.
        """
        return robot in self.names and (not self.joints or {*self.joints} == {*joints})


def profile_of(robot: str, joints: Collection[str]) -> Profile:
    """Find the profile of a robot.

    Args:
        robot: Its name in its URDF.
        joints: Its movable joints.

    Returns:
        The first one that fits; an empty one if there is none.

    Raises:
        ProfileError: If a profile cannot be read.
    """
    profiles = map(_read, _folders().values())
    return next((each for each in profiles if each.fits(robot, joints)), Profile())


def find_profile(requested: str) -> Profile:
    """Find a profile by its name or folder.

    Raises:
        UnknownNameError: If there is none; the message lists all.
        ProfileError: If it cannot be read.
    """
    folder = Path(os.path.expanduser(requested))
    if (folder / FILE).is_file():
        return _read(folder.resolve())
    folders = _folders()
    if requested not in folders:
        known = listed(similar_first(requested, folders))
        raise UnknownNameError(
            f"There is no profile and no file '{requested}'. Known profiles: {known}."
        )
    return _read(folders[requested])


def is_profile(requested: str) -> bool:
    """Return whether a user's name of a model means a profile, not a file."""
    try:
        path = Path(os.path.expanduser(requested))
        is_file = path.exists() and not (path / FILE).is_file()
    except (OSError, ValueError):
        return False
    is_word = re.fullmatch(r"[\w.+-]+", requested) is not None
    is_named = is_word and path.suffix.lower() not in (".urdf", ".xacro", ".xml")
    return not is_file and (is_named or path.is_dir())


def is_name(given: str) -> bool:
    """Return whether a user's word for a file of a profile is a name, not a path."""
    return re.fullmatch(r"\w+", given) is not None


def user_folder() -> Path:
    """Return the folder of the user's profiles, which need not exist."""
    return ros_home() / PACKAGE / "robots"


def package_profiles() -> list[str]:
    """Return the folders of the package's profiles."""
    return [str(file.parent) for file in sorted(_package_folder().glob(f"*/{FILE}"))]


def _package_folder() -> Path:
    """Return the folder of the package's profiles."""
    return share_folder() / "config" / "robots"


def _folders() -> dict[str, Path]:
    """Return the folders of all profiles by name, the user's first."""
    found: dict[str, Path] = {}
    for place in (user_folder(), _package_folder()):
        for file in sorted(place.glob(f"*/{FILE}")):
            found.setdefault(file.parent.name, file.parent)
    return found


def _read(folder: Path, above: tuple[Path, ...] = ()) -> Profile:
    """Read a profile.

    Args:
        folder: Its folder.
        above: Folders of the profiles that are like it.
    """
    file = folder / FILE
    try:
        if folder in above:
            raise ProfileError("it is like itself")
        status = file.stat()
        content = _content(file, status.st_mtime_ns, status.st_size)
        base = Profile()
        if content.get("like"):
            base = _read(_like(content["like"], folder), (*above, folder))
        model = _text(content, "model")  # its path starts in the folder
        if model and "://" not in model and not model.startswith(("/", "~")):
            model = f"{folder}/{model}"
        return Profile(
            name=folder.name,
            names=_names(content, "names") or (folder.name,),
            joints=_names(content, "joints"),
            model=model,
            standing_pose=_text(content, "standing_pose") or base.standing_pose,
            links={**base.links, **_links(content)},
            points={**base.points, **_points(content)},
            poses=_part(content, "poses", folder, base),
            motors=_part(content, "motors", folder, base),
            collisions=_part(content, "collisions", folder, base),
        )
    except OSError as error:
        raise ProfileError(f"{file} cannot be read: {error.strerror}.") from error
    except (YamlError, ProfileError) as error:
        if above:
            raise
        raise ProfileError(f"The profile {file}: {str(error).rstrip('.')}.") from error


@lru_cache(maxsize=None)
def _content(file: Path, changed: int, size: int) -> Mapping[str, Any]:
    """Read a file, again only after a change."""
    content = read_yaml(file) or {}
    if not isinstance(content, dict):
        raise ProfileError("it must be a mapping")
    unknown = [str(key) for key in content if key not in KEYS]
    if unknown:
        known = listed(similar_first(unknown[0], KEYS))
        raise ProfileError(f"unknown key {listed(unknown)}. Known keys: {known}")
    return content


def _like(value: object, folder: Path) -> Path:
    """Find the folder of another profile: a name, or a path from this folder.

    Its own name means the package's profile of that name, which it hides.
    """
    place, folders = folder / str(value), _folders()
    if (place / FILE).is_file():
        return place.resolve()
    if value not in folders:
        known = listed(similar_first(str(value), folders))
        raise ProfileError(f"like has no profile '{value}'. Known profiles: {known}")
    found, hidden = folders[str(value)], _package_folder() / str(value)
    return hidden if found == folder and (hidden / FILE).is_file() else found


def _text(content: Mapping[str, Any], key: str) -> str:
    """Read a text; empty if it is missing."""
    value = content.get(key) or ""
    if not isinstance(value, str):
        raise ProfileError(f"{key} must be text (got {value!r})")
    return value


def _names(content: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """Read a list of names; empty if it is missing."""
    value = content.get(key) or ()
    if not isinstance(value, (list, tuple)) or not all(
        isinstance(name, str) for name in value
    ):
        raise ProfileError(f"{key} must be a list of names (got {value!r})")
    return tuple(value)


def _links(content: Mapping[str, Any]) -> dict[str, str]:
    """Read the roles of links; a role without a link is left out."""
    value = content.get("links") or {}
    if not isinstance(value, dict):
        raise ProfileError(f"links must map roles to links (got {value!r})")
    found = {str(role): link for role, link in value.items() if link is not None}
    for role, link in found.items():
        if not isinstance(link, str):
            raise ProfileError(f"{role} of links must be a link (got {link!r})")
    return found


def _points(content: Mapping[str, Any]) -> dict[str, LinkPoint]:
    """Read the named points of links."""
    value = content.get("points") or {}
    if not isinstance(value, dict):
        raise ProfileError(f"points must map names to points (got {value!r})")
    found = {}
    for name, given in value.items():
        try:
            point = LinkPoint(**given)
            numbers = np.array([point.point, point.axis], dtype=float)
        except (TypeError, ValueError):
            numbers = np.zeros(0)
        is_point = numbers.shape == (2, 3) and isinstance(point.link, str)
        if not (is_point and np.isfinite(numbers).all() and numbers[1].any()):
            raise ProfileError(
                f"{name} of points must have link, point and axis: the link's name, "
                f"and x y z twice in its frame, the axis not 0 (got {given!r})"
            )
        found[str(name)] = LinkPoint(point.link, *map(tuple, numbers.tolist()))
    return found


def _part(
    content: Mapping[str, Any], part: str, folder: Path, base: Profile
) -> Path | None:
    """Find a further file; one that is named without a path is in the folder."""
    if part in content:
        name = _text(content, part)
        if not name:
            return None
        file = folder / os.path.expanduser(name)
        if not file.is_file():
            raise ProfileError(f"{part} is {file}, which is not a file")
        return file
    file = folder / f"{part}.yaml"
    found: Path | None = getattr(base, part)
    return file if file.is_file() else found
