"""Keys of the page, which act where nobody types."""

from __future__ import annotations

from g1_description.web.panel import Key, PageContext


def add_keys(page: PageContext) -> None:
    """Let the keys of all panels act, and list them."""
    keys: dict[tuple[str, str | None], Key] = {}
    for key in (key for panel in page.panels for key in panel.hotkeys()):
        keys.setdefault((key.hotkey, key.modifier), key)
    gui = page.server.gui
    for key in keys.values():
        command = gui.add_command(
            key.effect.capitalize(), hotkey=key.hotkey, modifier=key.modifier
        )
        command.on_trigger(lambda _, key=key: page.ui.post(key, key.act))
    lines = "\n".join(f"| {key.shown} | {key.effect} |" for key in keys.values())
    with gui.add_folder("Keys", expand_by_default=False):
        gui.add_markdown(f"| key | effect |\n| --- | --- |\n{lines}")
