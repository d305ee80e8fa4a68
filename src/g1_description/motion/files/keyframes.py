"""Keyframes of a MuJoCo model in XML: ``<key time="0.1" qpos="..."/>``.

``qpos`` is x y z, quaternion w x y z, and the joints in the order of the model. Traps:

- Without ``time`` a key is at 0: such keys are poses, unless a rate is given.
- The model may be in another file, so that joints have no names.
- Objects and other joints may be in ``qpos``, too, in the order of the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from lxml import etree

from g1_description.errors import DescriptionError, MotionError, NoMotionError
from g1_description.files.xml import check_size, local_name, parse_xml
from g1_description.motion.files.conventions import base_of, names_of_columns
from g1_description.motion.files.format import Format
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.text import MAX_NAME, listed

SIZES = {"free": 7, "ball": 4, "slide": 1, "hinge": 1}
"""Numbers of a joint in ``qpos``."""


@dataclass(frozen=True)
class _Keys:
    """Keyframes of a model."""

    names: list[str]
    times: np.ndarray
    rows: list[str]
    """Each key's ``qpos``."""

    model: etree._Element

    @property
    def are_timed(self) -> bool:
        """Whether the keys are one motion."""
        return len(self.times) > 1 and bool((np.diff(self.times) > 0.0).all())


def recognise(source: MotionSource) -> bool:
    """Return whether a file is a model of MuJoCo."""
    return source.xml_root == "mujoco"


def names(source: MotionSource) -> Sequence[str]:
    """List the names of the keys, if these are poses without times."""
    keys = _keys(source)
    return [] if keys.are_timed or source.options.rate is not None else keys.names


def read(source: MotionSource, robot: Description) -> Motion:
    """Read all keys as one motion or, if they have no times, the one that is chosen.

    Raises:
        NoMotionError: If the model has no keyframes.
        MotionError: If none is chosen, or a key does not fit the robot.
    """
    keys = _keys(source)
    if keys.are_timed:
        return _motion(source, keys.rows, keys.times - keys.times[0], keys.model, robot)
    times = np.arange(float(len(keys.rows)))
    if source.options.rate is not None:
        motion = _motion(source, keys.rows, times, keys.model, robot)
        return replace(motion, has_times=False)
    if source.name is None and len(keys.rows) > 1:
        which = " that increase" if keys.times.any() else ""
        example = f"{source.path.name}#{keys.names[0][:MAX_NAME]}"
        raise MotionError(
            f"The keyframes have no times{which}. Give their rate to read them as one "
            f"motion, or choose one, such as '{example}': {listed(keys.names)}."
        )
    row = keys.rows[keys.names.index(source.chosen(keys.names))]
    return _motion(source, [row], times[:1], keys.model, robot)


def _keys(source: MotionSource) -> _Keys:
    """Read the keyframes."""
    text = source.text or ""
    try:
        check_size("The model", len(text))
        model = parse_xml("model", text)
    except DescriptionError as error:
        raise MotionError(str(error)) from error
    found = [key for key in model.iterfind("keyframe/key") if key.get("qpos")]
    if not found:
        raise NoMotionError("The model has no keyframes with qpos.")
    labels = [key.get("name") or str(n) for n, key in enumerate(found)]
    times = _numbers([key.get("time", "0") for key in found], 1, "time")
    return _Keys(labels, times[:, 0], [key.get("qpos") for key in found], model)


def _motion(
    source: MotionSource,
    rows: list[str],
    times: np.ndarray,
    model: etree._Element,
    robot: Description,
) -> Motion:
    """Make a motion of keys."""
    qpos = _numbers(rows, len(rows[0].split()), "qpos")
    columns, base, n_numbers = _columns(model, robot)
    notes: tuple[str, ...] = ()
    if columns:
        if qpos.shape[1] != n_numbers:
            raise MotionError(
                f"qpos has {qpos.shape[1]} numbers, but the joints of the model need "
                f"{n_numbers}."
            )
        joints, positions = tuple(columns), qpos[:, list(columns.values())]
    else:
        base, positions = 0, qpos[:, SIZES["free"] :]
        joints, notes = names_of_columns(source, positions, robot)
    motion = Motion(times, joints, positions, notes=notes)
    if base is None:
        return motion
    place, turn = qpos[:, base : base + 3], qpos[:, base + 3 : base + SIZES["free"]]
    return replace(motion, base_poses=base_of(place, turn, source.options.order))


def _columns(
    model: etree._Element, robot: Description
) -> tuple[dict[str, int], int | None, int]:
    """Find the joints in the model of the file.

    Returns:
        Columns of hinges and slides by name, none without a whole model; the first
        column of the base, a free joint, if there is one; and the number of columns.
    """
    found: dict[str, int] = {}
    free: dict[str, int] = {}
    at = 0
    if model.find(".//include") is not None:
        return found, None, at
    for element in model.iterfind("worldbody//*"):
        kind = {"freejoint": "free", "joint": element.get("type", "hinge")}.get(
            local_name(element), ""
        )
        if kind in ("hinge", "slide"):
            found[element.get("name") or f"joint {at}"] = at
        elif kind == "free":
            body = element.getparent()
            free[(None if body is None else body.get("name")) or f"body {at}"] = at
        at += SIZES.get(kind, 0)
    return found, free.get(robot.root, next(iter(free.values()), None)), at


def _numbers(rows: Sequence[str], width: int, label: str) -> np.ndarray:
    """Convert rows of text, shape (n, width)."""
    values = [row.split() for row in rows]
    if any(len(row) != width for row in values):
        raise MotionError(f"Each {label} must have {width} numbers, as the first one.")
    try:
        found = np.array(values, dtype=float)
    except ValueError:
        raise MotionError(f"{label} must contain numbers.") from None
    if not np.isfinite(found).all():
        raise MotionError(f"{label} must contain finite numbers.")
    return found


FORMAT = Format(
    "keyframes", recognise, read, (".xml",), order="wxyz", names=names, is_text=True
)
