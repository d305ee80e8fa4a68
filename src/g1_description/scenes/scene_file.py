"""Scenes in files: YAML for people, or SDF as Gazebo reads it."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations_with_replacement
from pathlib import Path
from textwrap import indent
from typing import Any

import numpy as np
from lxml import etree

from g1_description.errors import G1DescriptionError, SceneError
from g1_description.files.atomic import write_whole
from g1_description.files.model_files import find_folder, find_model
from g1_description.files.uris import local_path
from g1_description.files.yaml import YamlError, parse_yaml, read_yaml
from g1_description.robot.assembly import SCOPE, Assembly
from g1_description.robot.description import Link, Shape
from g1_description.robot.rotation import axes_to_rpy, to_axes
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.robot.urdf import parse_urdf
from g1_description.scenes.moveit import scene_text
from g1_description.scenes.objects import (
    COLOR,
    SIZES,
    Attachment,
    SceneObject,
    attached,
    described_object,
    inertial_of,
    mesh_uri,
    model_objects,
    names_touching,
    object_pose,
    simple_shape,
)
from g1_description.sdf.document import BUILT_IN
from g1_description.sdf.link import MAY_TOUCH, PREFIX
from g1_description.sdf.world import read_sdf
from g1_description.sim.model import Model
from g1_description.text import listed, similar_first

SECTIONS = {
    "boxes": "box",
    "cylinders": "cylinder",
    "spheres": "sphere",
    "planes": "plane",
    "meshes": "mesh",
}
"""Sections of a YAML file, and their kinds of shapes."""

MODELS, ATTACH = "models", "attach"
"""Sections of models from files, and of attachments."""

SDF_ENDINGS = (".sdf", ".world")
"""Endings of files of SDF."""

IGNORED = re.compile(" is ignored| in collision ")
"""Messages on parts of a file that are no sensors, plugins or the like."""

TAGS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "plane": ("normal",),
    "mesh": ("scale",),
}
"""Elements of sizes in SDF."""


PLAIN = re.compile(r"[A-Za-z_]\w*", re.ASCII)
"""Texts that YAML has without quotes, but for ``WORDS``."""

WORDS = ("true", "false", "null", "yes", "no", "on", "off", "y", "n")


def scene_of(motion: Path) -> Path:
    """Return the file of the scene that belongs to the file of a motion."""
    return motion.with_name(f"{motion.stem}.scene.yaml")


def scene_next_to(motion: Path) -> Path | None:
    """Find the scene of a motion: ``NAME.scene.yaml`` next to ``NAME.csv``."""
    if not motion.is_file():  # but a folder of motions
        return None
    file = scene_of(motion)
    return file if file.is_file() else None


def read_objects(file: Path) -> tuple[list[SceneObject], tuple[str, ...]]:
    """Read objects, and messages on ignored parts; see ``Scene.read``."""
    path = file.expanduser().absolute()
    notes: dict[str, None] = {}
    try:
        if path.suffix.lower() in SDF_ENDINGS:
            models = _models_of_sdf(find_model(str(path)), notes)
            found = [each for model in models for each in model_objects(model)]
        else:
            content = read_yaml(path)
            if content is None:
                raise SceneError("it is empty.")
            found = _from_yaml(_mapping("the file", content), path.parent, notes)
        for each in found:
            for shape in (*each.link.collisions, *each.link.visuals):
                if shape.kind == "mesh":
                    mesh_uri(each.name, shape.filename)
        return found, tuple(notes)
    except YamlError as error:
        raise SceneError(f"The scene {file} cannot be used: {error}.") from error
    except G1DescriptionError as error:
        raise SceneError(f"The scene {file} cannot be used: {error}") from error


def _models_of_sdf(text: str, notes: dict[str, None]) -> list[Model]:
    """Read the models of an SDF document; add messages on ignored parts."""
    content = read_sdf(text, find_model)
    messages = [*content.left_out]
    for model in content.models:
        messages += [f"{model.name}: {m}" for m in model.assembly.left_out]
    notes.update(dict.fromkeys(filter(IGNORED.search, messages)))
    return [Model(m.name, m.assembly, m.pose) for m in content.models]


def objects_of_yaml(text: str) -> list[SceneObject]:
    """List the objects of a text in YAML.

    Raises:
        G1DescriptionError: If it is not a scene.
    """
    content = parse_yaml(text.encode("utf-8", "surrogateescape"))
    return _from_yaml(_mapping("the scene", content), Path(), {})


def _from_yaml(
    content: Mapping[str, Any], folder: Path, notes: dict[str, None]
) -> list[SceneObject]:
    """Read the sections of a file; paths begin at its folder."""
    known = (*SECTIONS, MODELS, ATTACH)
    found: list[SceneObject] = []
    for section, given in content.items():
        if section not in known:
            raise SceneError(
                f"Unknown section '{section}'. Known sections: {listed(known)}."
            )
        for name, value in _mapping(section, given).items():
            if section == MODELS:
                options = dict(_mapping(name, value))
                found += _model(str(name), options, folder, notes)
            elif section != ATTACH:
                options = dict(_mapping(name, value))
                found.append(_shape_of(section, str(name), options, folder))
    numbers = {each.name: number for number, each in enumerate(found)}
    for name, given in _mapping(ATTACH, content.get(ATTACH)).items():
        name = str(name)
        if name not in numbers:
            raise SceneError(
                f"Unknown object '{name}' in {ATTACH}. Known objects: "
                f"{listed(similar_first(str(name), numbers)) or 'none'}."
            )
        for one in given if isinstance(given, list) else [given]:
            options = dict(_mapping(f"{ATTACH}: {name}", one))
            link = options.pop("link", None)
            times = {"from": -np.inf, "until": np.inf, **options}
            if not isinstance(link, str) or len(times) > 2:
                raise SceneError(
                    f"{ATTACH}: {name} must have a link, and may have the times from "
                    f"and until in s (got {str(one)[:80]})."
                )
            row = numbers[name]
            found[row] = attached(found[row], link, times["from"], times["until"])
    return found


def _mapping(what: object, given: object) -> Mapping[str, Any]:
    """Return a mapping; nothing is an empty one."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise SceneError(
            f"{what} must be a mapping, such as name: {{...}} (got {str(given)[:80]})."
        )
    return given


