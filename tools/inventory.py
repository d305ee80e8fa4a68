"""Lists what libraries offer: modules, classes, functions, and names of parameters.

Run by an old Python with old libraries as ``python inventory.py FILE``; tools/old_names
does. Tests read the file, and list by the same functions what is installed now.
"""

import importlib
import inspect
import json
import re
import sys
import warnings

LIBRARIES = ("numpy", "scipy")
STANDARD = (
    *(
        "argparse",
        "array",
        "ast",
        "asyncio",
        "base64",
        "builtins",
        "bz2",
        "collections",
    ),
    *("collections.abc", "concurrent.futures", "concurrent.futures.process"),
    *("contextlib", "copy", "csv", "ctypes", "ctypes.util", "html.parser"),
    *(
        "dataclasses",
        "difflib",
        "enum",
        "fnmatch",
        "functools",
        "gc",
        "gzip",
        "hashlib",
    ),
    *("hmac", "html", "http", "http.client", "http.server", "importlib.metadata"),
    *("importlib.util", "inspect", "io", "ipaddress", "itertools", "json", "logging"),
    *("logging.handlers", "math", "multiprocessing", "operator", "os", "os.path"),
    *("pathlib", "pickle", "platform", "queue", "random", "re", "resource", "secrets"),
    *("select", "shlex", "shutil", "signal", "socket", "socketserver", "stat"),
    *("statistics", "string", "struct", "subprocess", "sys", "tempfile", "textwrap"),
    *("threading", "time", "traceback", "types", "typing", "unittest", "unittest.mock"),
    *(
        "urllib.parse",
        "urllib.request",
        "uuid",
        "warnings",
        "weakref",
        "xml.etree.ElementTree",
    ),
    *("xmlrpc.client", "xmlrpc.server", "zipfile", "zlib"),
)
"""Modules of Python itself that are listed as well."""
PUBLIC = (
    *("numpy", "numpy.fft", "numpy.linalg", "numpy.random", "numpy.testing"),
    *("numpy.lib.format", "numpy.lib.recfunctions", "numpy.lib.stride_tricks"),
    *("scipy", "scipy.cluster.vq", "scipy.integrate", "scipy.interpolate"),
    *("scipy.linalg", "scipy.ndimage", "scipy.optimize", "scipy.signal"),
    *("scipy.sparse", "scipy.sparse.csgraph", "scipy.sparse.linalg", "scipy.spatial"),
    *("scipy.spatial.distance", "scipy.spatial.transform", "scipy.special"),
)
"""Modules of the libraries: those that their manuals name and that may be needed here.
To import another one, add it here and make the list anew."""
UNKNOWN = None
"""In place of the parameters of what does not tell them."""


def modules():
    """Import all that is listed; give the modules by name."""
    return {name: importlib.import_module(name) for name in (*STANDARD, *PUBLIC)}


def inventory(found):
    """List what is in modules.

    Args:
        found: Modules by name.

    Returns:
        Names in modules by the modules' names. To a function belong the names of its
        parameters or UNKNOWN, to a class a mapping of its members, "" being its call.
    """
    return {
        module: {
            name: _entry(value) for name, value in sorted(_members(content).items())
        }
        for module, content in sorted(found.items())
    }


def _members(thing):
    """Give the public names of a module or a class with their values.

    scipy itself repeats those of numpy; they are left out.
    """
    found = {}
    if getattr(thing, "__name__", "") == "scipy":
        return found
    for name in dir(thing):
        if name.startswith("_"):
            continue
        try:
            found[name] = getattr(thing, name)
        except Exception:
            found[name] = None
    return found


def _entry(value):
    """List a class's members or a function's parameters."""
    if inspect.isclass(value):
        members = {n: _parameters(v) for n, v in sorted(_members(value).items())}
        return {"": _parameters(value), **members}
    return _parameters(value)


def _parameters(value):
    """Give the names that a call may use as keywords; UNKNOWN if any or nobody says."""
    if not callable(value):
        return UNKNOWN
    names, is_open = set(), False
    try:
        for parameter in inspect.signature(value).parameters.values():
            is_open |= parameter.kind is parameter.VAR_KEYWORD
            names.add(parameter.name)
    except (TypeError, ValueError):
        is_open = True
    told = _told(value)
    if is_open and not told:
        return UNKNOWN
    return " ".join(sorted(names | told))


def _told(value):
    """Take the parameters from the calls that open the documentation."""
    text = inspect.getdoc(value) or ""
    name = re.escape(str(getattr(value, "__name__", "")))
    found = set()
    for call in re.finditer(rf"^(?:\w+\.)*{name}\(", text, re.M):
        words = _in_parentheses(text[call.end() :])
        outside = re.sub(r"\([^()]*\)", "", words)
        if "**" in outside or "..." in outside:
            return set()
        found.update(re.findall(r"([A-Za-z_]\w*)\s*(?==|,|$|\[|\])", words))
    return found - {"None", "True", "False"}


def _in_parentheses(text):
    """Cut a text before the parenthesis that closes what was opened before it."""
    depth = 1
    for place, letter in enumerate(text):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if not depth:
            return text[:place]
    return text.partition("\n\n")[0]


def main():
    """Write the inventory of what runs here."""
    warnings.simplefilter("ignore")
    found = modules()
    versions = {name: found[name].__version__ for name in LIBRARIES}
    versions["python"] = ".".join(map(str, sys.version_info[:2]))
    with open(sys.argv[1], "w") as file:
        listed = inventory(found)
        file.write(f'{{"versions": {json.dumps(versions)}')
        for name in listed:
            content = json.dumps(listed[name], separators=(",", ":"))
            file.write(f",\n{json.dumps(name)}: {content}")
        file.write("\n}\n")


if __name__ == "__main__":
    main()
