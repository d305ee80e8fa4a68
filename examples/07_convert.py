"""Read a motion, edit it, and write it in another format."""

from pathlib import Path
from tempfile import TemporaryDirectory

from g1_description import Robot
from g1_description.motion.edit import joined

robot = Robot()
wave = robot.read_motion("wave.csv")
print(f"{wave.duration} s, {len(wave.times)} samples, {len(wave.joint_names)} joints")

both = joined([wave.cut(1.5, 4.5), robot.mirrored(wave).cut(1.5, 4.5)], blend=0.5)
whole = robot.padded(both, begin="stand", end="stand")
slow = whole.at_speed(0.5).resampled(30.0)
print(
    f"right hand, left hand, slower: {slow.duration:.2f} s, {len(slow.times)} samples"
)

with TemporaryDirectory() as folder:
    for format in ("csv", "mjlab", "lafan1"):
        file = Path(folder, "slow.npz" if format == "mjlab" else "slow.csv")
        notes = robot.write_motion(file, slow, format=format)
        again = robot.read_motion(file, rate=30.0)
        print(f"{format}: {len(again.times)} samples", *notes)
