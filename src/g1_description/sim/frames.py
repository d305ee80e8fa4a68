"""Reference frames by name, looked up the way Gazebo does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.errors import UnknownNameError
from ..core.transform import IDENTITY
from .model import SCOPE, Model

WORLD_FRAMES = ("", "world", "map", "/map")


def find_frame(models: Mapping[str, Model], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Find a reference frame: the world, a link, or a model.

    Args:
        models: All models by name, in the order they were spawned.
        name: One of ``WORLD_FRAMES``, ``model::link``, a link's plain name (the
            first in world order is taken), or a model's name.

    Returns:
        Pose in the world, shape (7,), and twist along the world's axes, shape (6,).

    Raises:
        UnknownNameError: If there is no such frame.
    """
    if name in WORLD_FRAMES:
        return IDENTITY, np.zeros(6)
    for model in models.values():
        for row, link in enumerate(model.link_names):
            if name in (link, f"{model.name}{SCOPE}{link}"):
                return model.poses[row], model.twists[row]
    if name not in models:
        raise UnknownNameError(
            f"There is no frame '{name}'; there are the world, links and models: "
            f"{', '.join(models)}."
        )
    return models[name].pose, models[name].twist
