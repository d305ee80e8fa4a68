"""Keyframes of one robot: configurations on a bar of times, and their motion."""

from __future__ import annotations

import math

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.ik.keyframe_poses import PASS, STOP, Keyframe, Keyframes
from g1_description.ik.keyframes import PERIOD, keyframe_pieces
from g1_description.robot.poses import read_file, read_poses, user_file
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.panel import Key, RobotPanel
from g1_description.web.reach_panel import ReachPanel
from g1_description.web.saved_motions import folder, save_motion
from g1_description.web.shown import Shown
from g1_description.web.ui_loop import Lane

NONE = "none"
"""Entry of the list while there are no keyframes."""

MAX_SECONDS = 60.0
"""Longest time between two keyframes, in [s]."""

ADD, REPLACE, DELETE, SHOW = "Add", "Replace", "Delete", "Show"

MOTION, POSES = "Motion", "Poses"


class KeyframesPanel(RobotPanel):
    """Adds keyframes of one robot, and makes motions of them."""

    title = "Keyframes"

    @classmethod
    def fits(cls, shown: Shown) -> bool:
        """Return whether the robot can be posed."""
        return ReachPanel.fits(shown)

    def build(self) -> None:
        """Add the elements."""
        gui, ui = self.gui, self.ui
        self.frames: list[Keyframe] = []
        """In the order of their times, the first at 0."""
        self._row = 0
        """The selected one."""
        self._made: Keyframes | None = None
        self._lane = Lane(ui)
        self._motion = self.page.get(MotionPanel)
        self._change = gui.add_button_group(
            "Keyframe",
            [ADD, REPLACE, DELETE, SHOW],
            hint="the present configuration as the next one, or the selected one",
        )
        self._selected = gui.add_dropdown("Selected", [NONE])
        self._seconds = gui.add_number(
            "Seconds before",
            1.0,
            min=PERIOD,
            max=MAX_SECONDS,
            step=0.1,
            hint="from the keyframe before to this one, and to the next one",
        )
        self._bar = gui.add_multi_slider(
            "Times", 0.0, 1.0, PERIOD, (0.0, 1.0), visible=False
        )
        self._way = gui.add_dropdown(
            "Interpolation",
            [STOP, PASS],
            hint="stop at each keyframe, or pass through it smoothly",
        )
        self._name = gui.add_text("Save as", "keyframes", hint="of what is saved")
        self._save = gui.add_button_group(
            "Save", [MOTION, POSES], hint=f"into {folder()}, or {user_file()}"
        )
        ui.on(self._change, lambda: self.change(self._change.value))
        ui.on(self._selected, self._select)
        ui.on(self._seconds, self._set_seconds)
        ui.on(self._bar, self._set_times)
        ui.on(self._way, self._make)
        ui.on(self._save, lambda: self.save(self._save.value))

    def hotkeys(self) -> list[Key]:
        """List its keys."""
        return [Key("K", "add a keyframe", lambda: self.change(ADD), "K")]

    def change(self, kind: str) -> None:
        """Add, replace, delete or show a keyframe.

        Raises:
            InvalidValueError: If there is none, or the state of the robot is unknown.
        """
        frames, row = self.frames, self._row
        if kind == ADD:
            self._add_present()
        elif not frames:
            raise InvalidValueError("There is no keyframe: add one first.")
        elif kind == REPLACE:
            frames[row] = Keyframe(frames[row].time, *self.shown.posing.place())
        elif kind == SHOW:
            self._show()
            return
        else:
            del frames[row]
            self._row = max(0, row - 1)
        self._changed()

    def _add_present(self) -> None:
        """Add the robot as it is as the keyframe after the selected one."""
        placed, seconds = self.shown.posing.place(), self._valid_seconds()
        if not self.frames:
            self.frames = [Keyframe(0.0, *placed)]
            return
        self._row += 1
        self._shift(self._row, seconds)
        time = self.frames[self._row - 1].time + seconds
        self.frames.insert(self._row, Keyframe(time, *placed))

    def _shift(self, row: int, seconds: float) -> None:
        """Move keyframes from one on to later times."""
        for number in range(row, len(self.frames)):
            frame = self.frames[number]
            self.frames[number] = frame._replace(time=frame.time + seconds)

    def _valid_seconds(self) -> float:
        """Return the time from the keyframe before, in whole samples."""
        seconds = float(self._seconds.value)
        if not PERIOD <= seconds <= MAX_SECONDS:
            raise InvalidValueError(
                f"Seconds must be from {PERIOD:g} to {MAX_SECONDS:g} (got {seconds:g})."
            )
        return PERIOD * round(seconds / PERIOD)

    def _show(self) -> None:
        """Move the robot to the selected keyframe."""
        frame = self.frames[self._row]
        opened = self._motion.motions.get(self.robot)
        if self._made is not None and opened is self._made.motion:
            self._motion.jump(frame.time)
        else:
            self.shown.posing.go((frame.positions, frame.base))

    def _select(self) -> None:
        """Select a keyframe, and show it."""
        if not self.frames:
            return
        self._row = list(self._selected.options).index(self._selected.value)
        self._show_selected()
        self._show()

    def _set_seconds(self) -> None:
        """Change the time between the selected keyframe and the one before."""
        seconds = self._valid_seconds()
        if self._row > 0:
            before = self.frames[self._row - 1].time
            self._shift(self._row, before + seconds - self.frames[self._row].time)
            self._changed()

    def _set_times(self) -> None:
        """Take the times of the bar."""
        times = np.array(self._bar.value, dtype=float)
        is_ok = times.shape == (len(self.frames),) and np.isfinite(times).all()
        if not is_ok or not (np.diff(times) >= PERIOD / 2.0).all():
            self._show_frames()
            return
        times = PERIOD * np.round((times - times[0]) / PERIOD)
        moved = [row for row, t in enumerate(times) if t != self.frames[row].time]
        self.frames = [f._replace(time=t) for f, t in zip(self.frames, times.tolist())]
        self._row = moved[0] if moved else self._row
        self._show_selected()
        self._make()

    def _changed(self) -> None:
        """Show the keyframes, and make the motion again."""
        if self.frames:
            self._shift(0, -self.frames[0].time)
        self._show_frames()
        self._make()

    def _show_frames(self) -> None:
        """Show the keyframes as they are."""
        times = [frame.time for frame in self.frames]
        self._bar.visible = len(times) > 1
        if len(times) > 1:
            self._bar.max = math.ceil(times[-1] + max(2.0, 0.5 * times[-1]))
            self._bar.value = tuple(times)
        self._show_selected()

    def _show_selected(self) -> None:
        """Show which keyframe is selected."""
        names = [f"{n} at {f.time:.2f} s" for n, f in enumerate(self.frames, 1)]
        self._selected.options = tuple(names or [NONE])
        self._selected.value = names[self._row] if names else NONE
        if self._row > 0:
            span = self.frames[self._row].time - self.frames[self._row - 1].time
            self._seconds.value = round(span, 2)

    # --- the motion ---

    def _make(self) -> None:
        """Make the motion through the keyframes, which takes a while."""
        self._lane.cancel("motion")
        self._made = None
        self.report("")
        if len(self.frames) > 1:
            robot, inverse = self.robot.description, self.shown.posing.inverse
            frames, way = [*self.frames], str(self._way.value)
            pieces = keyframe_pieces(robot, inverse, None, frames, way)
            self._lane.go_through(pieces, self._open, "motion")

    def _open(self, made: Keyframes) -> None:
        """Open the motion: its time line and checks."""
        self.frames, self._made = [*made.frames], made
        if made.message:
            self._show_frames()
            self.report(made.message)
        name = self._name.value.strip() or "keyframes"
        at = self.frames[self._row].time
        self._motion.open(name, self.robot, made.motion, at)

    # --- saving ---

    def save(self, kind: str) -> None:
        """Save the motion, or the keyframes as poses.

        Raises:
            G1DescriptionError: If there is nothing to save, or it cannot be written.
        """
        name, made = self._name.value.strip(), self._made
        if made is None:
            raise InvalidValueError(
                "There is no motion: add two keyframes, or wait until it is made."
            )
        if kind == MOTION:
            saved = save_motion(name, made.motion, self.robot.description)
            self.ui.notify(f"Saved {saved}.", "green")
            return
        file = user_file()
        used = {*read_poses(self.robot.description)}
        used |= {*read_file(file)} if file.exists() else set()
        taken = [one.name for one in made.poses(name) if one.name in used]
        if taken:
            raise InvalidValueError(
                f"The pose {taken[0]} already exists: choose another name."
            )
        made.save(file, name)
        self.page.refresh()
        self.ui.notify(f"Saved the keyframes {name} in {file}.", "green")
