"""Physics properties through dynamic_reconfigure, as in gazebo_ros."""

from __future__ import annotations

from types import SimpleNamespace

from dynamic_reconfigure.encoding import encode_config
from dynamic_reconfigure.server import Server

from g1_description.sim.engine import PhysicsProperties

RANGES = {
    "time_step": (0.0, 10.0),
    "max_update_rate": (0.0, 1000.0),
    "gravity_x": (-100.0, 100.0),
    "gravity_y": (-100.0, 100.0),
    "gravity_z": (-100.0, 100.0),
    "auto_disable_bodies": (False, True),
    "sor_pgs_precon_iters": (0, 10_000),
    "sor_pgs_iters": (0, 10_000),
    "sor_pgs_w": (0.0, 5.0),
    "sor_pgs_rms_error_tol": (-1.0, 10_000.0),
    "cfm": (0.0, 10.0),
    "erp": (0.0, 10.0),
    "contact_surface_layer": (0.0, 10.0),
    "contact_max_correcting_vel": (0.0, 1e7),
    "max_contacts": (0, 10_000_000),
}
"""Range of each property, in Gazebo's order."""

DEFAULTS = {
    "time_step": 0.001,
    "max_update_rate": 60.0,
    "gravity_x": 0.0,
    "gravity_y": 0.0,
    "gravity_z": -9.8,
    "auto_disable_bodies": False,
    "sor_pgs_precon_iters": 0,
    "sor_pgs_iters": 20,
    "sor_pgs_w": 1.3,
    "sor_pgs_rms_error_tol": -1.0,
    "cfm": 0.0,
    "erp": 0.2,
    "contact_surface_layer": 0.001,
    "contact_max_correcting_vel": 100.0,
    "max_contacts": 100,
}
"""Defaults that gazebo_ros reports. They are not Gazebo's initial values."""

GROUP = {"name": "Default", "state": True, "id": 0, "parent": 0}
"""The only group, with all properties."""

_KINDS = {float: "double", int: "int", bool: "bool"}
_MEANINGS = {
    "time_step": "Length of a physics step in [s]",
    "max_update_rate": "Steps per second of wall time, 0: as fast as possible",
}


def _configuration() -> SimpleNamespace:
    """Return the equivalent of a generated module, for dynamic_reconfigure's server."""
    groups = {"groups": {**GROUP, "groups": {}}}
    kinds = {name: _KINDS[type(low)] for name, (low, _) in RANGES.items()}
    parameters = [
        {
            "name": name,
            "type": kinds[name],
            "level": 1,
            "description": _MEANINGS.get(name, name.replace("_", " ")),
            "edit_method": "",
            "default": DEFAULTS[name],
            "min": low,
            "max": high,
        }
        for name, (low, high) in RANGES.items()
    ]
    return SimpleNamespace(
        defaults={**DEFAULTS, **groups},
        min={**{name: low for name, (low, _) in RANGES.items()}, **groups},
        max={**{name: high for name, (_, high) in RANGES.items()}, **groups},
        type=kinds,
        config_description={
            **GROUP,
            "type": "",
            "groups": [],
            "parameters": parameters,
        },
    )


class _PhysicsServer(Server):
    """A server that ignores groups; the library fails on unknown ones."""

    def _set_callback(self, request):
        """Change known properties of the right type; ignore the rest."""
        config = request.config
        kinds = (("bool", config.bools), ("int", config.ints))
        given = {
            entry.name: entry.value
            for kind, entries in (*kinds, ("double", config.doubles))
            for entry in entries
            if self.type.type.get(entry.name) == kind
        }
        return encode_config(self.update_configuration(given))


def offer_physics(properties: PhysicsProperties, change) -> Server:
    """Start the server under the node's own name.

    Args:
        properties: Initial properties.
        change: Called with a dict of all properties after a change; returns those with
            other values.
    """
    current = {name: getattr(properties, name) for name in RANGES}
    server = None

    def changed(values, _):
        # The server's constructor calls this with defaults that do not apply.
        if server is None:
            values.update(current)
            return values
        kinds = {name: type(low) for name, (low, _) in RANGES.items()}
        numbers = {name: kind(values[name]) for name, kind in kinds.items()}
        values.update(change(numbers))
        return values

    server = _PhysicsServer(_configuration(), changed)
    return server
