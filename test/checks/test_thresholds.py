"""Files of thresholds, and what is wrong with some."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from checked import POST, post_motion
from conftest import VENDOR

from g1_description import Robot
from g1_description.checks import thresholds_file as module
from g1_description.checks.rules import RULES
from g1_description.checks.rules.limits import POSITION, VELOCITY
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.checks.thresholds_file import read_thresholds, with_thresholds
from g1_description.checks.verdict import Finding, Verdict
from g1_description.command_line import parse
from g1_description.errors import ThresholdError

SHIPPED = Path(__file__).parents[2] / "config" / "checks.yaml"


@pytest.fixture
def defaults(tmp_path, monkeypatch):
    """Give a folder of the package, whose file of defaults has one number."""
    file = tmp_path / "share" / "config" / "checks.yaml"
    file.parent.mkdir(parents=True)
    file.write_text("position: {failure: 0.25}\n")
    monkeypatch.setattr(module, "share_folder", lambda: tmp_path / "share")
    return file


def test_the_shipped_file_holds_what_the_code_has():
    usual = Thresholds(levels={rule.name: rule.level for rule in RULES})
    assert read_thresholds() == read_thresholds(SHIPPED) == usual
    assert all(f"\n{name}:" in SHIPPED.read_text() for name in module.PARAMETERS)


def test_a_file_changes_what_it_names(tmp_path):
    file = tmp_path / "checks.yaml"
    file.write_text("position: {failure: 0.1}\nwindow: 0.2\n")
    found = read_thresholds(file)
    assert POSITION.level_in(found) == Level(1e-6, 0.1)
    assert found.window == 0.2
    assert VELOCITY.level_in(found) == VELOCITY.level


def test_a_threshold_that_is_not_named_stays():
    found = with_thresholds(Thresholds(), {"skating": {"warning": None}})
    assert found.levels == {"skating": Level(None, 0.15)}


def thresholds_in_python(model):
    """Let a program check a configuration; return the thresholds of its checks."""
    robot = Robot(model)
    robot.check_state({})
    return robot._usual_checker.thresholds


def thresholds_of_check(model):
    check = pytest.importorskip("g1_description.cli.check")
    args = parse(check.CheckOptions, "check", [str(model), "--model", str(model)])
    return check.file_checker(args).checker.thresholds


def thresholds_of_the_checker(model):
    ros = pytest.importorskip("g1_description.checker.parameters")
    return ros.CheckerParameters().read_thresholds()


def thresholds_of_the_page(model):
    ros = pytest.importorskip("g1_description.web.node")
    return ros.WebParameters().read_thresholds()


@pytest.mark.parametrize(
    "thresholds_of",
    [
        thresholds_in_python,
        thresholds_of_check,
        thresholds_of_the_checker,
        thresholds_of_the_page,
    ],
)
def test_all_that_check_read_the_file_of_defaults(defaults, tmp_path, thresholds_of):
    model = tmp_path / "post.urdf"
    model.write_text(POST)
    assert thresholds_of(model).levels["position"].failure == 0.25
    defaults.write_text("position: {failure: x}\n")
    with pytest.raises(ThresholdError, match=r"share/config/checks\.yaml: position"):
        thresholds_of(model)


def test_the_command_web_reads_the_file_of_defaults(defaults):
    web = pytest.importorskip("g1_description.cli.web")
    defaults.write_text("position: {failure: x}\n")
    with pytest.raises(ThresholdError, match=r"share/config/checks\.yaml: position"):
        web.web(web.WebOptions())


def test_the_worst_size_is_that_of_the_worst_finding():
    """Sizes below their bound are worse the smaller they are."""

    def finding(check, worst, bound):
        numbers = (worst, bound, "m", 0.0, 0.0, 0.1, ((0.0, 0.1),), "")
        return Finding(check, "failed", ("a",), *numbers)

    findings = [finding("a", size, 0.1) for size in (0.2, 0.5, 0.3)]
    findings += [finding("b", size, 0.1) for size in (0.05, -0.2, 0.0)]
    for order in (findings, findings[::-1]):
        figures = Verdict("robot", tuple(order)).rule_figures
        assert (figures["a.worst"], figures["b.worst"]) == (0.5, -0.2)
        assert figures["failed"] == 6


@pytest.mark.parametrize(
    "clip", ["B_HandsUp", "J_ShortDance16_JazzWalk", "M_ShortMove13"]
)
def test_published_clips_pass_what_is_shipped_for_retargeted_motions(clip):
    """With the usual thresholds they fail."""
    path = VENDOR.parents[1] / "motions" / f"{clip}.csv"
    if not path.exists():
        pytest.skip("the motions of others are not beside the repository")
    robot = Robot()
    motion = robot.read_motion(path, 60.0)
    file = SHIPPED.with_name("checks_retargeted.yaml")
    verdict = robot.check(motion, thresholds=file)
    assert verdict.passed
    assert verdict.excluded_by == ()
    assert not robot.check(motion).passed
    high = replace(motion, base_poses=motion.base_poses + np.eye(7)[2] * 0.3)
    excluded = robot.check(high, thresholds=file).excluded_by
    assert "lowest_height > 0.1" in excluded


def test_a_rule_may_be_over_the_worst_size_of_a_check(tmp_path):
    """Of a joint that is 0.5 rad beyond its limit; and of notes that it has none."""
    file = tmp_path / "checks.yaml"
    file.write_text(
        "position.worst > 0.4: exclude\nposition.worst > 0.6: exclude\n"
        "velocity.worst > 0: exclude\nnotes < 9: exclude\n"
    )
    verdict = Robot(POST).check(post_motion(reach=1.5, seconds=4.0), thresholds=file)
    assert verdict.excluded_by == ("position.worst > 0.4", "notes < 9")


def test_a_rule_excludes_a_motion_by_a_figure(tmp_path):
    file = tmp_path / "checks.yaml"
    file.write_text(
        "joint_speed.max > 1.5: exclude\nduration < 1: exclude\nfailed>0: exclude\n"
        "root_path > 0: exclude\n"
    )
    checker = Robot(POST).checker(file)
    verdict = checker.check(post_motion(reach=0.5))  # at 0.5 pi rad/s, at rest
    assert verdict.excluded_by == ("joint_speed.max > 1.5",)
    verdict = checker.check(post_motion(reach=1.5, seconds=0.9))  # beyond its limit
    assert verdict.excluded_by[1:] == ("duration < 1", "failed > 0")


def test_bounds_are_by_joint(tmp_path):
    file = tmp_path / "checks.yaml"
    file.write_text("jerk_bounds: {default: 9, joints: {a: 4.0}}\n")
    bounds = read_thresholds(file).jerk_bounds.of(("a", "b"))
    np.testing.assert_array_equal(bounds, [4.0, 9.0])
    np.testing.assert_array_equal(Thresholds().jerk_bounds.of(("a",)), [100_000.0])
    own = with_thresholds(Thresholds(), {"jerk_bounds": {"joints": {"a": 4}}})
    np.testing.assert_array_equal(own.jerk_bounds.of(("a", "b")), [4.0, 100_000.0])
    none = with_thresholds(Thresholds(), {"jerk_bounds": {"default": None}})
    np.testing.assert_array_equal(none.jerk_bounds.of(("a",)), [np.inf])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must map names of thresholds to their values"),
        ("a: [", "is not valid YAML: line 1"),
        ("window: 1\nwindow: 2", "is not valid YAML: line 2: found duplicate key"),
        (
            "positon: {failure: 1}",
            "Unknown threshold 'positon'. Known thresholds: position",
        ),
        (
            "bearing_speed: 0.1",
            "Unknown threshold 'bearing_speed'. Known thresholds: support_speed",
        ),
        ("position: 1", "position must be a mapping with warning, failure (got 1)"),
        (
            "position: {failure: x}",
            "position.failure must be a number or null (got 'x')",
        ),
        ("window: 0", "window must be greater than 0 (got 0)"),
        ("jerk_bounds: {joints: [a]}", "jerk_bounds.joints must map joints to numbers"),
        ("jerk_bounds: {joints: {a: 0}}", "must be positive"),
        (
            "clearance: {failure: -0.01}",
            "The thresholds of clearance must not be negative",
        ),
        ("energy >: exclude", "'energy >' must be FIGURE > NUMBER or FIGURE < NUMBER"),
        ("root_sped.max > 9: exclude", "Known figures: root_speed.max"),
        ("energy > 9: 1", "The rule 'energy > 9' must be 'exclude' (got 1)"),
    ],
)
def test_a_wrong_file_is_refused_in_a_sentence(tmp_path, text, message):
    file = tmp_path / "checks.yaml"
    file.write_text(text)
    with pytest.raises(ThresholdError, match=r"checks\.yaml") as error:
        read_thresholds(file)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
