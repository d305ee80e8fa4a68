"""Hostile files of motions are refused in a sentence, in 5 s and 1 GB."""

import base64
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

from g1_description.motion.files.arrays import TRACKED

LIMITED = REPOSITORY / "test" / "limited.py"
SECONDS = 5.0
PACKED_ZEROS = (
    "QlpoOTFBWSZTWQ4J4t8BX45AAMAAAAggADCATUZCoCWpCoCXMUFZJlNZDgni3wFfjkAAwAAACCAA"
    "MIBNRkKgJakKgJcxQVkmU1nHGW04AEZ6QQDAAAAQAAggADDMBSmmJVFDYkqih4u5IpwoSHGWkf0A"
)
JOINT_STATE = b"3066dcd76a6cfaef579bd0f34173e9fd"
JOINT_TRAJECTORY = b"65b4f94a94d1ed67169da35a02f33d3f"
ROBOT_TRAJECTORY = b"dfa9556423d709a3729bcef664bddf67"
TRANSFORMS = b"94810edda583a504dfda3829e70d7eec"


def zipped(members, compression=zipfile.ZIP_DEFLATED):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression, compresslevel=1) as archive:
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


def of_many_values(count):
    """Make a record of a bag that has many values, each without a name."""
    header = struct.pack("<I", 1) + b"="
    return struct.pack("<I", count * len(header)) + header * count + bytes(4)


def bag(chunk, packing=b"none", size=None, counts=(1, 1), kinds=(JOINT_STATE,)):
    """Make a bag of one chunk, with topics of which the first is joint_states.

    Args:
        chunk: The chunk as it is in the file.
        packing: How it is said to be compressed.
        size: Its size that is said; by default the true one.
        counts: Numbers of connections and chunks that are said to be there.
        kinds: The md5 sums of the topics' messages.
    """
    size = struct.pack("<I", len(chunk) if size is None else size)
    start = b"#ROSBAG V2.0\n"
    chunk = record({"op": b"\x05", "compression": packing, "size": size}, chunk)
    place, index, pairs = len(start) + 4096, b"", b""
    for number, kind in enumerate(kinds):
        content = record({"type": b"some/Type", "md5sum": kind})[:-4]
        topic = b"/topic" if number else b"/joint_states"
        conn = struct.pack("<I", number)
        index += record({"op": b"\x07", "conn": conn, "topic": topic}, content[4:])
        pairs += conn + b"\1\0\0\0"
    info = {"op": b"\x06", "chunk_pos": struct.pack("<Q", place)}
    index += record(info, pairs)
    head = record(
        {
            "op": b"\x03",
            "index_pos": struct.pack("<Q", place + len(chunk)),
            "conn_count": struct.pack("<I", max(counts[0], len(kinds))),
            "chunk_count": struct.pack("<I", counts[1]),
        }
    )
    return start + head.ljust(4096, b"\0") + chunk + index


def message(data, topic=0, kind=b"\x02"):
    number = struct.pack("<I", topic)
    return record({"op": kind, "conn": number, "time": b"\1" * 8}, data)


def listed(*parts):
    return struct.pack("<I", len(parts)) + b"".join(parts)


def named(text):
    return struct.pack("<I", len(text)) + text


def numbers(count):
    return struct.pack("<I", count) + bytes(8 * count)


def of_new_names(n_messages, n_names):
    """Make joint states that name other joints each time."""
    one = struct.Struct("<II").pack
    return bag(
        b"".join(
            message(
                HEADER
                + listed(*(one(4, m * n_names + n) for n in range(n_names)))
                + numbers(n_names)
                + bytes(8)
            )
            for m in range(n_messages)
        )
    )


def of_other_lists(n_messages, n_names):
    """Make joint states that name the same joints in another order each time."""
    names = [named(b"%06d" % n) for n in range(n_names)]
    return bag(
        b"".join(
            message(
                HEADER
                + listed(*names[m % n_names :], *names[: m % n_names])
                + numbers(n_names)
                + bytes(8)
            )
            for m in range(n_messages)
        )
    )


def of_points(count, names=(), numbers_of_point=0, base=0):
    """Make a trajectory; its points' accelerations are none."""
    point = numbers(numbers_of_point) * 2 + bytes(16)
    content = HEADER + listed(*map(named, names)) + struct.pack("<I", count)
    content += point * count
    if not base:
        return bag(message(content), kinds=(JOINT_TRAJECTORY,))
    content += HEADER + bytes(4) + struct.pack("<I", base)
    content += (b"\1\0\0\0" + bytes(48) + struct.pack("<d", 1) + bytes(16)) * base
    return bag(message(content), kinds=(ROBOT_TRAJECTORY,))


