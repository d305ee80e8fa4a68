"""The page in a browser, and the node web."""

from . import old_libraries as _old_libraries  # noqa: F401  before anything imports viser
