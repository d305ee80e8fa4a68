"""Write a page on motions: the robot, a time line, findings and plots, in one file."""

import re
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

CHECK = ["rosrun", "g1_description", "check"]

with TemporaryDirectory() as folder:
    page = Path(folder, "report.html")
    files = ["squat.csv", "faulty.csv"]
    run = subprocess.run(
        [*CHECK, *files, "--html", page], stdout=subprocess.PIPE, text=True
    )
    print("exit code", run.returncode)
    print(run.stdout.splitlines()[-1])
    text = page.read_text()
    print(re.search("<title>(.*)</title>", text)[1])
    print("motions:", text.count("<section"), "findings:", text.count("<button"))

# To edit it as well: rosrun g1_description web --motion faulty.csv
