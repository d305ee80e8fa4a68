"""The panel of a folder: a list of its motions, and decisions on them."""

from __future__ import annotations

import base64
import html
import io
import math
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from g1_description.checks.verdict import FAILED, PASSED, WARNING
from g1_description.errors import InvalidValueError
from g1_description.motion.motion import Motion
from g1_description.motion.selection import EXCLUDE, KEEP, UNDECIDED
from g1_description.web.findings_panel import COLORS, plain
from g1_description.web.library import (
    BY_RULE,
    CHECK_FILTERS,
    CHOICE_FILTERS,
    RESULT_FILTERS,
    SORTS,
    Entry,
    Library,
    View,
)
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.panel import Key, PageContext, Panel
from g1_description.web.ui_loop import Lane

if TYPE_CHECKING:
    from viser import GuiFolderHandle

ROWS = 8
"""Rows of the list on one of its pages."""

NUMBERS = tuple(str(number) for number in range(1, ROWS + 1))

THUMBNAIL, PICTURE = 72, 480
"""Widths of pictures in the list and of the open motion, in [px]."""

MARKS = {KEEP: "&#10003;", EXCLUDE: "&#10007;", BY_RULE: "(&#10007;)", UNDECIDED: ""}

SHOWN = (
    ("duration", "{:.2f} s"),
    ("root_path", "path {:.2f} m"),
    ("root_speed.max", "&le; {:.2f} m/s"),
    ("joint_speed.max", "&le; {:.1f} rad/s"),
    ("contact_share", "contact {:.0%}"),
    ("energy", "{:.0f} J"),
)
"""Figures in the list."""

STYLE = """<style>
.g1-list { margin: 0 .8em .5em; font-size: .8em; line-height: 1.3; }
.g1-list div { display: flex; gap: .5em; padding: .25em; border-top: 1px solid #8884;
  overflow-wrap: anywhere; }
.g1-list div.g1-open { background: #228be622; }
.g1-list img { width: 72px; height: 48px; object-fit: cover; object-position: top;
  flex: none; }
.g1-list b { font-weight: 600; } .g1-list small { opacity: .75; display: block; }
</style>"""


