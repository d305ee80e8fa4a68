"""What came of a part: how many cases passed, and which ones did not, or took long."""

from dataclasses import dataclass, field
from xml.etree import ElementTree


@dataclass
class Outcome:
    """Cases of one part: a count, and a text for each that did not pass."""

    passed: int = 0
    failed: list = field(default_factory=list)
    skipped: list = field(default_factory=list)
    details: str = ""  # output of the program, shown when something failed
    times: list = field(default_factory=list)  # seconds and name of each case
    processor: float = 0.0  # [s] used by the part's programs

    def add(self, other):
        """Count the cases of another outcome in."""
        self.passed += other.passed
        self.failed += other.failed
        self.skipped += other.skipped
        self.details += other.details
        self.times += other.times
        self.processor += other.processor

    def check(self, good, text):
        """Count one case, with a text for when it is not good."""
        if good:
            self.passed += 1
        else:
            self.failed.append(text)

    def __str__(self):
        """Count in words."""
        return (
            f"{self.passed} passed, {len(self.failed)} failed, "
            f"{len(self.skipped)} skipped"
        )


def read_junit(file):
    """Count the cases of a result file in JUnit's format."""
    outcome = Outcome()
    try:
        cases = ElementTree.parse(file).iter("testcase")
    except ElementTree.ParseError as error:  # the program was ended while it wrote
        return Outcome(failed=[f"{file.name} cannot be read: {error}"])
    for case in cases:
        name = f"{case.get('classname')}.{case.get('name')}"
        outcome.times.append((float(case.get("time") or 0.0), name))
        faults = [*case.iter("failure"), *case.iter("error")]
        skip = case.find("skipped")
        if faults:
            text = "\n".join(fault.text or fault.get("message", "") for fault in faults)
            outcome.failed.append(f"{name}\n{text}")
        elif skip is not None:
            outcome.skipped.append(f"{name}: {skip.get('message')}")
        else:
            outcome.passed += 1
    return outcome
