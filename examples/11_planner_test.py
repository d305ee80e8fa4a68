"""Test a planner, by pytest or as a program; a rostest is in examples/reach_planner."""

import numpy as np

from g1_description import Robot

robot = Robot()


def plan(joint, goal, duration):
    """Plan from standing: the planner under test."""
    s = np.linspace(0.0, 1.0, 51)
    rows = np.tile(robot.named_configuration("stand"), (len(s), 1))
    column = robot.joint_row(joint)
    rows[:, column] += (goal - rows[0, column]) * (3 * s**2 - 2 * s**3)
    return robot.on_floor(
        robot.trajectory(duration * s, rows, base=[[0, 0, 0.8, 0, 0, 0, 1]] * 51)
    )


def test_a_plan_is_good():
    """Nothing is wrong with it; else there is a page of it."""
    motion = plan("left_shoulder_roll_joint", 1.2, 2.0)
    verdict = robot.check(motion)
    if not verdict.passed:
        robot.write_page("plan.html", motion, verdict)
    assert verdict.passed, f"{[f.text for f in verdict.findings]}; see plan.html"


def test_a_plan_that_is_too_fast_is_found():
    """The check finds the joint."""
    verdict = robot.check(plan("left_shoulder_roll_joint", 1.2, 0.04))
    assert "velocity" in [finding.check for finding in verdict.findings]


if __name__ == "__main__":
    test_a_plan_is_good()
    test_a_plan_that_is_too_fast_is_found()
    print("2 tests passed")
