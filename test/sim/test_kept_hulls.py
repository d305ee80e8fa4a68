"""Thinned hulls in files: what an earlier run wrote is what thinning gives."""

import os
import subprocess
import sys

import numpy as np
import pytest

from g1_description.sim.meshes.hull_vertices import thinned
from g1_description.sim.meshes.kept_hulls import MAX_FILES, hull_folder, thinned_once

TOLERANCE = 0.01
POINTS = np.random.RandomState(1).normal(size=(500, 3)).astype(np.float32)
POINTS /= np.linalg.norm(POINTS, axis=1)[:, np.newaxis]

CHILD = """
import sys
import numpy as np
from g1_description.sim.meshes.kept_hulls import thinned_once
few, deviation = thinned_once(np.load(sys.argv[1]), float(sys.argv[2]))
np.save(sys.argv[3], few)
print(repr(deviation), "scipy" in sys.modules)
"""


@pytest.fixture(autouse=True)
def _cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def files():
    """List what is kept."""
    return sorted(hull_folder().glob("*"))


def check(points=POINTS, tolerance=TOLERANCE):
    """Compare with what thinning gives without files."""
    few, deviation = thinned_once(points, tolerance)
    expected, expected_deviation = thinned(points, tolerance)
    assert few.dtype == points.dtype
    assert few.tolist() == expected.tolist()
    assert deviation == expected_deviation


def test_another_process_takes_it_without_scipy(tmp_path):
    check()
    points, few = tmp_path / "points.npy", tmp_path / "few.npy"
    np.save(str(points), POINTS)
    command = [sys.executable, "-c", CHILD, points, str(TOLERANCE), few]
    result = subprocess.run(
        list(map(str, command)), check=True, stdout=subprocess.PIPE, text=True
    )
    expected, deviation = thinned(POINTS, TOLERANCE)
    assert result.stdout.splitlines()[-1] == f"{deviation!r} False"
    assert np.load(str(few)).tolist() == expected.tolist()


@pytest.mark.parametrize("change", ["size", "order", "tolerance", "type"])
def test_what_is_thinned_otherwise_is_another_hull(change):
    check()
    if change == "size":
        check(POINTS * np.float32(1.01))
    elif change == "order":
        check(POINTS[::-1])
    elif change == "tolerance":
        check(tolerance=2.0 * TOLERANCE)
    else:
        check(POINTS.astype(float))
    assert len(files()) == 2


def test_few_points_need_no_file():
    few, deviation = thinned_once(POINTS[:50], TOLERANCE)
    assert (few.tolist(), deviation) == (POINTS[:50].tolist(), 0.0)
    assert not files()


def test_what_cannot_be_thinned_needs_no_file():
    flat = POINTS * np.float32([1, 1, 0])
    few, deviation = thinned_once(flat, TOLERANCE)
    assert (few.tolist(), deviation) == (flat.tolist(), 0.0)
    assert not files()


@pytest.mark.parametrize("damage", ["empty", "cut", "text", "encrypted"])
def test_a_damaged_file_is_written_again(damage):
    check()
    (file,) = files()
    whole = file.read_bytes()
    encrypted = whole.replace(
        b"PK\x01\x02\x14\x03\x14\0\0", b"PK\x01\x02\x14\x03\x14\0\1"
    )
    damaged = {"empty": b"", "cut": whole[:-40], "text": b"no archive"}
    file.write_bytes(damaged.get(damage, encrypted))
    assert file.read_bytes() != whole
    check()
    assert file.read_bytes() == whole


@pytest.mark.parametrize(
    "arrays",
    [
        {"vertices": POINTS},
        {"points": POINTS[:9]},
        {"points": POINTS[:9].astype(float), "deviation": 0.0},
        {"points": POINTS[:9, :2], "deviation": 0.0},
        {"points": POINTS[:9, 0], "deviation": 0.0},
        {"points": POINTS[:0], "deviation": 0.0},
        {"points": POINTS, "deviation": 0.0},
        {"points": POINTS[:9], "deviation": "none"},
    ],
)
def test_a_file_of_something_else_is_written_again(arrays):
    check()
    (file,) = files()
    whole = file.read_bytes()
    np.savez(str(file), **arrays)
    check()
    assert file.read_bytes() == whole


def test_a_lone_array_is_written_again():
    check()
    (file,) = files()
    whole = file.read_bytes()
    with file.open("wb") as stream:
        np.save(stream, POINTS)
    check()
    assert file.read_bytes() == whole


def test_a_folder_that_cannot_be_written_is_done_without():
    folder = hull_folder()
    folder.parent.mkdir(parents=True)
    folder.write_text("a file where the folder should be")
    check()
    check()


def test_the_oldest_are_deleted():
    folder = hull_folder()
    folder.mkdir(parents=True)
    for number in range(MAX_FILES + 2):
        file = folder / f"{number}.npz"
        file.touch()
        os.utime(str(file), (number, number))
    check()
    left = files()
    assert len(left) == MAX_FILES
    assert not {folder / f"{number}.npz" for number in range(3)} & set(left)
    check()
    assert files() == left


def test_a_relative_cache_is_not_taken(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert hull_folder() == tmp_path / ".cache/g1_description/hulls"
    check()
    assert len(files()) == 1
