"""What the log says of the hulls that stand for a model's meshes."""

from __future__ import annotations

import posixpath

import rospy

from g1_description.sim.model import Model


def log_hulls(model: Model) -> None:
    """Log how far meshes of a model are from their hulls, where these are thinned.

    Args:
        model: The model, which has been loaded.
    """
    found = model.hull_deviations
    if not found:
        return
    for name, deviation in found.items():
        rospy.logdebug("%s: %s: %.2f mm", model.name, name, 1000.0 * deviation)
    worst = max(found, key=found.__getitem__)
    rospy.loginfo(
        "%s: hulls of %d meshes are thinned; they are at most %.2f mm from these (%s).",
        model.name,
        len(found),
        1000.0 * found[worst],
        posixpath.basename(worst),
    )