def _shape_of(
    section: str, name: str, options: dict[str, Any], folder: Path
) -> SceneObject:
    """Read an object of one shape."""
    kind = SECTIONS[section]
    missing = [key for key in (*SIZES[kind], "at") if key not in options]
    if missing:
        raise SceneError(f"{name} in {section} has no {listed(missing)}.")
    if kind == "mesh":
        options["file"] = _path(options["file"], folder)
    return described_object(kind, name, _place(options), options)


def _place(options: dict[str, Any]) -> Any:
    """Take a place, with its quaternion, from options."""
    at = options.pop("at", [0.0, 0.0, 0.0])
    if "rpy" in options and "quaternion" in options:
        raise SceneError("An object has rpy or quaternion, not both.")
    turn = options.pop("quaternion", None)
    both = isinstance(at, list) and isinstance(turn, list)
    return [*at, *turn] if both else at


def _path(given: object, folder: Path) -> str:
    """Return a URI, or a path from the folder of the scene."""
    text = str(given)
    return text if "://" in text else str(folder / Path(text).expanduser())


def _model(
    name: str, options: dict[str, Any], folder: Path, notes: dict[str, None]
) -> Iterator[SceneObject]:
    """Read the links of a model of SDF or URDF, from a file or in the text."""
    keys = ("file", "sdf", "at", "rpy", "quaternion", "may_touch")
    unknown = [key for key in options if key not in keys]
    if unknown or ("file" in options) == ("sdf" in options):
        raise SceneError(
            f"{name} in {MODELS} must have a file or sdf, and may have at, rpy or "
            f"quaternion, and may_touch (got {listed(options)})."
        )
    file = _path(options["file"], folder) if "file" in options else ""
    text = BUILT_IN.get(file) or find_model(file) if file else str(options["sdf"])
    pose = object_pose(name, _place(options), options.get("rpy"))
    if "<robot" in text[:2000]:
        robot = parse_urdf(text)
        notes.update(dict.fromkeys(f"{name}: {m}" for m in robot.unread))
        models = [Model(name, Assembly(robot), pose)]
    else:
        read = _models_of_sdf(text, notes)
        models = [
            Model(
                name if len(read) == 1 else name + SCOPE + model.name,
                model.assembly,
                compose(pose, model.pose),
            )
            for model in read
        ]
    touching = names_touching(name, options.get("may_touch"))
    for model in models:
        for each in model_objects(model):
            yield replace(each, may_touch=each.may_touch | touching)


