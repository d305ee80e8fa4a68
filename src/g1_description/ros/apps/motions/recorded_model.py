"""Which model of the simulator is the robot that is recorded."""

from __future__ import annotations

from collections.abc import Sequence

from g1_description.core.errors import UnknownNameError
from g1_description.core.robot.assembly import SCOPE
from g1_description.core.robot.description import Description
from g1_description.core.text import listed


class SeveralModelsError(UnknownNameError):
    """Several models may be meant."""


def find_model(links: Sequence[str], robot: Description, namespace: str) -> str:
    """Find the model whose links are the robot's.

    Args:
        links: Scoped names of all links of the simulator.
        robot: The robot.
        namespace: Namespace of its topics; of several models the one of that name is
            taken.

    Returns:
        The model's name.

    Raises:
        SeveralModelsError: If there are several.
        UnknownNameError: If there is none.
    """
    own, counts = {*robot.link_names}, {}
    for name in links:
        model, _, link = name.rpartition(SCOPE)
        counts[model] = counts.get(model, 0) + (link in own)
    most = max(counts.values(), default=0)
    found = [model for model, count in counts.items() if count == most and most]
    if namespace in found:
        return namespace
    if len(found) == 1:
        return found[0]
    error, what = UnknownNameError, f"only {listed(counts) or 'nothing'}"
    if found:
        error = SeveralModelsError
        what = f"several such, {listed(found)}: --model names one"
    raise error(
        f"The simulator has no single model with links of '{robot.name}' but {what}."
    )
