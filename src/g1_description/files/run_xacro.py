"""A program that expands a xacro file to URDF, or prints an error.

It runs in a separate process because xacro has global state and may raise any
exception. ROS' xacro is used if it is installed. PyPI's xacro finds packages through
ROS 2's ament_index_python, which is replaced here.
"""

from __future__ import annotations

import sys
from types import ModuleType

from g1_description.files.model_files import find_folder


class Arguments(dict):
    """Arguments that record which of them are used."""

    def __init__(self, words: list[str]) -> None:
        super().__init__(word.split(":=", 1) for word in words)
        self.unused = set(self)

    def __contains__(self, name: object) -> bool:
        """Record and return whether an argument is given."""
        self.unused.discard(name)  # type: ignore[arg-type]
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        """Record and return an argument's value."""
        self.unused.discard(name)
        return super().__getitem__(name)


def package_folder(name: str) -> str:
    """Return the folder of ``$(find NAME)``.

    Raises:
        LookupError: If there is no such package.
    """
    folder = find_folder(name)
    if folder is None:
        raise LookupError(f"There is no package {name}")
    return folder


def answer_for_ros_2() -> None:
    """Replace ROS 2's package index by that of ROS 1."""
    index = ModuleType("ament_index_python")
    packages = ModuleType("ament_index_python.packages")
    packages.get_package_share_directory = package_folder  # type: ignore[attr-defined]
    sys.modules.update({index.__name__: index, packages.__name__: packages})


def sentence(error: Exception, file: str) -> str:
    """Format an error of xacro, with its file."""
    cause = getattr(error, "exc", None)
    # For errors in substitutions, xacro prints the class, and everything twice.
    shown = cause if str(error).startswith("<class ") and cause else error
    lines = (line.strip() for line in str(shown).splitlines())
    text = " ".join(line for line in lines if not line.startswith("ROS path"))
    return f"xacro: {text or repr(error)} (in {file})."


def main() -> None:
    """Print URDF for the file and the arguments of the command line."""
    answer_for_ros_2()
    try:
        import xacro
    except ImportError:
        print("xacro is not installed: pip install xacro.")
        sys.exit(1)
    file, arguments = sys.argv[1], Arguments(sys.argv[2:])
    try:
        document = xacro.process_file(file, mappings=arguments)
    except Exception as error:  # xacro evaluates Python and may raise anything
        print(sentence(error, (xacro.filestack or [file])[-1]))
        sys.exit(1)
    if arguments.unused:
        names = " or ".join(sorted(arguments.unused))
        print(f"Ignored: {file} has no argument {names}.", file=sys.stderr)
    sys.stdout.buffer.write(document.toprettyxml(indent="  ").encode("utf-8"))


if __name__ == "__main__":
    main()
