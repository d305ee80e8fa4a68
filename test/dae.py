"""COLLADA files of boxes, written as simply as the format allows."""

from __future__ import annotations

import numpy as np

FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4]]
FACES += [[1, 5, 7, 3]]


def box(name, size, material=""):
    """Write a geometry: a box about its origin, of six quadrilaterals."""
    corners = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * size
    numbers = " ".join(map(repr, corners.ravel().tolist()))
    named = f' material="{material}"' if material else ""
    indices = " ".join(str(index) for face in FACES for index in face)
    return (
        f'<geometry id="{name}"><mesh><source id="{name}-p">'
        f'<float_array id="{name}-a" count="24">{numbers}</float_array>'
        f'<technique_common><accessor source="#{name}-a" count="8" stride="3">'
        '<param name="X" type="float"/><param name="Y" type="float"/>'
        '<param name="Z" type="float"/></accessor></technique_common></source>'
        f'<vertices id="{name}-v"><input semantic="POSITION" source="#{name}-p"/>'
        f'</vertices><polylist count="6"{named}>'
        f'<input semantic="VERTEX" source="#{name}-v" offset="0"/>'
        f"<vcount>4 4 4 4 4 4</vcount><p>{indices}</p></polylist></mesh></geometry>"
    )


def node(inside, transform=""):
    """Write a node of the scene."""
    return f"<node>{transform}{inside}</node>"


def use(name, material=""):
    """Write a use of a geometry."""
    bound = (
        "<bind_material><technique_common>"
        f'<instance_material symbol="{material}" target="#{material}"/>'
        "</technique_common></bind_material>"
    )
    instance = f'<instance_geometry url="#{name}">{bound if material else ""}'
    return f"{instance}</instance_geometry>"


def collada(geometries, nodes, *, meter="1", up="Z_UP", colors=()):
    """Write a file; its colors are pairs of a material's name and four numbers."""
    effects = "".join(
        f'<effect id="{name}-e"><profile_COMMON><technique sid="t"><lambert><diffuse>'
        f"<color>{color}</color></diffuse></lambert></technique></profile_COMMON>"
        "</effect>"
        for name, color in colors
    )
    materials = "".join(
        f'<material id="{name}"><instance_effect url="#{name}-e"/></material>'
        for name, _ in colors
    )
    return (
        '<?xml version="1.0" encoding="utf-8"?>'
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" '
        f'version="1.4.1"><asset><unit meter="{meter}"/><up_axis>{up}</up_axis>'
        f"</asset><library_effects>{effects}</library_effects>"
        f"<library_materials>{materials}</library_materials>"
        f"<library_geometries>{''.join(geometries)}</library_geometries>"
        f'<library_visual_scenes><visual_scene id="s">{"".join(nodes)}</visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>'
        "</COLLADA>"
    )
