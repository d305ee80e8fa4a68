"""Keys of the page, which are taken where nobody types."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from g1_description.motion.selection import EXCLUDE, KEEP
from g1_description.web.history_panel import HistoryPanel
from g1_description.web.keyframes_panel import ADD
from g1_description.web.library_panel import LibraryPanel
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.reach_panel import REDO, UNDO
from g1_description.web.shown import Shown
from g1_description.web.ui_loop import UiLoop
from g1_description.web.view_panel import ViewPanel

if TYPE_CHECKING:
    from collections.abc import Callable

    from viser import GuiApi


class Key(NamedTuple):
    """A key and what it does."""

    hotkey: str
    """Its name for viser."""

    modifier: str | None
    shown: str
    """Its name for people."""

    effect: str
    act: Callable[[], object]


def keys_of(
    motion: MotionPanel,
    view: ViewPanel,
    shown: Shown,
    history: HistoryPanel | None,
    library: LibraryPanel | None,
) -> list[Key]:
    """List the keys of a page.

    Args:
        motion: Plays the motion.
        view: Follows the robot.
        shown: The first robot.
        history: Shows the past, where it is kept.
        library: Lists motions, if there are several; K keeps the open one then.
    """

    def step(way: str) -> None:
        if history is not None and history.shown is not None:
            history.step(way)
        else:
            motion.step(way)

    keys = [
        Key("space", None, "Space", "play, or pause", motion.toggle),
        Key("arrowleft", None, "←", "one sample back", lambda: step("-1")),
        Key("arrowright", None, "→", "one sample on", lambda: step("+1")),
        Key("F", None, "F", "follow the robot, or do not", view.toggle_follow),
    ]
    if history is not None:
        keys.append(Key("L", None, "L", "back from the past to live", history.live))
    if library is not None:
        step_list, choose = library.step, library.choose
        keys += [
            Key("N", None, "N", "open the next motion", lambda: step_list("Next")),
            Key("P", None, "P", "open the previous one", lambda: step_list("Previous")),
            Key("K", None, "K", "keep the open motion", lambda: choose(KEEP)),
            Key("X", None, "X", "exclude the open motion", lambda: choose(EXCLUDE)),
        ]
    reach, keyframes = shown.reach, shown.keyframes
    if reach is not None and keyframes is not None:
        add = Key("K", None, "K", "add a keyframe", lambda: keyframes.change(ADD))
        keys += [] if library is not None else [add]
        keys += [
            Key("G", None, "G", "show gizmos, or hide them", reach.toggle),
            Key("Z", "cmd/ctrl", "Ctrl+Z", "undo", lambda: reach.change(UNDO)),
            Key(
                "Z",
                "cmd/ctrl+shift",
                "Ctrl+Shift+Z",
                "redo",
                lambda: reach.change(REDO),
            ),
        ]
    return keys


def add_keys(gui: GuiApi, ui: UiLoop, keys: list[Key]) -> None:
    """Let keys act, and list them."""
    for key in keys:
        command = gui.add_command(
            key.effect.capitalize(), hotkey=key.hotkey, modifier=key.modifier
        )
        command.on_trigger(lambda _, key=key: ui.post(key, key.act))
    lines = "\n".join(f"| {key.shown} | {key.effect} |" for key in keys)
    with gui.add_folder("Keys", expand_by_default=False):
        gui.add_markdown(f"| key | effect |\n| --- | --- |\n{lines}")
