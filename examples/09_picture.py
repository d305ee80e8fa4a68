"""Draw a motion: a picture of one time, and an animation; no screen is needed."""

import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

SNAPSHOT = ["rosrun", "g1_description", "snapshot"]

with TemporaryDirectory() as folder:
    for name, options in {
        "squat.png": "--time 2.8 --view side --size 400x400",
        "squat.gif": "--size 160x120 --fps 5",
    }.items():
        file = Path(folder, name)
        command = [*SNAPSHOT, file, "--motion", "squat.csv", *options.split()]
        subprocess.run(command, check=True, capture_output=True)
        print(f"{name}: {'not ' * (file.stat().st_size < 1000)}written")
