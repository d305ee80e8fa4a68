"""The physics of an SDF world, in the words of Gazebo's services."""

from __future__ import annotations

from lxml import etree

from .values import optional

_PLACES = {
    "time_step": ("", "max_step_size"),
    "max_update_rate": ("", "real_time_update_rate"),
    "max_contacts": ("", "max_contacts"),
    "sor_pgs_precon_iters": ("ode/solver", "precon_iters"),
    "sor_pgs_iters": ("ode/solver", "iters"),
    "sor_pgs_w": ("ode/solver", "sor"),
    "cfm": ("ode/constraints", "cfm"),
    "erp": ("ode/constraints", "erp"),
    "contact_surface_layer": ("ode/constraints", "contact_surface_layer"),
    "contact_max_correcting_vel": ("ode/constraints", "contact_max_correcting_vel"),
}
"""Where each number is, by its name in ``get_physics_properties``."""


def read_physics(holder: etree._Element) -> dict[str, float]:
    """Read what a world says of its physics.

    Args:
        holder: The world.

    Returns:
        Numbers from zero up by their names in ``get_physics_properties``: the time
        step in [s], the rate in steps per second of real time, and those of ODE. What
        the file does not give is left out.

    Raises:
        DescriptionError: If one is no number, or is negative.
    """
    physics = _physics(holder)
    found = {}
    for name, (path, tag) in _PLACES.items():
        parent = physics.find(path) if path and physics is not None else physics
        value = optional(parent, tag, "the physics")
        if value is not None:
            found[name] = value
    return found


def _physics(holder: etree._Element) -> etree._Element | None:
    """Find the physics that count: those that say so, else the first."""
    all_physics = holder.findall("physics")
    for physics in all_physics:
        if physics.get("default", "").lower() in ("true", "1"):
            return physics
    return all_physics[0] if all_physics else None
