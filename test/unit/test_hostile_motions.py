"""Hostile files of motions are refused in a sentence, in 5 s and 1 GB."""

import bz2
import io
import json
import os
import struct
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from conftest import REPOSITORY

LIMITED = REPOSITORY / "test" / "limited.py"
SECONDS = 5.0
JOINT_STATE = b"3066dcd76a6cfaef579bd0f34173e9fd"


def zipped(members, compression=zipfile.ZIP_DEFLATED):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file.getvalue()


def npy(shape, content=b"", dtype="<f8"):
    """Make an array whose header claims a shape."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        file, {"descr": dtype, "fortran_order": False, "shape": shape}
    )
    return file.getvalue() + content


def of_many_arrays():
    """Make all arrays as large as one may be: 8 times 90 MB of zeros."""
    names = "fps joint_pos joint_vel body_pos_w body_quat_w root_pos root_rot dof_pos"
    zeros = npy((90_000_000,), bytes(90_000_000), "|i1")
    return zipped({f"{name}.npy": zeros for name in names.split()})


def of_many_members():
    """Make a zip file of two million files that are not there."""
    entry = b"PK\x01\x02" + bytes(24) + struct.pack("<H", 1) + bytes(16) + b"a"
    count = 2_000_000
    end = b"PK\x05\x06" + bytes(4) + struct.pack("<HHIIH", 0xFFFF, 0xFFFF, 0, 0, 0)
    end = end[:12] + struct.pack("<IIH", count * len(entry), 4, 0)
    return b"PK\x03\x04" + entry * count + end


def text(content):
    data = content.encode()
    return b"X" + struct.pack("<I", len(data)) + data


def of_tuples(end):
    """Make a tuple of twice a tuple of twice a tuple, and so on."""
    return b"\x80\x02}(K\x01" + b"q\x01h\x01\x86" * 60 + end


def of_encoding():
    """Encode one text of 40 MB a hundred times."""
    name = b"c_codecs\nencode\n"
    return (
        b"\x80\x02]("
        + text("x" * 40_000_000)
        + b"q\x01"
        + (name + b"h\x01\x85R") * 100
        + b"e."
    )


def of_merges(depth):
    """Make mappings that are merged of ten of the ones before, again and again."""
    lines = ["m0: &m0 {a: 1}"]
    for n in range(depth):
        lines.append(f"m{n + 1}: &m{n + 1} {{<<: [{', '.join([f'*m{n}'] * 10)}]}}")
    return "\n".join([*lines, "joint_names: [a]", "points: []"])


def of_aliases(depth):
    """Make lists of ten of the ones before, again and again."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    for n in range(depth):
        lines.append(f"a{n + 1}: &a{n + 1} [{', '.join([f'*a{n}'] * 10)}]")
    return "\n".join([*lines, f"joint_names: [*a{depth}]", "points: []"])


def record(fields, data=b""):
    """Make a record of a bag."""
    parts = [name.encode() + b"=" + value for name, value in fields.items()]
    header = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def bag(chunk, packing=b"none", size=None, counts=(1, 1), kind=JOINT_STATE):
    """Make a bag of one chunk, with a topic of joint states.

    Args:
        chunk: The chunk as it is in the file.
        packing: How it is said to be compressed.
        size: Its size that is said; by default the true one.
        counts: Numbers of connections and chunks that are said to be there.
        kind: The md5 sum of the topic's messages.
    """
    size = struct.pack("<I", len(chunk) if size is None else size)
    start = b"#ROSBAG V2.0\n"
    chunk = record({"op": b"\x05", "compression": packing, "size": size}, chunk)
    place = len(start) + 4096
    content = record({"type": b"sensor_msgs/JointState", "md5sum": kind})[:-4]
    index = record(
        {"op": b"\x07", "conn": bytes(4), "topic": b"/joint_states"}, content[4:]
    )
    info = {"op": b"\x06", "chunk_pos": struct.pack("<Q", place)}
    index += record(info, struct.pack("<II", 0, 1))
    head = record(
        {
            "op": b"\x03",
            "index_pos": struct.pack("<Q", place + len(chunk)),
            "conn_count": struct.pack("<I", counts[0]),
            "chunk_count": struct.pack("<I", counts[1]),
        }
    )
    return start + head.ljust(4096, b"\0") + chunk + index