class LibraryPanel(Panel):
    """Lists motions, opens them, and writes down decisions on them."""

    def __init__(
        self, page: PageContext, library: Library, head: GuiFolderHandle
    ) -> None:
        """Add the panel where the GUI is, and open its first motion.

        Args:
            page: What it shares with others; its first robot gets the motions.
            library: The motions.
            head: Has what is there whatever tab is in front.
        """
        self._library, self._head = library, head
        super().__init__(page)

    def build(self) -> None:
        """Add the elements."""
        gui, ui = self.gui, self.ui
        self._lane, self._motion = Lane(ui), self.page.get(MotionPanel)
        self._robot = self.world.robots[0]
        self._listed: list[Entry] = []
        self._open: Entry | None = None
        self._read: tuple[Entry, Motion] | None = None
        """The motion that was read last."""
        self._first = 0
        """Number of the first row that is shown."""
        with self._head:
            self._title = gui.add_markdown("")
            walk = gui.add_button_group("Motion", ["Previous", "Next"], hint="P, N")
            choices = ["Keep", "Exclude", "Undecided"]
            decide = gui.add_button_group("Choice", choices, hint="K, X")
        self._note = gui.add_text("Note", "")
        self._plays = gui.add_checkbox("Play at once", True)
        with gui.add_folder("Sort and filter", expand_by_default=False):
            self._sort = gui.add_dropdown("Sort by", SORTS)
            self._reversed = gui.add_checkbox("Largest first", False)
            self._text = gui.add_text("Name has", "")
            self._result = gui.add_dropdown("Result", RESULT_FILTERS)
            self._check = gui.add_dropdown("Finding", CHECK_FILTERS)
            self._choice = gui.add_dropdown("Chosen", CHOICE_FILTERS)
        self._rows = gui.add_html("")
        self._pick = gui.add_button_group("Open row", NUMBERS)
        self._turn = gui.add_button_group("Rows", ["First", "Up", "Down", "Last"])
        self._picture = gui.add_html("")
        looks = (self._sort, self._reversed, self._text)
        for element in (*looks, self._result, self._check, self._choice):
            ui.on(element, self._arrange)
        ui.on(walk, lambda: self.step(walk.value))
        ui.on(decide, lambda: self.choose(decide.value.lower()))
        ui.on(self._note, lambda: self.choose(note=str(self._note.value)))
        ui.on(self._pick, self._picked)
        ui.on(self._turn, self._turned)
        self._arrange()
        if self._listed:
            self._show(self._listed[0])

    def hotkeys(self) -> list[Key]:
        """List its keys."""
        step, choose = self.step, self.choose
        return [
            Key("N", "open the next motion", lambda: step("Next"), "N"),
            Key("P", "open the previous one", lambda: step("Previous"), "P"),
            Key("K", "keep the open motion", lambda: choose(KEEP), "K"),
            Key("X", "exclude the open motion", lambda: choose(EXCLUDE), "X"),
        ]

    # --- the list ---

    def _arrange(self) -> None:
        """Sort and filter, and show where the open motion is."""
        view = View(
            str(self._text.value).strip(),
            self._result.value,
            self._check.value,
            self._choice.value,
            self._sort.value,
            bool(self._reversed.value),
        )
        self._listed = self._library.listed(view)
        self._first = 0
        self._find_open()
        self._draw()

    def _find_open(self) -> None:
        """Turn to the page of the list with the open motion, if it has it."""
        if self._open in self._listed:
            self._first = self._listed.index(self._open) // ROWS * ROWS

    def _turned(self) -> None:
        """Show other rows of the list."""
        last = max(0, (len(self._listed) - 1) // ROWS * ROWS)
        to = {"First": 0, "Up": self._first - ROWS, "Down": self._first + ROWS}
        self._first = min(max(to.get(self._turn.value, last), 0), last)
        self._draw()

    def _draw(self) -> None:
        """Show the rows, at first without pictures that are not read yet."""
        kept, excluded = self._library.counts()
        self._title.content = (
            f"**{len(self._listed)}** of {len(self._library.entries)} motions; "
            f"{kept} kept, {excluded} excluded"
        )
        if self._open is not None:
            choice = self._library.choice(self._open)
            self._title.content += f"  \n{plain(self._open.name)}: {choice}"
        shown = self._listed[self._first : self._first + ROWS]

        def rows() -> str:
            rows = [self._row(number, entry) for number, entry in zip(NUMBERS, shown)]
            return f'{STYLE}<div class="g1-list">{"".join(rows)}</div>'

        self._lane.do(rows, partial(self._fill, shown), "rows")

    def _fill(self, shown: list[Entry], rows: str) -> None:
        """Show rows, if the list still has them at this place."""
        if shown == self._listed[self._first : self._first + ROWS]:
            self._rows.content = rows

    def _row(self, number: str, entry: Entry) -> str:
        """Write a row."""
        color = {PASSED: "#2f9e44", **COLORS}.get(entry.result, "#868e96")
        is_open = ' class="g1-open"' if entry is self._open else ""
        mark, note = MARKS[self._library.choice(entry)], self._library.note(entry)
        lines = [_figures(entry), _found(entry), html.escape(note)]
        if entry.excluded_by:
            lines.append(f"excluded by {html.escape(entry.excluded_by)}")
        small = "".join(f"<small>{line}</small>" for line in lines if line)
        return (
            f"<div{is_open}>"
            f"{_image(entry.picture, THUMBNAIL)}<span>{number}. "
            f"<b>{html.escape(entry.name)}</b> {mark} "
            f'<span style="color:{color}">{entry.result}</span>{small}</span></div>'
        )

    # --- the open motion ---

    def step(self, way: str) -> None:
        """Open the ``Next`` or the ``Previous`` motion of the list.

        Raises:
            InvalidValueError: If there is none.
        """
        if not self._listed:
            raise InvalidValueError("No motion is listed: change the filter.")
        step = 1 if way == "Next" else -1
        if self._open in self._listed:
            at = self._listed.index(self._open) + step
        else:  # it was filtered away
            at = self._first
        if not 0 <= at < len(self._listed):
            raise InvalidValueError("There is no other motion in the list.")
        self._show(self._listed[at])

    def _picked(self) -> None:
        """Open the motion of a row."""
        at = self._first + NUMBERS.index(self._pick.value)
        if at < len(self._listed):
            self._show(self._listed[at])

    def _show(self, entry: Entry) -> None:
        """Open a motion."""
        self._open = entry
        self._note.value = self._library.note(entry)
        self._find_open()
        read = partial(self.world.read, entry.path, self._robot, None)
        self._lane.do(read, partial(self._opened, entry), "motion")

        def show_picture(image: str) -> None:
            self._picture.content = image.replace("<img", '<img style="width:100%"')

        picture = partial(_image, entry.picture, PICTURE)
        self._lane.do(picture, show_picture, "picture")
        self._draw()

    def _opened(self, entry: Entry, motion: Motion) -> None:
        """Show a motion that was read, unless another one was chosen meanwhile."""
        if entry is self._open:
            self._read = entry, motion
            self._motion.open(entry.name, self._robot, motion)
            if self._plays.value:
                self._motion.play()

    def update(self) -> None:
        """Take the result of the page for a motion that the report does not have."""
        if self._read is None:
            return
        (entry, motion), robot = self._read, self._robot
        verdict = self._motion.verdicts.get(robot)
        is_open = self._motion.motions.get(robot) is motion
        if is_open and verdict is not None and not entry.figures:
            entry.learn(verdict)
            self._draw()

    def choose(self, choice: str | None = None, note: str | None = None) -> None:
        """Write down a decision or a note on the open motion.

        Raises:
            InvalidValueError: If none is open.
        """
        entry = self._open
        if entry is None:
            raise InvalidValueError("No motion is open.")
        act = partial(self._library.choose, entry, choice, note)
        self.ui.calls.do(act, lambda _: self._draw())


def _figures(entry: Entry) -> str:
    """Write the figures of a motion that are known."""
    known = [
        form.format(entry.figures[name])
        for name, form in SHOWN
        if math.isfinite(entry.figures.get(name, math.inf))
    ]
    return " &middot; ".join(known)


def _found(entry: Entry) -> str:
    """Write the checks that found something, failures first."""
    texts = [
        f'<span style="color:{COLORS[severity]}">{name.replace("_", " ")}</span>'
        for severity in (FAILED, WARNING)
        for name, worst in entry.found.items()
        if worst == severity
    ]
    return ", ".join(texts)


def _image(path: Path | None, width: int) -> str:
    """Write a picture in HTML; empty if there is none."""
    data = _pixels(path, width) if path is not None else ""
    return f'<img src="data:image/png;base64,{data}" alt="">' if data else ""


@lru_cache(maxsize=256)
def _pixels(path: Path, width: int) -> str:
    """Read a picture, and make it small."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            small = image.convert("RGB")
    except (OSError, ValueError, Image.DecompressionBombError):
        return ""
    height = max(1, round(width * small.height / small.width))
    packed = io.BytesIO()
    small.resize((width, height)).save(packed, "PNG")
    return base64.b64encode(packed.getvalue()).decode("ascii")
