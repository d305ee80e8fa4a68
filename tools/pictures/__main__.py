"""Take the pictures of the browser view."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from support.browser import Browser, missing

from .shots import SCRIPTS, SHOTS, take

ROOT = Path(__file__).resolve().parents[2]


def parse() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="tools/browser_pictures", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "docs/images")
    parser.add_argument("--only", default=",".join(SHOTS), metavar="NAME,...")
    args = parser.parse_args()
    args.names = args.only.split(",")
    unknown = [name for name in args.names if name not in SHOTS]
    if unknown:
        parser.error(f"there is no picture {unknown[0]}, but {', '.join(SHOTS)}")
    if missing():
        parser.error(missing())
    return args


def main() -> None:
    """Take the requested pictures."""
    args = parse()
    args.folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder, Browser() as browser:
        for file in (ROOT / "motions").glob("*.csv"):
            shutil.copy(file, folder)
            below = Path(folder, "motions", "of_our_own")
            below.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, below)
        reports = "--csv", "motions/report.csv", "--plot", "plots"
        words = [sys.executable, str(SCRIPTS / "check"), "motions", *reports]
        subprocess.run(words, cwd=folder, stdout=subprocess.DEVNULL)
        for name in args.names:
            file = args.folder / SHOTS[name].file
            take(browser, SHOTS[name], Path(folder), file)
            print(f"{file}: {file.stat().st_size / 1000:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
