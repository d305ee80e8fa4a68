"""A robot whose meshes may lie anywhere, as others can find them."""

from __future__ import annotations

from dataclasses import replace

from g1_description.core.errors import DescriptionError, G1DescriptionError

from .load import ModelText, read_model
from .model_files import find_folder
from .uris import with_absolute_uris


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
