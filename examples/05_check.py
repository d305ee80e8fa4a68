"""Find what is wrong with a motion, with a finding for each fault."""

from g1_description import Robot

robot = Robot()
for name in ("squat.csv", "faulty.csv"):
    verdict = robot.check(name)
    print(f"{name}: {verdict.severity}")
    for finding in verdict.findings:
        print(f"  {finding.check:14} {finding.worst_time:.2f} s  {finding.text}")

# Other thresholds: a file like config/checks.yaml, or its content.
strict = robot.check(
    "squat.csv", only=["velocity"], thresholds={"velocity": {"failure": 0.05}}
)
print(f"squat.csv, at most 5 % of the velocity limits: {strict.severity}")
