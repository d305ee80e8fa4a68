"""Pictures and animations of robots, written to files."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Callable, Dict, Iterator, NamedTuple, Optional, Tuple

import numpy as np
from PIL import Image

from g1_description.checks.arrows import Arrow
from g1_description.cli.start import is_shut_down
from g1_description.errors import InvalidValueError
from g1_description.files.atomic import write_whole
from g1_description.motion.motion import Motion, configuration
from g1_description.render.camera import VIEWS, Camera, framing
from g1_description.render.scene import Picture
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY, compose, inverse

COLORS = 255
"""Colours of a GIF; one more marks unchanged pixels."""

FILMS = (".gif", ".mp4")
"""File extensions of animations."""

BLOCK = 4096
"""Colours that are looked up at once; limits memory."""


def check_place(path: Path, suffixes: Sequence[str]) -> None:
    """Check that a file can be written, before the work is done.

    Args:
        path: The file; an existing one will be replaced.
        suffixes: Allowed extensions.

    Raises:
        InvalidValueError: If it cannot.
    """
    if path.suffix.lower() == ".mp4":  # where it is missing, nothing is drawn in vain
        import imageio_ffmpeg  # noqa: F401
    folder = path.parent
    if path.suffix.lower() not in suffixes:
        raise InvalidValueError(
            f"{path} must end in {' or '.join(suffixes)}: a picture in .png, an "
            "animation in .gif or .mp4, a page in .html."
        )
    if not folder.is_dir():
        raise InvalidValueError(f"The folder {folder} for {path.name} does not exist.")
    if path.is_dir() or not os.access(folder, os.W_OK):
        raise InvalidValueError(f"The file {path} cannot be written.")


def write_picture(path: Path, picture: np.ndarray) -> None:
    """Write a picture.

    Args:
        path: The file.
        picture: Colours as uint8, shape (height, width, 3).

    Raises:
        InvalidValueError: If it cannot be written; an existing file is kept.
    """
    content = io.BytesIO()
    Image.fromarray(picture).save(content, "PNG", optimize=True)
    write_whole(path, content.getvalue())


def palette_of(pictures: Sequence[np.ndarray]) -> Image.Image:
    """Choose the palette of a GIF.

    Args:
        pictures: Some pictures of it, as uint8, shape (height, width, 3) each.
    """
    together = Image.fromarray(np.concatenate(pictures))
    return together.quantize(COLORS, dither=Image.Dither.NONE)


def in_colors(picture: np.ndarray, palette: Image.Image) -> Image.Image:
    """Quantize a picture to the nearest colours of a palette.

    Pillow's own quantization uses the upper bits only, which tints light areas.

    Args:
        picture: As uint8, shape (height, width, 3).
        palette: An image with the palette.
    """
    packed = picture.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    codes, places = np.unique(packed, return_inverse=True)
    known = np.array(palette.getpalette()[: 3 * COLORS], dtype=int).reshape(-1, 3)
    nearest = []
    for block in np.array_split(codes, len(codes) // BLOCK + 1):
        colors = block[:, np.newaxis].astype(int) >> [16, 8, 0] & 255
        squares = ((colors[:, np.newaxis] - known) ** 2).sum(axis=-1)
        nearest.append(squares.argmin(axis=1).astype(np.uint8))
    indices = np.concatenate(nearest)[places].reshape(picture.shape[:2])
    image = Image.fromarray(indices, "P")
    image.putpalette(palette.getpalette())
    return image


def write_film(path: Path, images: Sequence[Image.Image], rate: float) -> None:
    """Write a GIF that loops.

    GIFs have a resolution of 10 ms, so durations are rounded such that they add up. An
    image equal to the previous one prolongs it.

    Args:
        path: The file.
        images: All with the same palette.
        rate: Images per second in [Hz].

    Raises:
        InvalidValueError: If it cannot be written; an existing file is kept.
    """
    ends = np.round(100.0 * np.arange(len(images) + 1) / rate)
    content = io.BytesIO()
    images[0].save(
        content,
        "GIF",
        save_all=True,
        append_images=images[1:],
        duration=(10.0 * np.diff(ends)).astype(int).tolist(),
        loop=0,
        optimize=False,
    )
    write_whole(path, content.getvalue())


LONGEST, FASTEST = 60.0, 30.0
"""Limits of animations, in [s] and in pictures per second."""

MAX_PIXELS = 500e6
"""Largest number of pixels of an animation, which is kept in memory."""


def count(seconds: float, fps: float) -> int:
    """Return the number of pictures of an animation."""
    return max(1, round(seconds * fps))


def check_length(seconds: float, fps: float, size: tuple[int, int]) -> None:
    """Check the size of an animation.

    Raises:
        InvalidValueError: If it is too long, too fast or too large.
    """
    for name, value, most in (("fps", fps, FASTEST), ("seconds", seconds, LONGEST)):
        if not 0.0 < value <= most:
            raise InvalidValueError(
                f"--{name} must be greater than 0 and at most {most:g} (got {value:g})."
            )
    pixels = count(seconds, fps) * size[0] * size[1]
    if pixels > MAX_PIXELS:
        raise InvalidValueError(
            f"An animation of {count(seconds, fps)} pictures of {size[0]}x{size[1]} "
            f"has {pixels / 1e6:.0f} million pixels; the limit is "
            f"{MAX_PIXELS / 1e6:.0f} million. Reduce --seconds, --fps or --size."
        )


PlacedRobot = Tuple[Optional[np.ndarray], Dict[str, float]]
"""A robot in a picture: pose of its root link in the map, shape (7,), None if unknown;
and positions of its joints in [rad] or [m] by name."""


def placed(
    robot: Description, base: np.ndarray | None, positions: dict[str, float]
) -> PlacedRobot:
    """Place a robot by the pose of its base, shape (7,)."""
    return None if base is None else compose(base, root_in_base(robot)), positions


class Moment(NamedTuple):
    """Robots and objects in a picture."""

    robots: Sequence[PlacedRobot]
    objects: Mapping[str, np.ndarray] = {}
    """T_map_object, shape (7,), by name."""

    forces: Sequence[Arrow] = ()
    """Contact forces, which are drawn on top."""


def frame(
    scene: Picture,
    moments: Sequence[Moment],
    view: str,
    size: tuple[int, int],
) -> tuple[Camera, float]:
    """Place a camera that sees the robots at all times.

    Args:
        scene: The robots.
        moments: All that is in each picture.
        view: Name of the view.
        size: Width and height of the picture in pixels.

    Returns:
        The camera, and the height of the floor in [m]: that of the map, or below the
        robots if their poses are unknown.

    Raises:
        InvalidValueError: If there is nothing to see.
    """
    corners = []
    for moment in moments:
        place(scene, moment)
        corners.append(scene.subject())
    points = np.concatenate(corners)
    if not points.size:
        raise InvalidValueError(
            "Nothing to draw: the robot has no visual shapes, or they cannot be read."
        )
    is_placed = any(root is not None for root, _ in moments[0].robots)
    floor = 0.0 if is_placed else float(points[:, 2].min())
    return framing(points, *VIEWS[view], size[0] / size[1]), floor


def place(scene: Picture, moment: Moment) -> None:
    """Place all robots and objects; without a base, a root is at the origin."""
    for number, (root, positions) in enumerate(moment.robots):
        scene.place(number, IDENTITY if root is None else root, positions)
    if moment.objects:
        scene.move(len(moment.robots), moment.objects)


def forces_of(moment: Moment) -> Picture | None:
    """Return what is drawn on top; None: nothing."""
    if not moment.forces:
        return None
    on_top = Picture()
    for arrow in moment.forces:
        on_top.add_triangles(arrow.corners(), arrow.color)
    return on_top


def motion_of(robot: Description, placed: PlacedRobot) -> Motion:
    """Make a motion of one sample of a placed robot."""
    root, positions = placed
    base = None if root is None else compose(root, inverse(root_in_base(robot)))
    return configuration(positions, base)


def drawn(n: int, picture: Callable[[int], np.ndarray]) -> Iterator[np.ndarray]:
    """Draw all pictures of an animation, and show the progress.

    On a terminal after each picture, elsewhere after 25.

    Args:
        n: Number of pictures.
        picture: Draws one, as uint8, shape (height, width, 3).

    Raises:
        KeyboardInterrupt: If the node was shut down meanwhile.
    """
    for k in range(n):
        if is_shut_down():
            raise KeyboardInterrupt
        yield picture(k)
        done, is_terminal = k + 1, sys.stderr.isatty()
        if is_terminal or done == n or done % 25 == 0:
            begin, end = ("\r", "" if done < n else "\n") if is_terminal else ("", "\n")
            text = f"{begin}frame {done} of {n}"
            print(text, end=end, file=sys.stderr, flush=True)


def film(n: int, picture: Callable[[int], np.ndarray]) -> list[Image.Image]:
    """Draw all pictures of a GIF, with one palette.

    Args:
        n: Number of pictures.
        picture: Draws one, as uint8, shape (height, width, 3).

    Raises:
        KeyboardInterrupt: If the node was shut down meanwhile.
    """
    palette = palette_of([picture(k) for k in {0, n // 2, n - 1}])
    return [in_colors(pixels, palette) for pixels in drawn(n, picture)]


def write_video(
    path: Path, pictures: Iterable[np.ndarray], size: tuple[int, int], rate: float
) -> None:
    """Write an mp4.

    Args:
        path: The file.
        pictures: As uint8, shape (height, width, 3).
        size: Width and height in pixels; must be even.
        rate: Pictures per second in [Hz].

    Raises:
        InvalidValueError: If it cannot be written; an existing file is kept.
    """
    import imageio_ffmpeg

    command = [
        *(imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-y"),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}"),
        *("-r", f"{rate}", "-i", "-", "-c:v", "libx264", "-pix_fmt", "yuv420p"),
    ]
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as errors:
        whole = Path(folder) / "film.mp4"
        with subprocess.Popen(
            [*command, str(whole)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=errors,
        ) as encoder:
            try:
                for picture in pictures:
                    encoder.stdin.write(np.ascontiguousarray(picture).tobytes())
            except BrokenPipeError:  # it has ended; its message is read below
                pass
            except BaseException:
                encoder.kill()
                raise
            finally:
                with contextlib.suppress(BrokenPipeError):
                    encoder.stdin.close()
        if encoder.returncode or not whole.exists():
            errors.seek(0)
            lines = errors.read().decode("utf-8", "replace").strip().splitlines()
            problem = lines[-1] if lines else f"it ended with {encoder.returncode}"
            raise InvalidValueError(f"ffmpeg cannot write {path.name}: {problem}.")
        write_whole(path, whole.read_bytes())
