"""gazebo_ros' services about lights, answered as the real Gazebo does.

What changes the world runs in the simulator's loop, between two steps; what reads it
(get_*) runs beside the loop, while nothing changes.
"""

from __future__ import annotations

from dataclasses import replace

from gazebo_msgs.srv import (
    DeleteLight,
    DeleteLightResponse,
    GetLightProperties,
    GetLightPropertiesResponse,
    SetLightProperties,
    SetLightPropertiesResponse,
)
from std_msgs.msg import ColorRGBA

from g1_description.core.errors import InvalidValueError, UnknownNameError
from g1_description.ros.wire.conversions import vector_to_array

from .base import Services, checked, checked_pose

ATTENUATION = ("constant", "linear", "quadratic")
"""Coefficients of how a light fades with distance."""


class LightServices(Services):
    """Read, change and delete lights."""

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("get_light_properties", GetLightProperties, self.get_light),
            ("set_light_properties", SetLightProperties, self.set_light),
            ("delete_light", DeleteLight, self.delete_light),
        )

    def get_light(self, request):
        """Return a light's color and attenuation."""
        response = GetLightPropertiesResponse()
        try:
            light = self._world.light(request.light_name)
        except UnknownNameError:
            response.status_message = _no_light("getLight", request)
            return response
        response.diffuse = ColorRGBA(*light.diffuse)
        for name in ATTENUATION:
            coefficient = f"attenuation_{name}"
            setattr(response, coefficient, getattr(light, coefficient))
        response.success = True
        return response

    def set_light(self, request):
        """Change a light."""
        try:
            light = self._world.light(request.light_name)
        except UnknownNameError:
            return SetLightPropertiesResponse(False, _no_light("setLight", request))
        try:
            pose = checked_pose(request.pose)
            direction = checked("direction", vector_to_array(request.direction))
            colors = {name: _color(request, name) for name in ("diffuse", "specular")}
            attenuation = {
                f"attenuation_{name}": float(
                    checked(name, [getattr(request, f"attenuation_{name}")])[0]
                )
                for name in ATTENUATION
            }
        except InvalidValueError as error:
            message = f"setLightProperties: refused, {error}"
            return SetLightPropertiesResponse(False, message)
        self._world.add_light(
            replace(
                light,
                cast_shadows=request.cast_shadows,
                pose=pose,
                direction=tuple(direction.tolist()),
                **colors,
                **attenuation,
            )
        )
        return SetLightPropertiesResponse(True, "")

    def delete_light(self, request):
        """Remove a light."""
        name = request.light_name
        try:
            self._world.delete_light(name)
        except UnknownNameError:
            message = f'DeleteLight: Timeout reached while removing light "{name}"'
            return DeleteLightResponse(False, message)
        return DeleteLightResponse(True, f"DeleteLight: {name} successfully deleted")


def _no_light(what: str, request) -> str:
    """Say that there is no such light, as Gazebo does."""
    return f"{what}Properties: Requested light {request.light_name} not found!"


def _color(request, name: str) -> tuple[float, ...]:
    """Read a color."""
    color = getattr(request, name)
    return tuple(checked(name, [color.r, color.g, color.b, color.a]).tolist())
