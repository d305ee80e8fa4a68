"""Programs run in forks of the test's process, which has read their modules already."""

import os
import runpy
import subprocess
import sys
import tempfile
import traceback


def run_script(path, *arguments, environment=None, folder="."):
    """Run a Python script in a folder as `python3 SCRIPT` does; see ``run_forked``."""

    def main():
        os.chdir(folder)
        # In place: a default argument may be this very list.
        sys.argv[:] = [str(path), *map(str, arguments)]
        runpy.run_path(str(path), run_name="__main__")

    return run_forked(main, environment)


def run_forked(main, environment=None):
    """Run a program to its end, in a process of its own.

    Args:
        main: Function that is the program.
        environment: Its environment variables; by default those of this process.

    Returns:
        Its exit code and what it printed, a subprocess.CompletedProcess.
    """
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        child = os.fork()
        if not child:
            _become(main, environment, out, err)
        status = os.waitpid(child, 0)[1]
        code = os.WEXITSTATUS(status) if os.WIFEXITED(status) else -os.WTERMSIG(status)
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read())
    return subprocess.CompletedProcess(main, code, *texts)


def _become(main, environment, out, err):
    """Run the program in the child, which ends here."""
    code = 1
    try:
        if environment is not None:
            os.environ.clear()
            os.environ.update(environment)
        for number, file in ((1, out), (2, err)):
            os.dup2(file.fileno(), number)
        sys.stdin, sys.stdout, sys.stderr = _standard_streams()
        code = _exit_code(main)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _standard_streams():
    """Open what pytest has put something else in the place of."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    return os.fdopen(nothing), os.fdopen(1, "w"), os.fdopen(2, "w")


def _exit_code(main):
    """Run a function and end as Python does."""
    try:
        main()
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        print(end.code, file=sys.stderr)
        return 1
    except BaseException:
        traceback.print_exc()
        return 1
    return 0
