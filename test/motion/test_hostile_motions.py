"""Hostile files of motions are refused in a sentence, in 5 s and 1 GB."""

import base64
import io
import json
import os
import pickle
import struct
import subprocess
import sys
import zipfile
import zlib

import numpy as np
import pytest
from conftest import REPOSITORY
from mcap.writer import Writer

from g1_description.motion.files import gmr

LIMITED = REPOSITORY / "test" / "limited.py"
SECONDS = 5.0
PACKED_ZEROS = (
    "QlpoOTFBWSZTWQ4J4t8BX45AAMAAAAggADCATUZCoCWpCoCXMUFZJlNZDgni3wFfjkAAwAAACCAA"
    "MIBNRkKgJakKgJcxQVkmU1nHGW04AEZ6QQDAAAAQAAggADDMBSmmJVFDYkqih4u5IpwoSHGWkf0A"
)
JOINT_STATE = b"3066dcd76a6cfaef579bd0f34173e9fd"


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


def text(content):
    data = content.encode()
    return b"X" + struct.pack("<I", len(data)) + data


def torch(shape, stride):
    """Make a file of torch with a tensor of one number."""
    numbers = b"".join(pickle.dumps(part, 2)[2:-1] for part in (0, shape, stride))
    place = b"((X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000NK\x01tQ"
    content = b"ctorch._utils\n_rebuild_tensor_v2\n" + place + numbers + b"tR"
    items = b"".join(text(name) + b"N" for name in ("rigid_body_pos", "rigid_body_rot"))
    items += text("fps") + b"K\x01" + text("dof_pos") + content
    return zipped({"a/data.pkl": b"\x80\x02}(" + items + b"u.", "a/data/0": bytes(4)})


def of_merges(depth):
    """Make mappings that are merged of ten of the ones before, again and again."""
    lines = ["m0: &m0 {a: 1}"]
    for n in range(depth):
        lines.append(f"m{n + 1}: &m{n + 1} {{<<: [{', '.join([f'*m{n}'] * 10)}]}}")
    return "\n".join([*lines, "joint_names: [a]", "points: []"])


def record(fields, data=b""):
    """Make a record of a bag."""
    parts = [name.encode() + b"=" + value for name, value in fields.items()]
    header = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def bag(chunk, packing=b"none", size=None, count=1):
    """Make a bag of one chunk with joint_states.

    Args:
        chunk: The chunk as it is in the file.
        packing: How it is said to be compressed.
        size: Its size that is said; by default the true one.
        count: How many messages its index names.
    """
    size = struct.pack("<I", len(chunk) if size is None else size)
    start = b"#ROSBAG V2.0\n"
    place = len(start) + 4096
    chunk = record({"op": b"\x05", "compression": packing, "size": size}, chunk)
    one, number = struct.pack("<I", 1), struct.pack("<I", count)
    chunk += record(
        {"op": b"\x04", "ver": one, "conn": bytes(4), "count": number},
        (b"\1" * 8 + bytes(4)) * count,
    )
    content = {"type": b"some/Type", "md5sum": JOINT_STATE, "message_definition": b""}
    index = record(
        {"op": b"\x07", "conn": bytes(4), "topic": b"/joint_states"},
        record(content)[4:-4],
    )
    info = {"op": b"\x06", "ver": one, "chunk_pos": struct.pack("<Q", place)}
    info.update(start_time=bytes(8), end_time=bytes(8), count=one)
    index += record(info, bytes(4) + number)
    head = record(
        {
            "op": b"\x03",
            "index_pos": struct.pack("<Q", place + len(chunk)),
            "conn_count": one,
            "chunk_count": one,
        }
    )
    return start + head.ljust(4096, b"\0") + chunk + index


def bz2_bomb():
    """Give 101 MB of zeros, packed; to pack them takes bz2 14 s."""
    return base64.b64decode(PACKED_ZEROS)


def zstd_bomb():
    """Give 300 MB of zeros in a chunk."""
    file = io.BytesIO()
    writer = Writer(file)
    writer.start()
    schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
    channel = writer.register_channel("/joint_states", "cdr", schema)
    writer.add_message(channel, 1, bytes(300_000_000), 1)
    writer.finish()
    return file.getvalue()


HOSTILE = {
    "bag of bz2": (
        lambda: bag(bz2_bomb(), b"bz2", 10**6),
        "A chunk of the bag has more than 100 MB",
    ),
    "mcap of zstd": (zstd_bomb, "A chunk of the bag has more than 100 MB"),
    "bytes of 10 GB": (
        lambda: b"\x80\x05\x96" + struct.pack("<Q", 10**10) + bytes(100),
        "The pickle cannot be read: MemoryError",
    ),
    "zlib": (
        lambda: zlib.compress(bytes(300_000_000), 1),
        "Decompressed, the file has more than 200 MB",
    ),
    "many members": (
        lambda: zipped({f"{n}.npy": b"" for n in range(20_000)}, zipfile.ZIP_STORED),
        "more than 10000 files",
    ),
    "one storage many times": (
        lambda: torch((10**9, 29, 3), (0, 0, 0)),
        "dof_pos has 87000000000 numbers",
    ),
    "many fields": (
        lambda: b"\x08\x01" * 40_000_000 + b"body_quat_w",
        "more than 500000 fields",
    ),
    "entities": (
        lambda: "<!DOCTYPE a [<!ENTITY b 'c'>]><mujoco>&b;</mujoco>",
        "DOCTYPE",
    ),
    "merges": (lambda: of_merges(30), "Line 1 has an anchor"),
    "zip bomb": (
        lambda: zipped(
            {
                **{f"{name}.npy": npy((0,)) for name in gmr.FORMAT.arrays},
                "dof_pos.npy": bytes(300_000_000),
            }
        ),
        "dof_pos has 300 MB",
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
