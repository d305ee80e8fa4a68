"""Whether RViz could draw here: an X server, and its OpenGL."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping

from g1_description.cli.doctor.faults import BROWSER, Fault, fault

TIMEOUT = 10.0
"""Longest wait for the X server and its OpenGL, in [s]."""

SOFTWARE = {"LIBGL_ALWAYS_SOFTWARE": "1"}

# Xlib ends the program where the server does; so this is one of its own. RViz asks for
# these: RGBA, 8 bits each, depth, double buffer.
PROBE = """
import ctypes, ctypes.util, sys
def library(name, file):
    try:
        return ctypes.CDLL(ctypes.util.find_library(name) or file)
    except OSError as error:
        sys.exit("no_gl:there is no library " + file)
x = library("X11", "libX11.so.6")
x.XOpenDisplay.restype = ctypes.c_void_p
display = x.XOpenDisplay(None)
if not display:
    sys.exit("dead_display:")
gl = library("GL", "libGL.so.1")
gl.glXChooseVisual.restype = gl.glXCreateContext.restype = ctypes.c_void_p
display = ctypes.c_void_p(display)
if not gl.glXQueryExtension(display, None, None):
    sys.exit("no_gl:there is no OpenGL")
wanted = (ctypes.c_int * 11)(4, 5, 8, 8, 9, 8, 10, 8, 12, 16, 0)
visual = gl.glXChooseVisual(display, x.XDefaultScreen(display), wanted)
if not visual:
    sys.exit("no_gl:there is no visual with colours and depth")
if not gl.glXCreateContext(display, ctypes.c_void_p(visual), None, 1):
    sys.exit("no_gl:there is no OpenGL context")
"""


def probe(environment: Mapping[str, str]) -> tuple[str, str]:
    """Open the display and ask for OpenGL as RViz does.

    Args:
        environment: The variables, of which DISPLAY is set.

    Returns:
        ``dead_display`` or ``no_gl``, and why; both empty where RViz can draw.
    """
    try:
        run = subprocess.run(
            [sys.executable, "-c", PROBE],
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            timeout=TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "dead_display", ""
    if run.returncode == 0:
        return "", ""
    text = (run.stderr.decode(errors="replace").splitlines() or [""])[-1]
    name, _, reason = text.partition(":")
    if name not in ("dead_display", "no_gl"):
        return "no_gl", f"asking for OpenGL ends with {run.returncode}"
    return name, reason


def picture(environment: Mapping[str, str]) -> Fault | str:
    """Tell why nothing shows the robot; for when neither RViz nor a page does.

    Without a screen that is no fault.
    """
    display = environment.get("DISPLAY", "")
    if not display:
        return f"not needed without a screen; in a browser: {BROWSER}"
    name, reason = probe(environment)
    if not name:
        return fault("no_picture")
    if name == "no_gl" and not probe({**environment, **SOFTWARE})[0]:
        name = "only_software_gl"
    return fault(name, display=display, reason=reason)
