"""What snapshot refuses, and what it writes without a master."""

import base64
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rospy", reason="rospy is not installed")
Image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")

from g1_description.cli import running_robots  # noqa: E402
from g1_description.cli import snapshot as command  # noqa: E402
from g1_description.cli.film import (  # noqa: E402
    check_length,
    count,
    in_colors,
    palette_of,
    write_film,
    write_picture,
    write_video,
)
from g1_description.errors import InvalidValueError  # noqa: E402
from g1_description.motion.files.formats import read_motion  # noqa: E402
from g1_description.robot.load import read_description  # noqa: E402
from g1_description.ros.waiting import NoAnswerError  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
ELBOW = "left_elbow_joint"
OURS = ROOT / "urdf" / "g1_29dof.urdf"
TREE = ROOT / "test" / "data" / "tree.urdf"
MOTION = ROOT / "test" / "data" / "elbow.csv"
NOBODY = "http://localhost:9"


BOX = (
    '<visual><origin xyz="0 0 {0}"/><geometry><box size="0.1 0.2 0.5"/></geometry>'
    '<material name="dark"><color rgba="0.1 0.1 0.1 1"/></material></visual>'
)
ARM = (
    f'<robot name="arm"><link name="post">{BOX.format(0.25)}</link>'
    f'<link name="fore">{BOX.format(0.25)}</link><joint name="{ELBOW}" '
    'type="revolute"><parent link="post"/><child link="fore"/><origin xyz="0 0 0.5"/>'
    '<axis xyz="1 0 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    "</robot>"
)
"""A robot that is drawn soon."""


@pytest.fixture(autouse=True)
def nobody(monkeypatch):
    """There is neither a master nor a screen."""
    monkeypatch.setenv("ROS_MASTER_URI", NOBODY)
    monkeypatch.delenv("DISPLAY", raising=False)


@pytest.fixture
def snapshot(monkeypatch):
    """Give what runs the command."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["snapshot", *map(str, arguments)])
        command.main()

    return run


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Give the file of the small robot."""
    file = tmp_path_factory.mktemp("robot") / "arm.urdf"
    file.write_text(ARM)
    return file


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a.jpg"], "must end in .png"),
        (["a.png", "--gif"], "must end in .gif or .mp4"),
        (["a.png", "--size", "15x100"], "must be a size like 1280x960"),
        (["a.png", "--view", "top"], "'front', 'side', 'back', 'iso'"),
        (["a.gif", "--gif", "--seconds", "0"], "--seconds must be greater than 0"),
        (["a.png", "--joints", "a"], "must be like a=1.2,b=-0.3 (got 'a')"),
        (["a.png"], "No ROS master at http://localhost:9; start a robot"),
        (["a.png", "--model", "nowhere.urdf"], "Cannot use the model nowhere.urdf"),
        (["a.gif", "--model", "arm"], "an animation of --model needs --m"),
        (["a.png", "--motion", MOTION, "--model", TREE], "none of the motion's joints"),
        (
            ["a.png", "--motion", MOTION, "--time", "9"],
            "--time 9 is outside the motion",
        ),
        (["a.gif", "--motion", MOTION, "--time", "0"], "--time does not apply to an a"),
        (["a.html", "--size", "64x48"], "--size does not apply to a page"),
        (
            ["a.png", "--model", OURS, "--joints", "left_elbow=1"],
            "has no joint left_elbow. Its joints: left_elbow_joint, ",
        ),
        (["a.png", "--model", "arm", "--joints", f"{ELBOW}=99"], "must be from -3"),
        (["a.png", "--model", TREE], "Nothing to draw"),
        (["a.png", "--model", OURS, "--forces"], "--forces does not apply to --model"),
        (["a.html", "--motion", MOTION, "--forces"], "--forces does not apply to a p"),
    ],
)
def test_what_is_wrong_is_told_in_one_sentence_and_writes_nothing(
    tmp_path, snapshot, arm, capsys, arguments, words
):
    given = [arm if word == "arm" else word for word in arguments[1:]]
    with pytest.raises(SystemExit) as end:
        snapshot(tmp_path / arguments[0], *given)
    assert end.value.code == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("snapshot: ") and words in told
    assert not list(tmp_path.iterdir())


def test_a_file_is_drawn_without_a_master_and_without_a_screen(
    tmp_path, snapshot, arm, capsys
):
    out, pictures = tmp_path / "robot.png", []
    for position in (0.0, -1.0):
        wanted = ("--model", arm, "--size", "160x120", "--view", "front")
        snapshot(out, *wanted, "--joints", f"{ELBOW}={position}")
        assert capsys.readouterr().out == f"{out}: 160x120, front\n"
        pictures.append(np.array(Image.open(out)))
    assert pictures[0].shape == (120, 160, 3)
    assert (pictures[0] != pictures[1]).any(axis=2).sum() > 500
    assert [path.name for path in tmp_path.iterdir()] == ["robot.png"]


