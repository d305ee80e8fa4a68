"""What snapshot refuses, and what it writes without a master."""

import os
from pathlib import Path

import numpy as np
import pytest
from forked import run_script

pytest.importorskip("rospy", reason="rospy is not installed")
Image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")

from g1_description.cli import film  # noqa: E402
from g1_description.cli.film import (  # noqa: E402
    check_length,
    count,
    in_colors,
    palette_of,
    write_film,
    write_picture,
    write_video,
)
from g1_description.cli.snapshot import columns_of  # noqa: E402
from g1_description.errors import InvalidValueError  # noqa: E402
from g1_description.ros.waiting import NoAnswerError  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
ELBOW = "left_elbow_joint"
OURS = ROOT / "urdf" / "g1_29dof.urdf"
TREE = ROOT / "test" / "data" / "tree.urdf"
MOTION = ROOT / "test" / "data" / "elbow.csv"
NOBODY = "http://localhost:9"


def snapshot(*arguments):
    environment = {**os.environ, "ROS_MASTER_URI": NOBODY}
    environment.pop("DISPLAY", None)
    script = ROOT / "scripts" / "snapshot"
    return run_script(script, *arguments, environment=environment)


@pytest.mark.parametrize(
    ("n", "ratio", "columns"),
    [(1, 1.3, 1), (3, 1.3, 3), (4, 1.3, 2), (6, 1.3, 3), (4, 3.0, 4), (4, 0.2, 1)],
)
def test_a_sheet_has_as_little_empty_room_as_fits(n, ratio, columns):
    assert columns_of(n, ratio) == columns


def last_line(run):
    assert "Traceback" not in run.stderr
    return run.stderr.strip().splitlines()[-1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a.jpg"], "must end in .png"),
        (["a.png", "--gif"], "must end in .gif or .mp4"),
        (["a.gif"], "There is no master at http://localhost:9"),
        (["nowhere/a.png"], "The folder"),
        (["a.png", "--size", "15x100"], "must be a size like 1280x960"),
        (["a.png", "--size", "5000x100"], "(got '5000x100')"),
        (["a.png", "--size", "wide"], "(got 'wide')"),
        (["a.png", "--view", "top"], "'front', 'side', 'back', 'iso'"),
        (["a.gif", "--gif", "--seconds", "0"], "--seconds must be greater than 0"),
        (["a.gif", "--gif", "--fps", "31"], "--fps must be greater than 0 and at most"),
        (["a.png", "--seconds", "3"], "--seconds and --fps need an animation"),
        (["a.png", "--joints", "a"], "must be like a=1.2,b=-0.3 (got 'a')"),
        (["a.png", "--joints", "a=x"], "must be a number (got 'x')"),
        (["a.png"], "There is no master at http://localhost:9"),
        (["a.png", "--model", "nowhere.urdf"], "Cannot use the model nowhere.urdf"),
        (["a.png", "--model", __file__], "Cannot use"),
        (["a.gif", "--model", OURS], "an animation of --model needs --m"),
        (["a.png", "--motion", "no.csv"], "no.csv cannot be read: No such file"),
        (["a.png", "--motion", MOTION, "--model", TREE], "none of the motion's joints"),
        (
            ["a.png", "--motion", MOTION, "--times", "0,9"],
            "--times 9 is outside the motion",
        ),
        (["a.png", "--motion", MOTION, "--times", "0,x"], "must be a number (got 'x')"),
        (["a.mp4", "--motion", MOTION, "--fps", "0"], "--fps must be greater than 0"),
        (["a.gif", "--motion", MOTION, "--times", "0"], "--times needs a picture"),
        (
            ["a.png", "--motion", MOTION, "--motion-fps", "0"],
            "-fps: must be greater than 0",
        ),
        (
            ["a.png", "--times", "0"],
            "--motion-fps, --motion-topic and --times need --motion",
        ),
        (["a.mp4", "--motion", MOTION, "--size", "65x48"], "--size must be even"),
        (
            ["a.gif", "--motion", MOTION, "--namespace", "a"],
            "--namespace cannot be combined",
        ),
        (
            ["a.png", "--model", OURS, "--joints", "wing=1"],
            "has no joint wing. Its joints:",
        ),
        (["a.png", "--model", OURS, "--joints", f"{ELBOW}=99"], "must be from -1"),
        (
            ["a.png", "--model", OURS, "--joints", "left_elbow=1"],
            "has no joint left_elbow. Its joints: left_elbow_joint, ",
        ),
        (["a" * 300 + ".png", "--model", OURS], "snapshot: [Errno 36] File name"),
        (["a.png", "--model", TREE], "Nothing to draw"),
    ],
)
def test_what_is_wrong_is_told_in_one_sentence_and_writes_nothing(
    tmp_path, arguments, words
):
    run = snapshot(tmp_path / arguments[0], *arguments[1:])
    assert run.returncode == 1
    assert words in last_line(run)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_file_is_drawn_without_a_master_and_without_a_screen(tmp_path):
    pictures = []
    for joints in ("left_elbow_joint=0", "left_elbow_joint=-1.0,waist_yaw_joint=1"):
        out = tmp_path / "robot.png"
        wanted = ("--model", OURS, "--size", "320x240", "--view", "front")
        run = snapshot(out, *wanted, "--joints", joints)
        assert run.returncode == 0, run.stderr
        assert run.stdout == f"{out}: 320x240, front\n"
        pictures.append(np.array(Image.open(out)))
    assert pictures[0].shape == (240, 320, 3)
    assert (pictures[0] != pictures[1]).any(axis=2).sum() > 500
    assert [path.name for path in tmp_path.iterdir()] == ["robot.png"]


