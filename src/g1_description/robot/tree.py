"""The tree of links and joints: its roots, and traversals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol, TypeVar

from g1_description.errors import DescriptionError


class Named(Protocol):
    """A link, as required by a tree."""

    @property
    def name(self) -> str:
        """Name of the link or joint."""


class Edge(Named, Protocol):
    """A joint, as required by a tree."""

    @property
    def parent(self) -> str:
        """Name of the parent link."""

    @property
    def child(self) -> str:
        """Name of the child link."""


_Edge = TypeVar("_Edge", bound=Edge)


def one_root(name: str, links: Sequence[Named], joints: Sequence[Edge]) -> str:
    """Find the root link, and check that the joints make one tree.

    Args:
        name: Name of the robot, for messages.
        links: All links.
        joints: All joints.

    Returns:
        Name of the only link without a parent joint.

    Raises:
        DescriptionError: If a name is used twice, a link does not exist, or there is
            not exactly one tree.
    """
    roots = find_roots(name, links, joints)
    if len(roots) > 1:
        found = " and ".join(roots[:3])
        found += f" and {len(roots) - 3} more" if len(roots) > 3 else ""
        raise DescriptionError(f"Robot '{name}' must have one root link (got {found}).")
    return roots[0]


def find_roots(
    name: str, links: Sequence[Named], joints: Sequence[Edge]
) -> tuple[str, ...]:
    """Find the root links, and check that the joints make trees.

    Args:
        name: Name of the robot, for messages.
        links: All links.
        joints: All joints.

    Returns:
        Names of the links without a parent joint, in the order of the file.

    Raises:
        DescriptionError: If a name is used twice, a link does not exist, or joints form
            a loop.
    """
    names = {link.name for link in links}
    for kind, listed in (("link", links), ("joint", joints)):
        counts = Counter(entry.name for entry in listed)
        if not all(counts):
            raise DescriptionError(f"Robot '{name}' has a {kind} without a name.")
        twice = [entry for entry, count in counts.items() if count > 1]
        if twice:
            raise DescriptionError(f"Robot '{name}' has two {kind}s called {twice[0]}.")
    carrier: dict[str, str] = {}
    for joint in joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in names:
                raise DescriptionError(
                    f"Joint {joint.name} of robot '{name}' refers to the {role} link "
                    f"{link}, which does not exist."
                )
        if joint.child in carrier:
            raise DescriptionError(
                f"Link {joint.child} of robot '{name}' is the child of two joints, "
                f"{carrier[joint.child]} and {joint.name}."
            )
        carrier[joint.child] = joint.name
    roots = tuple(link.name for link in links if link.name not in carrier)
    if not roots:
        why = "it has no links"
        if links:
            why = f"its joints form a loop: {_loop(links[0].name, joints)}"
        raise DescriptionError(
            f"Robot '{name}' must have one root link, but has none ({why})."
        )
    reached = {*roots, *(joint.child for joint in below(roots, joints))}
    loose = [link.name for link in links if link.name not in reached]
    if loose:
        raise DescriptionError(
            f"Robot '{name}' has a loop of joints: {_loop(loose[0], joints)}; it is "
            f"not below {roots[0]}."
        )
    return roots


def _loop(link: str, joints: Sequence[Edge]) -> str:
    """List the links of the loop above a link."""
    parents = {joint.child: joint.parent for joint in joints}
    walked: dict[str, None] = {}
    while link not in walked:
        walked[link] = None
        link = parents[link]
    names = list(walked)
    loop = names[names.index(link) :]
    more = f" and {len(loop) - 5} more" if len(loop) > 5 else ""
    return f"{', '.join(reversed(loop[:5]))}{more}"


def depth_first(root: str, joints: Sequence[Edge]) -> Iterator[str]:
    """Traverse a tree as urdfdom does: the joints of a link by name.

    Args:
        root: Link to start from.
        joints: All joints.

    Yields:
        The root and the links below it, each before its children.
    """
    hanging: dict[str, list[Edge]] = {}
    for joint in sorted(joints, key=lambda joint: joint.name, reverse=True):
        hanging.setdefault(joint.parent, []).append(joint)
    stack = [root]
    while stack:
        link = stack.pop()
        yield link
        stack.extend(joint.child for joint in hanging.get(link, ()))


def below(roots: Iterable[str], joints: Sequence[_Edge]) -> Iterator[_Edge]:
    """Traverse trees; each joint comes after its parent joint.

    Args:
        roots: Links to start from.
        joints: All joints.

    Yields:
        The joints below the roots.
    """
    hanging: dict[str, list[_Edge]] = {}
    for joint in joints:
        hanging.setdefault(joint.parent, []).append(joint)
    links = [*roots]
    for link in links:
        for joint in hanging.get(link, ()):
            links.append(joint.child)
            yield joint
