"""Write a page on motions: a table of findings, their sentences and plots."""

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
    print("plots:", text.count("over time"), "pictures:", text.count("<figure>"))

# In the browser, with the robot: rosrun g1_description web --motion faulty.csv
