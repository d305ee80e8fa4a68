"""The engines by name, and which of them are installed."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

from g1_description.choices import ENGINES
from g1_description.errors import UnknownNameError, cause
from g1_description.libraries import missing
from g1_description.sim.engine import Engine


def fastest_engine() -> str:
    """Return the fastest engine whose library is installed.

    Without any it is MuJoCo, which has wheels for every Python.
    """
    only_bullet = find_spec("pybullet") and not find_spec("mujoco")
    return "bullet" if only_bullet else "mujoco"


def engine_class(name: str) -> type[Engine]:
    """Import an engine.

    Args:
        name: One of ``ENGINES``.

    Raises:
        UnknownNameError: If there is no such engine, or its library is not installed
            or broken.
    """
    if name not in ENGINES:
        raise UnknownNameError(
            f"Unknown engine '{name}'; must be one of {', '.join(ENGINES)}."
        )
    # Imported on use: its library loads slowly.
    try:
        module = import_module(f"g1_description.sim.{name}.engine")
    except ImportError as error:
        why = f"The library of the engine {name} is broken: {cause(error)}."
        if isinstance(error, ModuleNotFoundError):
            why = missing(f"The engine {name}", error)
        raise UnknownNameError(why) from error
    found: type[Engine] = getattr(module, f"{name.title()}Engine")
    return found