def write_objects(objects: Collection[SceneObject], file: Path) -> None:
    """Write a scene; see ``Scene.save``."""
    if file.suffix.lower() in SDF_ENDINGS:
        carried = [each.name for each in objects if each.attachments]
        if carried:
            raise SceneError(
                f"SDF has no attachments, which {listed(carried)} has. Save the scene "
                "as .yaml."
            )
        write_whole(file, sdf_of(objects).encode("utf-8"))
        return
    is_for_moveit = file.suffix.lower() == ".scene"
    text = scene_text(objects) if is_for_moveit else yaml_of(objects)
    write_whole(file, text.encode("utf-8"))


def yaml_of(objects: Iterable[SceneObject]) -> str:
    """Write objects in YAML, each in a line but for those of SDF."""
    sections: dict[str, list[str]] = {}
    held: list[str] = []
    kinds = {kind: section for section, kind in SECTIONS.items()}
    for each in objects:
        name, shape = _text(each.name), _simple(each)
        keys = _keys(each, shape)
        if shape is not None:
            line = f"  {name}: {_text(keys)}"
            sections.setdefault(kinds[shape.kind], []).append(line)
        else:
            lines = [f"    {key}: {_text(value)}" for key, value in keys.items()]
            own = replace(each, pose=IDENTITY, may_touch=frozenset())
            text = indent(sdf_of([own]), 6 * " ").rstrip()
            some = sections.setdefault(MODELS, [])
            some += [f"  {name}:", *lines, "    sdf: |", text]
        times = [_times(one) for one in each.attachments]
        if times:
            held.append(f"  {name}: {_text(times if len(times) > 1 else times[0])}")
    if held:
        sections[ATTACH] = held
    whole = [line for name, some in sections.items() for line in (f"{name}:", *some)]
    return "\n".join([*whole, ""]) if whole else "{}\n"


def _times(one: Attachment) -> dict[str, Any]:
    """Write an attachment, without times that are infinite."""
    given = {"link": one.link, "from": one.begin, "until": one.end}
    return {k: v for k, v in given.items() if v not in (-np.inf, np.inf)}


