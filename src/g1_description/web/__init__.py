"""The browser view: what is shown, and what a person does with it; no ROS."""

from . import old_libraries as _old_libraries  # noqa: F401  before anything imports viser
