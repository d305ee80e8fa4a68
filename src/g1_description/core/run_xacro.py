"""A program that prints a xacro file as URDF, or one sentence why not.

It is a process of its own because xacro keeps what it read in its module, and
because any exception can come out of it. ROS' xacro is used where it is installed.
"""

from __future__ import annotations

import sys


class Arguments(dict):
    """Arguments that remember which of them a file asks for."""

    def __init__(self, words: list[str]) -> None:
        """Read ``NAME:=VALUE`` words."""
        super().__init__(word.split(":=", 1) for word in words)
        self.unused = set(self)

    def __contains__(self, name: object) -> bool:
        """Tell whether an argument is given."""
        self.unused.discard(name)  # type: ignore[arg-type]
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        """Give an argument's value."""
        self.unused.discard(name)
        return super().__getitem__(name)


def sentence(error: Exception, file: str) -> str:
    """Say what xacro found, and in which file."""
    lines = (line.strip() for line in str(error).splitlines())
    told = " ".join(line for line in lines if not line.startswith("ROS path"))
    return f"xacro: {told or repr(error)} (in {file})."


def main() -> None:
    """Print URDF for the file and the arguments of the command line."""
    try:
        import xacro
    except ImportError:
        print("xacro is not installed; it is in requirements.txt.")
        sys.exit(1)
    file, arguments = sys.argv[1], Arguments(sys.argv[2:])
    try:
        document = xacro.process_file(file, mappings=arguments)
    except Exception as error:
        print(sentence(error, (xacro.filestack or [file])[-1]))
        sys.exit(1)
    if arguments.unused:
        print(f"{file} has no argument {' or '.join(sorted(arguments.unused))}.")
        sys.exit(1)
    sys.stdout.buffer.write(document.toprettyxml(indent="  ").encode("utf-8"))


if __name__ == "__main__":
    main()