def _text(value: Any) -> str:
    """Write a value in a line of YAML, numbers to twelve digits."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key}: {_text(one)}' for key, one in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, str):
        is_plain = PLAIN.fullmatch(value) and value.lower() not in WORDS
        return value if is_plain else json.dumps(value, ensure_ascii=False)
    short = np.float32(value)  # as pages have it
    text = str(short) if float(short) == value else f"{value:.12g}"
    mantissa, is_scaled, power = text.partition("e")
    return text if not is_scaled or "." in mantissa else f"{mantissa}.0e{power}"


def _simple(each: SceneObject) -> Shape | None:
    """Return the shape of an object that YAML describes by its sizes; None: by SDF."""
    shape, own = simple_shape(each), each.link.inertial
    if shape is None or shape.kind not in SIZES or each.link.gravity is False:
        return None
    surface = shape.friction, shape.restitution
    if shape.color is None or surface != (None, None):
        return None
    if shape.kind == "mesh" and local_path(shape.filename, find_folder) is None:
        return None
    usual = inertial_of(each.name, shape, each.mass)
    if own is None or usual is None:
        return shape
    is_usual = np.allclose(own.inertia, usual.inertia, 1e-6, 0.0)
    return shape if is_usual and not own.center_of_mass.any() else None


def _keys(each: SceneObject, shape: Shape | None) -> dict[str, Any]:
    """List the keys of an object, but for SDF."""
    found: dict[str, Any] = {}
    if shape is not None:
        names = SIZES[shape.kind]
        found = dict(zip(names, shape.size))
        if shape.kind == "mesh":
            found = {"file": shape.filename, "scale": [*shape.size]}
        elif len(shape.size) > len(names):
            found = {key: [*shape.size] for key in names}
    found["at"] = each.pose[:3].tolist()
    if not np.allclose(each.pose[3:], IDENTITY[3:], 0.0, 1e-12):
        found["quaternion"] = each.pose[3:].tolist()
    if shape is not None and each.mass is not None:
        found["mass"] = each.mass
    if shape is not None and shape.color != COLOR:
        found["color"] = [*(shape.color or COLOR)]
    if each.may_touch:
        found["may_touch"] = sorted(each.may_touch)
    return found


def sdf_of(objects: Collection[SceneObject]) -> str:
    """Write objects as an SDF world: a model of one link for each object.

    An object without mass is static.
    """
    root = etree.Element("sdf", version="1.6")
    world = etree.SubElement(root, "world", name="default")
    for each in objects:
        _pose(_model_of(world, each.name, {"link": each}, each.pose), each.pose)
    return etree.tostring(root, pretty_print=True, encoding="unicode")


def sdf_model(name: str, links: Mapping[str, SceneObject], pose: np.ndarray) -> str:
    """Write objects as the links of an SDF model, static if none has a mass.

    Args:
        name: Name of the model.
        links: Objects by the names of their links.
        pose: Pose of the model in the map, shape (7,), which is not written.
    """
    root = etree.Element("sdf", version="1.6")
    _model_of(root, name, links, pose)
    return etree.tostring(root, pretty_print=True, encoding="unicode")


def _model_of(
    root: etree._Element, name: str, links: Mapping[str, SceneObject], pose: np.ndarray
) -> etree._Element:
    """Write a model at a pose in the map, but not the pose."""
    model = etree.SubElement(root, "model", name=name)
    is_static = all(each.mass is None for each in links.values())
    etree.SubElement(model, "static").text = str(is_static).lower()
    for own, each in links.items():
        link = etree.SubElement(model, "link", name=own)
        for other in sorted(each.may_touch):
            etree.SubElement(link, MAY_TOUCH, nsmap=PREFIX).text = other
        if not np.array_equal(each.pose, pose):
            _pose(link, compose(inverse(pose), each.pose))
        _link(link, each.link)
    return model


def _link(element: etree._Element, link: Link) -> None:
    """Write gravity, mass and shapes of a link."""
    if not link.has_gravity:
        etree.SubElement(element, "gravity").text = "false"
    if link.inertial is not None:
        inertial = etree.SubElement(element, "inertial")
        etree.SubElement(inertial, "mass").text = repr(link.inertial.mass)
        _pose(inertial, np.concatenate([link.inertial.center_of_mass, IDENTITY[3:]]))
        inertia = etree.SubElement(inertial, "inertia")
        for row, column in combinations_with_replacement(range(3), 2):
            tag = "i" + "xyz"[row] + "xyz"[column]
            value = float(link.inertial.inertia[row, column])
            etree.SubElement(inertia, tag).text = repr(value)
    for kind, shapes in (("collision", link.collisions), ("visual", link.visuals)):
        for number, shape in enumerate(shapes):
            name = shape.name or kind
            own = f"{name}_{number}" if number else name
            _shape(etree.SubElement(element, kind, name=own), shape)


def _shape(element: etree._Element, shape: Shape) -> None:
    """Write where a shape is, its sizes, its colour and its friction."""
    _pose(element, shape.pose)
    holder = etree.SubElement(element, "geometry")
    geometry = etree.SubElement(holder, shape.kind)
    if shape.kind == "mesh":
        etree.SubElement(geometry, "uri").text = shape.filename
    tags = TAGS[shape.kind]
    sizes = [[value] for value in shape.size] if len(tags) > 1 else [[*shape.size]]
    for tag, values in zip(tags, sizes):
        etree.SubElement(geometry, tag).text = " ".join(map(repr, map(float, values)))
    if element.tag == "visual" and shape.color is not None:
        color = " ".join(f"{part:.6g}" for part in shape.color)
        material = etree.SubElement(element, "material")
        for tag in ("ambient", "diffuse"):
            etree.SubElement(material, tag).text = color
    if element.tag == "collision":
        _surface(element, shape)


def _surface(element: etree._Element, shape: Shape) -> None:
    """Write friction and restitution of a collision."""
    given = (
        ("friction/ode/mu", shape.friction),
        ("bounce/restitution_coefficient", shape.restitution),
    )
    for path, value in given:
        if value is not None:
            holder = element.find("surface")
            holder = etree.SubElement(element, "surface") if holder is None else holder
            for tag in path.split("/"):
                holder = etree.SubElement(holder, tag)
            holder.text = repr(value)


def _pose(element: etree._Element, pose: np.ndarray) -> None:
    """Write a pose as x y z and roll, pitch, yaw."""
    if np.array_equal(pose, IDENTITY):
        return
    rpy = axes_to_rpy(to_axes(pose[3:]))
    text = " ".join(repr(float(part)) for part in (*pose[:3], *rpy))
    etree.SubElement(element, "pose").text = text
