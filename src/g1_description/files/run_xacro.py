"""A program that prints a xacro file as URDF, or one sentence why not.

It is a process of its own because xacro keeps what it read in its module, and
because any exception can come out of it. ROS' xacro is used where it is installed;
that of PyPI is as new, but asks ROS 2 where packages are, so it is answered here.
"""

from __future__ import annotations

import sys
from types import ModuleType

from g1_description.files.model_files import find_folder


class Arguments(dict):
    """Arguments that remember which of them a file asks for."""

    def __init__(self, words: list[str]) -> None:
        super().__init__(word.split(":=", 1) for word in words)
        self.unused = set(self)

    def __contains__(self, name: object) -> bool:
        """Return whether an argument is given."""
        self.unused.discard(name)  # type: ignore[arg-type]
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        """Give an argument's value."""
        self.unused.discard(name)
        return super().__getitem__(name)


def package_folder(name: str) -> str:
    """Give the folder of ``$(find NAME)``.

    Raises:
        LookupError: If there is no such package.
    """
    folder = find_folder(name)
    if folder is None:
        raise LookupError(f"There is no package {name}")
    return folder


def answer_for_ros_2() -> None:
    """Answer in the place of ROS 2 where packages are: in this process it is ROS 1."""
    index = ModuleType("ament_index_python")
    packages = ModuleType("ament_index_python.packages")
    packages.get_package_share_directory = package_folder  # type: ignore[attr-defined]
    sys.modules.update({index.__name__: index, packages.__name__: packages})


def sentence(error: Exception, file: str) -> str:
    """Say what xacro found, and in which file."""
    cause = getattr(error, "exc", None)
    # xacro reports the class of an error in a substitution, and everything twice.
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
        print("xacro is not installed; it is in requirements.txt.")
        sys.exit(1)
    file, arguments = sys.argv[1], Arguments(sys.argv[2:])
    try:
        document = xacro.process_file(file, mappings=arguments)
    except Exception as error:  # xacro evaluates Python: anything can come out of it
        print(sentence(error, (xacro.filestack or [file])[-1]))
        sys.exit(1)
    if arguments.unused:
        names = " or ".join(sorted(arguments.unused))
        print(f"{file} has no argument {names}, which is ignored.", file=sys.stderr)
    sys.stdout.buffer.write(document.toprettyxml(indent="  ").encode("utf-8"))


if __name__ == "__main__":
    main()