def test_a_page_shows_a_configuration_or_a_motion(tmp_path, snapshot, arm, capsys):
    page = tmp_path / "a.html"

    def content():
        (text,) = re.findall('application/json">(.*)</script>', page.read_text())
        found = json.loads(text)
        data = base64.b64decode(found["positions"])
        return found, np.frombuffer(data, "<f4").tolist()

    snapshot(page, "--model", arm)
    assert content()[1] == [0.0]
    snapshot(page, "--model", arm, "--joints", f"{ELBOW}=0.5")
    assert content()[1] == [0.5]
    assert capsys.readouterr().out.endswith("a.html: one configuration\n")
    snapshot(page, "--model", arm, "--motion", MOTION)
    motion = read_motion(MOTION, read_description(str(arm)))
    assert content()[1] == pytest.approx(motion.positions[:, 0].tolist())
    assert capsys.readouterr().out == f"{page}: {len(motion.times)} samples\n"
    snapshot(page, "--model", arm, "--motion", MOTION, "--joints", f"{ELBOW}=0.5")
    assert content()[1] == [0.5] * len(motion.times)


def test_a_picture_shows_a_motion_of_the_g1_at_one_time(tmp_path, snapshot, capsys):
    """It walks by 0.5 m and bends an elbow."""
    out, pictures = tmp_path / "a.png", []
    for time in ([], ["--time", "0"], ["--time", "1"]):
        snapshot(out, "--motion", MOTION, *time, "--size", "120x160", "--view", "front")
        assert capsys.readouterr().out == f"{out}: 120x160, front\n"
        pictures.append(np.array(Image.open(out)).astype(int))
    first, begin, end = pictures
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "spheres: {ball: {radius: 0.2, at: [0.3, 0, 1], color: [1, 0, 0]}}\n"
        "attach: {ball: {link: torso}}\n"
    )
    around = ("--scene", scene, "--size", "120x160", "--view", "front")
    reds = []
    for time in ("0", "1"):
        snapshot(out, "--motion", MOTION, "--time", time, *around)
        red, green, blue = np.moveaxis(np.array(Image.open(out)).astype(int), 2, 0)
        reds.append((red > 2 * green + 20) & (red > 2 * blue + 20))
    assert min(seen.sum() for seen in reds) > 50
    assert (reds[0] != reds[1]).any()  # it walks with the robot
    np.testing.assert_array_equal(first, begin)
    assert (np.abs(begin - end).max(axis=2) > 30).sum() > 50


def test_contact_forces_are_drawn_on_top_of_the_robot(tmp_path, snapshot, capsys):
    file, out = tmp_path / "hover.csv", tmp_path / "a.png"
    names = "left_knee_joint,base_x,base_y,base_z,base_qx,base_qy,base_qz,base_qw"
    reds, blues = [], []
    for height in (0.793, 1.0):
        rows = [f"{0.02 * k:.2f},0,0,0,{height},0,0,0,1" for k in range(50)]
        file.write_text("\n".join([f"time,{names}", *rows]))
        given = ("--motion", file, "--time", "0.5", "--size", "240x320")
        snapshot(out, *given, "--view", "front", "--forces")
        red, green, blue = np.moveaxis(np.array(Image.open(out)).astype(int), 2, 0)
        reds.append((red - np.maximum(green, blue) > 90).sum())
        blues.append((blue - np.maximum(red, green) > 90).sum())
    assert min(blues[0], reds[1]) > 100 and blues[1] == reds[0] == 0
    assert "344 N and 0.0 N m are missing at 0.5 s." in capsys.readouterr().err


@pytest.fixture
def late(tmp_path_factory):
    """Give the file of a motion from 100 s to 101 s."""
    header, *rows = MOTION.read_text().splitlines()
    file = tmp_path_factory.mktemp("late") / "late.csv"
    later = (f"{100 + float(row.split(',')[0])},{row.split(',', 1)[1]}" for row in rows)
    file.write_text("\n".join([header, *later]))
    return file


def test_a_picture_of_a_motion_that_begins_late_is_at_its_own_time(
    tmp_path, snapshot, arm, late, capsys
):
    wanted = ("--model", arm, "--size", "64x48", "--view", "front")
    pictures = []
    for motion, time in ((MOTION, 0), (MOTION, 1), (late, 100), (late, 101)):
        snapshot(tmp_path / "a.png", "--motion", motion, "--time", time, *wanted)
        pictures.append(np.array(Image.open(tmp_path / "a.png")))
    for own, other in zip(pictures[:2], pictures[2:]):
        np.testing.assert_array_equal(own, other)
    assert (pictures[0] != pictures[1]).any()
    with pytest.raises(SystemExit):
        snapshot(tmp_path / "a.png", "--motion", late, "--time", 1, *wanted)
    assert "is outside the motion" in capsys.readouterr().err


