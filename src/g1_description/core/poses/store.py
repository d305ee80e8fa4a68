"""Where named poses are kept: in the package, and in a file of the user's."""

from __future__ import annotations

from pathlib import Path

from g1_description.core.errors import PoseFileError
from g1_description.core.files.atomic import write_whole
from g1_description.core.files.model_files import ros_home
from g1_description.core.files.share import PACKAGE, share_folder

from .pose import Pose


def package_file() -> Path:
    """Give the package's own poses."""
    return share_folder() / "config" / "poses.yaml"


def user_file() -> Path:
    """Give the file of the user's own poses, which need not exist."""
    return ros_home() / PACKAGE / "poses.yaml"


def read_poses(file: Path | None = None) -> dict[str, Pose]:
    """Read the package's poses and the user's, who wins where both have a name.

    Args:
        file: A file that must exist; by default the user's, where there is one.

    Returns:
        The poses by name.

    Raises:
        G1DescriptionError: If a file cannot be read, or holds something else.
    """
    own = file or user_file()
    poses = read_file(package_file())
    if file or own.exists():
        poses.update(read_file(own))
    return poses


def read_file(file: Path) -> dict[str, Pose]:
    """Read one file.

    Raises:
        G1DescriptionError: If it cannot be read, or holds something else.
    """
    # Only now: the library takes 40 ms, and most robots start without a pose.
    from .yaml_text import parse_poses

    return parse_poses(_text_of(file), str(file))


def _text_of(file: Path) -> str:
    """Read a file's text."""
    try:
        # Not as text, for which Python would change the ends of lines.
        return file.read_bytes().decode("utf-8")
    except OSError as error:
        raise PoseFileError(
            f"The file of poses {file} cannot be read: {error.strerror}."
        ) from error
    except UnicodeDecodeError as error:
        raise PoseFileError(f"The file of poses {file} is not text: {error}.") from (
            error
        )


def save_pose(pose: Pose, file: Path) -> None:
    """Write a pose into a file, in the place of the one of its name if there is one.

    The file is there as a whole or as it was.

    Args:
        pose: What to write.
        file: Where to; it and its folder need not exist.

    Raises:
        G1DescriptionError: If it lies in the package, cannot be read or written.
    """
    file = file.resolve()
    if package_file().resolve().parents[1] in file.parents:
        raise PoseFileError(
            f"{file} lies in the package {PACKAGE}, which keeps its own poses; the "
            f"default is {user_file()}."
        )
    from .yaml_text import with_pose

    text = _text_of(file) if file.exists() else ""
    write_whole(file, with_pose(text, pose, str(file)).encode("utf-8"))
