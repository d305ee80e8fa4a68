"""Models without joints, read from PyBullet together."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np

from ..core.rotation import cross
from ..core.transform import IDENTITY, compose
from .body import Body
from .bullet import BulletClient


def is_rigid(bodies: Sequence[Body]) -> bool:
    """Tell whether a model, given by its bodies, has no joint and moves."""
    return all(body.is_free and not body.has_joints for body in bodies)


class RigidModels:
    """The models of a world of which each link keeps its place on a free body.

    A world has dozens of them, and most of the time that one takes is numpy's for each
    call, whatever the length of its arrays: so these hold all models, one behind the
    other.
    """

    def __init__(
        self, client: BulletClient, models: Sequence[Sequence[Body]] = ()
    ) -> None:
        """Prepare the arrays.

        Args:
            client: PyBullet.
            models: The bodies of each model; all of them are rigid.
        """
        self._client = client
        bodies = list(chain.from_iterable(models))
        self._numbers = [body.number for body in bodies]
        self._T_center_root = _stacked([body.T_center_root for body in bodies], 7)
        self._models = [model[0].model for model in models]
        self._roots = _slices([len(model.trees) for model in self._models])
        self._links = _slices([len(model.link_names) for model in self._models])
        self._T_root_link = _stacked(
            [pose for model in self._models for pose in model.placed_at(IDENTITY)], 7
        )
        self._root_of = np.zeros(len(self._T_root_link), dtype=int)
        for own, links, roots in zip(models, self._links, self._roots):
            for number, body in enumerate(own, roots.start):
                self._root_of[links.start + body.tree.links] = number
        self._speeds = np.zeros(0)

    def read(self) -> None:
        """Give all models the state that PyBullet has."""
        if not self._numbers:
            return
        pose_of = self._client.getBasePositionAndOrientation
        twist_of = self._client.getBaseVelocity
        centers = np.array([sum(pose_of(n), ()) for n in self._numbers])
        twists = np.array([sum(twist_of(n), ()) for n in self._numbers])
        roots = compose(centers, self._T_center_root)
        twists[:, :3] += cross(twists[:, 3:], roots[:, :3] - centers[:, :3])
        self._speeds = np.abs(twists)

        root_poses, link_twists = roots[self._root_of], twists[self._root_of]
        links = compose(root_poses, self._T_root_link)
        levers = links[:, :3] - root_poses[:, :3]
        link_twists[:, :3] += cross(link_twists[:, 3:], levers)
        for model, own_roots, own_links in zip(self._models, self._roots, self._links):
            model.take(
                roots[own_roots],
                twists[own_roots],
                links[own_links],
                link_twists[own_links],
            )

    @property
    def speed(self) -> float:
        """The greatest speed of a root when it was read, in [m/s] or [rad/s]."""
        return float(self._speeds.max(initial=0.0))


def _stacked(rows: Sequence[np.ndarray], width: int) -> np.ndarray:
    """Make an array of rows, of which there may be none."""
    return np.array(rows).reshape(-1, width)


def _slices(lengths: Sequence[int]) -> list[slice]:
    """Tell where parts of these lengths are that follow each other."""
    ends = np.cumsum([0, *lengths]).tolist()
    return [slice(begin, end) for begin, end in zip(ends, ends[1:])]
