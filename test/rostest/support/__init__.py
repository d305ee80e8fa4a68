"""What the rostests share: processes, listeners, raw sockets and robots."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "tools"))

import g1_description  # noqa: F401  finds the packages of its environment