def of_transforms(count, n_messages, child=b""):
    """Make a joint state, and messages of many transforms."""
    state = message(HEADER + listed(named(b"left_elbow_joint")) + numbers(1) + bytes(8))
    edges = (HEADER + named(child) + bytes(56)) * count
    transforms = message(struct.pack("<I", count) + edges, 1)
    return bag(state + transforms * n_messages, kinds=(JOINT_STATE, TRANSFORMS))


def bz2_bomb():
    """Give 101 MB of zeros, packed; to pack them takes bz2 14 s."""
    return base64.b64decode(PACKED_ZEROS)


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
        lambda: bag(message(b"") * 260_000, kinds=(b"x" * 32,)),
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
    "new names": (lambda: of_new_names(500, 10_000), "more than 12000000 numbers"),
    "few new names": (lambda: of_new_names(4000, 50), "more than 12000000 numbers"),
    "other lists": (lambda: of_other_lists(400, 10_000), "1000000 points, transf"),
    "long names": (
        lambda: bag(message(HEADER + listed(named(bytes(95_000_000))) + bytes(12))),
        "more than 60 MB of text",
    ),
    "efforts": (
        lambda: bag(
            message(HEADER + listed(named(b"a")) + numbers(1) + bytes(90_000)) * 1000
        ),
        "none of the motion's joints",
    ),
    "empty points": (lambda: of_points(4_000_000), "1000000 points, transforms or"),
    "points": (lambda: of_points(249_000, base=249_000), "times of the motion do not"),
    "wide points": (
        lambda: of_points(9, [b"a"], 10**5),
        "1 has 100000 numbers, not 1",
    ),
    "other records": (
        lambda: bag(message(b"", kind=b"\x07") * 1_000_000),
        "more than 250000 messages",
    ),
    "values of a record": (
        lambda: bag(of_many_values(12_000_000)),
        "a record has 20 values",
    ),
    "large index": (
        lambda: bag(b"") + bytes(90_000_000),
        "an index of 90 MB",
    ),
    "chunk that says it is empty": (
        lambda: bag(bytes(100_000_001), size=0),
        "more than 100 MB where",
    ),
    "transforms": (lambda: of_transforms(1_300_000, 1), "1000000 points, transforms"),
    "messages of transforms": (
        lambda: of_transforms(1, 249_000),
        "1 samples",
    ),
    "base poses": (
        lambda: of_transforms(99_000, 8, b"base_link"),
        "more than 250000 base poses",
    ),
    "tuples as name": (
        lambda: b"\x80\x04K\x01" + b"\x94h\x00\x86" * 60 + b"K\x01\x93.",
        "cannot be read: STACK_GLOBAL requires str",
    ),
    "encoding": (of_encoding, "too much to encode"),
    "steps": (lambda: b"\x80\x02" + b"N0" * 49_000_000, "more than 500000 steps"),
    "many steps": (lambda: b"\x80\x02](" + b"N" * 99_000_000, "more than 500000 steps"),
    "arguments": (
        lambda: b"\x80\x02ccollections\nOrderedDict\n" + text("x" * 90_000_000) + b"R.",
        "argument list must be a tuple",
    ),
    "bytes of 10 GB": (
        lambda: b"\x80\x05\x96" + struct.pack("<Q", 10**10) + bytes(100),
        "cannot be read: expected 10000000000 bytes",
    ),
    "long type": (
        lambda: b"\x80\x02cnumpy\ndtype\n" + text("f8," * 9_000_000) + b"\x85R.",
        "without a short name",
    ),
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
        "npz file cannot be read: Unable to allocate",
    ),
    "zip bomb": (
        lambda: zipped({"dof_pos.npy": bytes(300_000_000)}),
        "have 300 MB",
    ),
    "many arrays": (of_many_arrays, "have 720 MB"),
    "many members": (of_many_members, "more than 1000 files"),
    "large names": (
        lambda: zipped(
            {
                **{f"{name}.npy": npy((0,)) for name in TRACKED},
                "joint_names.npy": npy((1000,), bytes(4_000_000), "<U1000"),
            }
        ),
        "joint_names holds no list of names",
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
