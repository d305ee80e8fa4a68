"""Former names of the interface for Python: they work, with a DeprecationWarning."""

from __future__ import annotations

import warnings
from functools import wraps
from typing import Any, Callable, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])


def former(old: str, new: str) -> Any:
    """Return a property that is another attribute or method, such as its new name.

    Args:
        old: The former name with its class, for the warning.
        new: Name of the attribute.
    """

    def get(self: Any) -> Any:
        warn_of_former(old, new)
        return getattr(self, new)

    return property(get, doc=f"The former name of ``{new}``.")


def former_arguments(**renamed: str) -> Callable[[Function], Function]:
    """Let a function take keyword arguments by their former names, too.

    Args:
        renamed: New names by former ones.
    """

    def decorate(function: Function) -> Function:
        name = function.__qualname__.replace(".__init__", "")

        @wraps(function)
        def call(*args: Any, **given: Any) -> Any:
            for old, new in renamed.items():
                if old in given and new in given:
                    raise TypeError(f"{name}() got both {new} and {old}")
                if old in given:
                    warn_of_former(f"{name}({old}=...)", f"{new}=...")
                    given[new] = given.pop(old)
            return function(*args, **given)

        return call  # type: ignore[return-value]

    return decorate


def warn_of_former(old: str, new: str) -> None:
    """Warn the caller of the caller that something has a new name."""
    text = f"{old} is deprecated; use {new}"
    warnings.warn(text, DeprecationWarning, stacklevel=3)
