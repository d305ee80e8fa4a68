"""Pictures as text: colours and places of their pixels."""

import io
import re

import numpy as np
from PIL import Image

from g1_description.render.terminal import beside

PIXEL = re.compile(r"\x1b\[38;2;(\d+);(\d+);(\d+);48;2;(\d+);(\d+);(\d+)m\u2580")


def png(pixels):
    content = io.BytesIO()
    Image.fromarray(pixels).save(content, "PNG")
    return content.getvalue()


def test_two_pictures_keep_their_pixels():
    """At their own size: the upper pixel in the foreground, the lower one behind it."""
    chance = np.random.default_rng(0)
    pictures = chance.integers(0, 256, (2, 6, 4, 3), dtype=np.uint8)
    lines = beside([png(picture) for picture in pictures], 4).split("\n")
    assert len(lines) == 3
    found = np.array([PIXEL.findall(line) for line in lines], int)  # 3 rows, 8 columns
    found = found.reshape(3, 2, 4, 2, 3).transpose(1, 0, 3, 2, 4).reshape(2, 6, 4, 3)
    np.testing.assert_array_equal(found, pictures)
    for line in lines:
        assert PIXEL.sub("#", line) == "  ####\x1b[0m  ####\x1b[0m"
