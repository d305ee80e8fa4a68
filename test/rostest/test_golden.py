"""The stand-in answers and does what the real Gazebo was seen to answer and do.

One test method per observation in test/data/golden. Each agrees, or deviates as
docs/gazebo_compatibility.md says it shall; none may differ.
"""

import os
import sys
import unittest
from collections import Counter

from support.golden.cases import Comparison, as_lists, load_cases, with_numbers
from support.golden.effects import BEFORE, UNSEEN, Effects
from support.golden.page import PAGE, with_table
from support.golden.runs import RUNS
from support.golden.simulator import Simulator
from support.golden.topics import builder

REFUSED, ANSWERED, TRUE = 1, 2, 4
"""Numbers of the contract's deliberate deviations."""

DEVIATIONS = {
    "set_model_configuration.nan": REFUSED,
    "set_model_configuration.plus_inf": REFUSED,
    "set_model_configuration.minus_inf": REFUSED,
    "spawn_urdf_model.garbage": ANSWERED,
    "spawn_urdf_model.empty_xml": ANSWERED,
    "spawn_urdf_model.html": ANSWERED,
    "spawn_urdf_model.sdf_given": ANSWERED,
}
"""Cases in which the stand-in deliberately does something else."""

KNOWN = {
    "plain": {"damping": [0.0]},
    "scoped": {"damping": [0.0]},
    "type_revolute": {"damping": [0.0]},
    "type_continuous": {"damping": [0.0], "type": 1},
    "type_prismatic": {"damping": [0.0], "type": 2},
    "fixed_to_world": {"type": 3},
}
"""What get_joint_properties tells where Gazebo leaves it open, by case."""


class TestGolden(unittest.TestCase):
    outcomes = {}  # noqa: RUF012  (shared on purpose)

    @classmethod
    def setUpClass(cls):
        cls.simulator = Simulator()
        cls.addClassCleanup(cls.print_table)

    @classmethod
    def print_table(cls):
        """Print each case with its outcome, then the counts."""
        for name, outcome in cls.outcomes.items():
            print(f"{outcome:<50} {name}")
        counts = Counter(outcome.split(":")[0] for outcome in cls.outcomes.values())
        for outcome in ("agrees", "in part", "deviates", "differs"):
            print(f"{outcome}: {counts[outcome]}")
        sys.stdout.flush()

    def run_case(self, case):
        """Do one case and note its outcome."""
        self.outcomes[case["id"]] = "differs: it broke off"
        known = case["request"] or case["id"] in RUNS or builder(case["id"])
        self.assertTrue(known, "nobody knows what this case did")
        self.simulator.make_scene(case["scene"], case["gravity"])
        if case["id"] in DEVIATIONS:
            self.assert_deviates(case)
            outcome = f"deviates: number {DEVIATIONS[case['id']]}"
        else:
            outcome = self.assert_agrees(case)
        self.outcomes[case["id"]] = outcome

    def assert_agrees(self, case):
        """Compare a case; tell whether it agrees, in part, or with more told."""
        responses, effect, expected = self.act(case)
        outcome = "in part" if case["id"] in UNSEEN else "agrees"
        answers = as_lists(with_numbers(case["response"]))
        service, _, name = case["id"].partition(".")
        if service == "get_joint_properties" and name in KNOWN:
            outcome = f"deviates: number {TRUE}"
            answers[0].update(KNOWN[name])
        comparison = Comparison(case["tolerance"])
        comparison.compare("response", answers, responses)
        for name, value in expected.items():
            field = f"effect.{name}"
            if name == "joints":
                comparison.compare_whole(field, value, effect[name])
            else:
                comparison.compare(field, value, effect.get(name))
        if comparison.differences:
            self.outcomes[case["id"]] = "\n    ".join(
                ["differs:", *comparison.differences, "in"]
            )
            self.fail("\n".join([case["id"], *comparison.differences]))
        return outcome

    def act(self, case):
        """Do a case; give responses, effects seen, and effects expected."""
        expected = with_numbers(case["effect"])
        build = RUNS.get(case["id"]) or builder(case["id"])
        if build is not None:
            result = build(self.simulator, case)
            responses, effect = result if case["request"] else ([], result)
            return responses, effect, expected
        BEFORE.get(case["id"], lambda simulator: None)(self.simulator)
        responses, log = self.simulator.log_since(
            lambda: [self.simulator.send(request) for request in case["request"]]
        )
        effects = Effects(self.simulator, case, log)
        effect = {name: effects.see(name, value) for name, value in expected.items()}
        return responses, effect, expected

    def assert_deviates(self, case):
        """Refuse with a sentence, and leave everything as it is."""
        (request,) = case["request"]
        before = self.snapshot()
        answer = self.simulator.send(request)
        self.assertIs(answer.get("success"), False, answer)
        words, _, reason = answer["status_message"].partition(": ")
        self.assertIn(words, ("SetModelConfiguration", "SpawnModel"))
        self.assertRegex(reason, r"^(refused, |Failure - )\w+ .*\w+")
        self.assertEqual(self.snapshot(), before)

    def snapshot(self):
        """Give the state of all models, and of the arm's links if it is there."""
        models = self.simulator.models()
        frames = ["", *(f"arm::{link}" for link in ("upper", "lower", "rod"))]
        states = [
            self.simulator.state(model, frame) for model in models for frame in frames
        ]
        for state in states:
            del state["header"]
        return models, states


def add_method(number, case):
    """Make a method of a case; its name keeps the order."""

    def method(self):
        self.run_case(case)

    method.__doc__ = case["id"]
    name = f"test_{number:03d}_{case['id'].replace('.', '_')}"
    setattr(TestGolden, name, method)


def assert_page_is_up_to_date(test):
    """Hold docs/gazebo_compatibility.md against the outcomes, or write it."""
    text = PAGE.read_text(encoding="utf-8")
    wanted = with_table(text, test.outcomes)
    if os.environ.get("G1_COMPATIBILITY") == "write":
        PAGE.write_text(wanted, encoding="utf-8")
    else:
        test.assertEqual(text, wanted, "it is out of date: run tools/compatibility")


for number, case in enumerate(load_cases(), 1):
    add_method(number, case)
TestGolden.test_999_the_page_tells_the_outcomes = assert_page_is_up_to_date