def message(data):
    return record({"op": b"\x02", "conn": bytes(4), "time": b"\1" * 8}, data)


def bz2_bomb():
    """Pack 150 MB of zeros into some hundred bytes."""
    packer = bz2.BZ2Compressor()
    parts = [packer.compress(bytes(10_000_000)) for _ in range(15)]
    return b"".join([*parts, packer.flush()])


def lz4_bomb():
    """Pack 150 MB of zeros into half a megabyte."""
    roslz4 = pytest.importorskip("roslz4")
    packer = roslz4.LZ4Compressor()
    parts = [packer.compress(bytes(1_000_000)) for _ in range(150)]
    return b"".join([*parts, packer.flush()])


HEADER = bytes(16)
"""Of a message, without stamp and frame."""

MANY = struct.pack("<I", 2**32 - 1)

HOSTILE = {
    "bag of bz2": (
        lambda: bag(bz2_bomb(), b"bz2", 10**6),
        "1000000 bytes and has more",
    ),
    "bag of lz4": (
        lambda: bag(lz4_bomb(), b"lz4", 10**6),
        "1000000 bytes and has more",
    ),
    "large bag of bz2": (
        lambda: bag(bz2_bomb(), b"bz2", 10**8),
        "100000000 bytes and has more",
    ),
    "claim in a bag": (lambda: bag(b"", b"bz2", 2**32 - 1), "more than 100 MB where"),
    "other packing": (lambda: bag(b"", b"zip"), "compressed as 'zip'"),
    "many chunks": (lambda: bag(b"", counts=(1, 2**32 - 1)), "has 4294967295 chunks"),
    "more chunks": (lambda: bag(b"", counts=(1, 9999)), "bag is"),
    "many messages": (
        lambda: bag(message(b"") * 260_000, kind=b"x" * 32),
        "it has /joint_states",
    ),
    "many states": (
        lambda: bag(message(HEADER + bytes(16)) * 260_000),
        "more than 250000 messages",
    ),
    "many names": (lambda: bag(message(HEADER + MANY)), "names 4294967295 joints"),
    "empty names": (
        lambda: bag(
            message(HEADER + struct.pack("<I", 24_000_000) + bytes(96_000_000))
        ),
        "names 24000000 joints",
    ),
    "many numbers": (
        lambda: bag(message(HEADER + bytes(4) + MANY)),
        "The message ends after 24",
    ),
    "many positions": (
        lambda: bag(
            message(HEADER + bytes(4) + struct.pack("<I", 10**7) + bytes(80_000_008))
        ),
        "has 10000000 positions of 0 joints",
    ),
    "many joints": (
        lambda: bag(
            b"".join(
                message(
                    HEADER[:4]
                    + b"\1\0\0\0"
                    + struct.pack("<I", n)
                    + bytes(4)
                    + b"\1\0\0\0\4\0\0\0"
                    + struct.pack("<I", n)
                    + b"\1\0\0\0"
                    + bytes(16)
                )
                for n in range(20_000)
            )
        ),
        "more than 12000000 numbers",
    ),
    "tuples as key": (lambda: of_tuples(b"K\x01u."), "dictionary with a tuple as key"),
    "tuples as name": (
        lambda: b"\x80\x04K\x01" + b"\x94h\x00\x86" * 60 + b"K\x01\x93.",
        "asks for something without a name",
    ),
    "tuples in a set": (lambda: of_tuples(b"\x90."), "has a step"),
    "encoding": (of_encoding, "too much to encode"),
    "steps": (lambda: b"\x80\x02" + b"N0" * 49_000_000, "has a step POP"),
    "many steps": (lambda: b"\x80\x02](" + b"N" * 99_000_000, "more than 500000 steps"),
    "arguments": (
        lambda: b"\x80\x02ccollections\nOrderedDict\n" + text("x" * 90_000_000) + b"R.",
        "without arguments",
    ),
    "bytes of 10 GB": (
        lambda: b"\x80\x05\x96" + struct.pack("<Q", 10**10) + bytes(100),
        "cannot be read: expected 10000000000 bytes",
    ),
    "long type": (
        lambda: b"\x80\x02cnumpy\ndtype\n" + text("f8," * 9_000_000) + b"\x85R.",
        "type that is no text",
    ),
    "long number": (lambda: b"\x80\x02I" + b"1" * 9_000_000 + b"\n.", "has a step INT"),
    "nested lists": (lambda: "joint_names: " + "[" * 200_000, "is nested 21 levels"),
    "nested lines": (
        lambda: "joint_names:\n" + "\n".join(" " * n + "-" for n in range(1500)),
        "is nested 21 levels",
    ),
    "merges": (lambda: of_merges(30), "Line 1 has an anchor"),
    "aliases": (lambda: of_aliases(30), "Line 1 has an anchor"),
    "long text": (
        lambda: "joint_names: [" + "a, " * 5_000_000,
        "15 million characters",
    ),
    "long list": (
        lambda: "joint_names: [" + "a, " * 990_000 + "]\npoints: []",
        "names",
    ),
    "two columns": (lambda: "time,left_elbow_joint\n" + "1,2\n" * 24_999_000, "lines"),
    "two numbers": (lambda: "1,2\n" * 25_000_000, "has 2 columns"),
    "many rows": (
        lambda: ",".join(["0"] * 36) + "\n" + (",".join(["0"] * 36) + "\n") * 230_000,
        "more numbers than 8000000",
    ),
    "no lines": (lambda: "\n" * 100_000_000, "more than 1000000 lines"),
    "old lines": (lambda: "#\r" * 50_000_000, "more than 1000000 lines"),
    "one line": (lambda: "1" * 100_000_000, "has 1 columns and 100000000 characters"),
    "a million columns": (lambda: ",".join(["0.5"] * 1_000_000), "1000000 columns"),
    "a million names": (
        lambda: "time," + ",".join(f"a{n}" for n in range(1_000_000)),
        "1000001 columns",
    ),
    "claim of 10 GB": (
        lambda: zipped({"dof_pos.npy": npy((1_250_000_000,), bytes(80))}),
        "should have 10000000000 bytes",
    ),
    "zip bomb": (
        lambda: zipped({"dof_pos.npy": bytes(300_000_000)}),
        "has 300 MB",
    ),
    "many arrays": (of_many_arrays, "has 720 MB"),
    "many members": (of_many_members, "more than 1000 files"),
    "other compression": (
        lambda: zipped({"dof_pos.npy": bytes(1000)}, zipfile.ZIP_LZMA),
        "compressed as numpy does not",
    ),
    "large names": (
        lambda: zipped(
            {
                "joint_names.npy": npy((1000,), bytes(4_000_000), "<U1000"),
                "fps.npy": b"",
            }
        ),
        "holds no names",
    ),
}


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """Give what is said of each file, and what it took."""
    folder = tmp_path_factory.mktemp("hostile")
    found = {}
    path = os.pathsep.join([str(REPOSITORY / "src"), *sys.path])
    robot = REPOSITORY / "urdf" / "g1_29dof.urdf"
    for name, (make, _) in HOSTILE.items():
        content = make()
        file = folder / name
        file.write_bytes(content.encode() if isinstance(content, str) else content)
    run = subprocess.run(
        [sys.executable, LIMITED, robot, *(folder / name for name in HOSTILE)],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        text=True,
        timeout=600,
        check=True,
    )
    for line in run.stdout.splitlines():
        name, *rest = json.loads(line)
        found[name] = rest
    for name in HOSTILE:
        (folder / name).unlink()
    return found


@pytest.mark.slow
@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_file_is_refused_in_little_time_and_memory(outcomes, case):
    assert case in outcomes, "the reader was ended by its limits"
    sentence, seconds, size = outcomes[case]
    print(case, sentence, seconds, size / 1e6)
    assert HOSTILE[case][1] in sentence
    assert "\n" not in sentence
    assert len(sentence) < 500
    assert seconds < SECONDS
    assert size < 1e9