def test_a_motion_is_filmed_as_gif_and_mp4(tmp_path, snapshot, arm, late):
    """Ffmpeg reads the latter back: all its pictures, and the robot going aside."""
    wanted = ("--motion", late, "--model", arm, "--view", "front", "--fps", "4")
    snapshot(tmp_path / "a.gif", *wanted, "--size", "64x48")
    film = Image.open(tmp_path / "a.gif")
    assert film.n_frames == 4
    lengths = [film.info["duration"] for k in range(4) if not film.seek(k)]
    assert sum(lengths) == 1000
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    snapshot(tmp_path / "a.mp4", *wanted, "--size", "96x64")
    reader = ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    meta = next(reader)
    assert meta["fps"] == 4.0
    assert meta["source_size"] == (96, 64)
    shots = [np.frombuffer(data, np.uint8).reshape(64, 96, 3) for data in reader]
    assert len(shots) == 4
    dark = [np.argwhere(shot.sum(axis=2) < 250)[:, 1].mean() for shot in shots]
    assert np.diff(dark).min() > 2.0
    assert {path.name for path in tmp_path.iterdir()} == {"a.gif", "a.mp4"}


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ('for film; do :; done; echo part > "$film"; cat > /dev/null', None),
        ('for film; do :; done; echo part > "$film"; echo full >&2; exit 1', "full"),
    ],
)
def test_a_film_that_ffmpeg_cannot_write_leaves_what_was_there(
    tmp_path, monkeypatch, program, words
):
    ffmpeg = tmp_path / "ffmpeg"
    ffmpeg.write_text(f"#!/bin/sh\n{program}\n")
    ffmpeg.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(ffmpeg))
    out = tmp_path / "a.mp4"
    out.write_text("old")
    if words is None:
        write_video(out, frames(3), (30, 20), 10.0)
        assert out.read_text() == "part\n"
        return
    with pytest.raises(InvalidValueError, match=f"cannot write a.mp4: {words}"):
        write_video(out, frames(3), (30, 20), 10.0)
    assert out.read_text() == "old"


def frames(n):
    """Draw a bar that grows."""
    pictures = np.full((n, 20, 30, 3), 250, np.uint8)
    for k in range(n):
        pictures[k, :, : k + 1] = (40, 90, 160)
    return pictures


@pytest.mark.parametrize(("n", "rate"), [(45, 15.0), (10, 7.0)])
def test_a_film_has_all_its_frames_and_the_right_length(tmp_path, n, rate):
    pictures = frames(min(n, 29))
    pictures = pictures[np.arange(n) % len(pictures)]
    palette = palette_of(pictures)
    write_film(tmp_path / "a.gif", [in_colors(p, palette) for p in pictures], rate)
    film = Image.open(tmp_path / "a.gif")
    lengths = []
    for k in range(film.n_frames):
        film.seek(k)
        lengths.append(film.info["duration"])
        np.testing.assert_allclose(film.convert("RGB"), pictures[k], atol=2)
    assert film.n_frames == n
    assert film.info.get("loop", 0) == 0
    assert abs(sum(lengths) - 1000.0 * n / rate) <= 5.0
    ends, wanted = np.cumsum(lengths), 1000.0 * np.arange(1, n + 1) / rate
    np.testing.assert_allclose(ends, wanted, atol=5.01)


def test_a_file_that_cannot_be_written_stays_as_it_was(tmp_path, monkeypatch):
    out = tmp_path / "a.png"
    out.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InvalidValueError, match="cannot be written: No space"):
        write_picture(out, frames(1)[0])
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    assert out.read_text() == "old"


def test_a_film_goes_on_after_a_reset_and_waits_as_long_as_the_clock_advances(
    monkeypatch,
):
    """Each reading of the clock takes as long as it may stand still."""
    now = []

    def wait(changed, timeout):
        now.pop(0)
        return changed()

    monkeypatch.setattr(running_robots, "wait_until", wait)
    monkeypatch.setattr(running_robots.rospy, "get_time", lambda: now[0])
    now[:] = [5.0, 5.0]
    with pytest.raises(NoAnswerError, match=r"did not advance for 10 s \(it is at 5 s"):
        running_robots.record(list, 7.0, 1.0 / 3.5)
    clock = [5.0, 9.0, 9.5, 1.0, 2.0, 3.5]
    now[:] = clock
    assert len(running_robots.record(list, 10.5, 1.0 / 3.5)) == 3  # at 0, 3.5 and 7 s
    assert now == [3.5]
    now[:] = [*clock, 3.5]
    with pytest.raises(NoAnswerError, match=r"it is at 3.5 s\); is time paused\?"):
        running_robots.record(list, 14.0, 1.0 / 3.5)


def test_a_film_is_not_longer_than_there_is_room_for():
    check_length(60.0, 15.0, (640, 480))
    with pytest.raises(InvalidValueError, match="900 pictures of 1280x960"):
        check_length(60.0, 15.0, (1280, 960))
    assert count(5.0, 15.0) == 75