def draw_motion(folder, name, *arguments):
    """Draw the motion, in which the robot walks by 0.5 m and bends an elbow."""
    out = folder / name
    run = snapshot(out, "--motion", MOTION, "--view", "front", *arguments)
    assert run.returncode == 0, run.stderr
    assert [path.name for path in folder.iterdir()] == [name]
    return out, run


@pytest.mark.slow
def test_moments_of_a_motion_stand_side_by_side(tmp_path):
    wanted = ("--times", "0,0.5,1", "--size", "360x160")
    out, run = draw_motion(tmp_path, "sheet.png", *wanted)
    assert run.stdout == f"{out}: 3 moments, front\n"
    sheet = np.array(Image.open(out)).astype(int)
    assert sheet.shape == (160, 360, 3)
    first, second, third = np.split(sheet, 3, axis=1)
    for one, other in ((first, second), (second, third)):
        assert (np.abs(one - other).max(axis=2) > 30).sum() > 50


def test_a_motion_is_filmed_as_gif(tmp_path):
    out, _ = draw_motion(tmp_path, "a.gif", "--fps", "4", "--size", "64x48")
    film = Image.open(out)
    assert film.n_frames == 4
    lengths = [film.info["duration"] for k in range(4) if not film.seek(k)]
    assert sum(lengths) == 1000


@pytest.mark.slow
def test_a_motion_is_filmed_as_mp4(tmp_path):
    """It is read back by ffmpeg: all its pictures, and the robot going aside."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    out, _ = draw_motion(tmp_path, "a.mp4", "--fps", "4", "--size", "96x64")
    reader = ffmpeg.read_frames(str(out))
    meta = next(reader)
    assert meta["fps"] == 4.0
    assert meta["source_size"] == (96, 64)
    shots = [np.frombuffer(data, np.uint8).reshape(64, 96, 3) for data in reader]
    assert len(shots) == 4
    dark = [np.argwhere(shot.sum(axis=2) < 250)[:, 1].mean() for shot in shots]
    assert np.diff(dark).min() > 2.0


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ('for film; do :; done; echo part > "$film"; cat > /dev/null', None),
        ('for film; do :; done; echo part > "$film"; echo full >&2; exit 1', "full"),
        ("exit 3", "it ended with 3"),
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


@pytest.mark.parametrize(("n", "rate"), [(45, 15.0), (7, 30.0), (1, 2.0), (10, 7.0)])
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


def test_light_areas_keep_their_colour_and_many_colours_have_room():
    shade = np.linspace(230, 252, 200).astype(np.uint8)
    light = np.repeat(np.stack([shade, shade + 1, shade + 3], -1)[None], 20, axis=0)
    seen = np.array(in_colors(light, palette_of([light])).convert("RGB"))
    assert np.abs(seen.astype(int) - light).max() <= 1
    noise = np.random.default_rng(1).integers(0, 256, (100, 100, 3), np.uint8)
    seen = np.array(in_colors(noise, palette_of([noise])).convert("RGB"))
    assert np.abs(seen.astype(int) - noise).mean() < 20


def test_frames_that_are_equal_prolong_a_film(tmp_path):
    pictures = frames(2)[[0, 0, 0, 1]]
    palette = palette_of(pictures)
    write_film(tmp_path / "a.gif", [in_colors(p, palette) for p in pictures], 10.0)
    film = Image.open(tmp_path / "a.gif")
    assert film.n_frames == 2
    assert film.info["duration"] == 300


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
    clock = iter([5.0, 5.0, 9.0, 9.5, 1.0, 2.0, 3.5, 3.5, 8.0])
    now = [next(clock)]

    def wait(changed, timeout):
        now[0] = next(clock)
        return changed()

    monkeypatch.setattr(film, "wait_until", wait)
    monkeypatch.setattr(film.rospy, "get_time", lambda: now[0])
    stopwatch = film._Stopwatch()
    with pytest.raises(NoAnswerError, match=r"did not advance for 10 s \(it is at 5 s"):
        stopwatch.wait(1.0)
    stopwatch.wait(4.0)
    assert now[0] == 9.0
    stopwatch.wait(7.0)
    assert now[0] == 3.5
    with pytest.raises(NoAnswerError, match=r"it is at 3.5 s\); is time paused\?"):
        stopwatch.wait(7.1)


def test_a_film_is_not_longer_than_there_is_room_for():
    check_length(60.0, 15.0, (640, 480))
    with pytest.raises(InvalidValueError, match="900 pictures of 1280x960"):
        check_length(60.0, 15.0, (1280, 960))
    assert count(5.0, 15.0) == 75
