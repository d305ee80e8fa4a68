"""The page in three dimensions as text: what it says, and that names stay text."""

import base64
import csv
import io
import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from findings import OUTCOMES, finding
from hypothesis import given, settings
from hypothesis import strategies as st

from g1_description import Robot
from g1_description.checks.report import NOT_READ, FileResult, csv_text
from g1_description.checks.verdict import Verdict
from g1_description.errors import InvalidValueError, MotionError
from g1_description.motion.motion import Motion
from g1_description.render import page_data
from g1_description.render.page import motion_page, write_page
from g1_description.render.page_data import as_json, motion_data, robot_data
from g1_description.robot.urdf import parse_urdf

BOX = '<geometry><box size="0.1 0.2 0.3"/></geometry>'
ARM = f"""<robot name="arm"><link name="post"><visual>{BOX}</visual></link>
  <link name="fore"><collision>{BOX}</collision></link>
  <joint name="elbow" type="revolute"><parent link="post"/><child link="fore"/>
  <axis xyz="1 0 0"/><limit lower="-1" upper="2" effort="1" velocity="3"/></joint>
</robot>"""
ROBOT = parse_urdf(ARM)


class Page(HTMLParser):
    """Collects what a page refers to, and checks that its elements are closed."""

    def __init__(self, text):
        super().__init__()
        self.links, self.ids, self.open, self.tags = [], [], [], []
        self.text, self.data = "", []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in {"meta", "img", "br"}:
            self.open.append(tag)
        self.is_json = ("type", "application/json") in attrs
        if self.is_json:
            self.data.append("")
        for name, value in attrs:
            if name in {"src", "href", "srcset", "action", "data"}:
                self.links.append(value)
            if name == "id":
                self.ids.append(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "script" in self.open and self.is_json:
            self.data[-1] += data
        elif not {"script", "style"} & set(self.open):
            self.text += data


def motion(n=3, base=False, **changes):
    poses = np.tile([0, 0, 1, 0, 0, 0, 1.0], (n, 1)) if base else None
    rows = np.linspace(0.0, 1.0, n)[:, np.newaxis]
    made = Motion(np.arange(n) / 50.0, ("elbow",), rows, base_poses=poses)
    return replace(made, **changes)


def numbers(text, kind):
    return np.frombuffer(base64.b64decode(text), kind)


@settings(max_examples=5, deadline=None)
@given(st.lists(OUTCOMES, max_size=3))
def test_the_page_needs_nothing_from_elsewhere(tmp_path_factory, outcomes):
    folder = tmp_path_factory.mktemp("page")
    (folder / "motion").write_text(motion_data(ROBOT, motion()))
    motions = [folder / ("motion" if o.verdict else "none") for o in outcomes]
    write_page(folder / "page.html", ROBOT, outcomes, motions, 1)
    text = (folder / "page.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.open == []
    assert not {"link", "iframe", "img"} & set(page.tags)
    assert "url(" not in text and "@import" not in text and "http:" not in text
    assert "default-src 'none'" in text
    sections = [f"file{n}" for n in range(len(outcomes))]
    assert page.ids == ["overview", *sections, "robot"]
    assert page.links == [*(f"#{name}" for name in sections), *["#"] * len(sections)]
    read = [json.loads(data) for data in page.data]
    assert len(read) == 1 + sum(o.verdict is not None for o in outcomes)


def test_the_page_says_what_was_found_and_names_are_text(tmp_path):
    fall = finding(severity="warning", check="fall", subject=(), unit="")
    verdict = Verdict(
        "<r>",
        (finding(text="<i> is far"), replace(fall, cause=1)),
        ("position", "fall"),
        {"jerk": "a & b"},
        {"duration": 3.0, "contact_share": 0.5, "least_center_margin": 0.12346},
        notes=("1 > 0",),
        excluded_by=("energy > 9",),
    )
    failed = FileResult("<b>\udcff", verdict)  # a byte of its name is no text
    not_read = FileResult("&.csv", None, "1 < 2.", NOT_READ)
    none = [tmp_path / "none"] * 2
    write_page(tmp_path / "page.html", ROBOT, [failed, not_read], none, 3)
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    lines = Page(text).text.split("\n")
    assert "2 files: 1 failed, 1 not read; interrupted, 3 not done." in lines
    assert "<b>\\udcfffailed111.250 s30.5position; energy > 9" in lines
    assert "&.csvnot read1 < 2." in lines
    body = [line for line in lines[lines.index("<b>\\udcff failed") :] if line]
    body.remove("◂ All files")
    assert body == [
        "<b>\\udcff failed",
        "position failed from 1.250 s, 50.0 % of the time, threshold 0.1 rad<i> is far",
        "fall warning from 1.250 s, threshold 0.1far",
        "<r>: length 3 s, time in contact with the floor 50 %, "
        "least margin of the centre of mass 0.1235 m",
        "excluded by energy > 9",
        "1 > 0",
        "skipped: jerk (a & b)",
        "&.csv not read",
        "1 < 2.",
    ]


def test_one_file_has_no_table_of_files(tmp_path):
    (tmp_path / "motion").write_text(motion_data(ROBOT, motion()))
    one = [FileResult("a.csv", Verdict("r"))], [tmp_path / "motion"]
    write_page(tmp_path / "page.html", ROBOT, *one, 0)
    page = Page((tmp_path / "page.html").read_text())
    assert page.ids == ["file0", "robot"]
    assert page.text.split() == ["a.csv", "a.csv", "passed", "r:"]


def test_the_page_counts_findings_as_the_table_does(tmp_path):
    of_one_cause = tuple(finding(subject=(name,)) for name in ("elbow", "wrist"))
    results = [FileResult("a", Verdict("r", of_one_cause, ("position",)))] * 2
    write_page(tmp_path / "page.html", ROBOT, results, [tmp_path / "none"] * 2, 0)
    row, _ = csv.DictReader(io.StringIO(csv_text(results)))
    assert row["failed"] == "2"
    cells = f"<td>{row['failed']}</td><td>{row['warnings']}</td>"
    assert (tmp_path / "page.html").read_text().count(cells) == 2


def test_names_and_texts_close_no_script():
    name = "</script><script>alert(1)</script><!--"
    robot = parse_urdf(ARM.replace("elbow", "&lt;/script&gt;"))
    found = finding(subject=("</script>",), text=name, check="position")
    moved = motion(joint_names=("</script>",))
    verdict = Verdict(name, (found,), ("position",), notes=(name,))
    page = Page(motion_page(robot, moved, verdict, name))
    assert page.tags.count("script") == 3
    read, made = map(json.loads, page.data[:2])
    assert made["joints"][0]["name"] == "</script>"
    assert read["causes"][0]["findings"][0]["label"] == "position </script> 0.5 rad"
    assert page.text.count(name) == 5  # title, head, finding, robot, note
    assert json.loads(as_json(name)) == name


def test_a_configuration_is_a_table_and_an_unchecked_one_has_no_result():
    text = motion_page(ROBOT, motion(1), name="now")
    page = Page(text)
    assert page.text.split() == ["now", "now", "elbow0.0000", "rad"]
    with pytest.raises(MotionError, match="none of the motion's joints"):
        motion_page(ROBOT, motion(joint_names=("knee",)))


def test_triangles_stay_where_they_are():
    ((patch,), robot) = ((made := json.loads(robot_data(ROBOT)[0]))["patches"], made)
    assert [link["name"] for link in robot["links"]] == ["post", "fore"]
    points = numbers(patch["vertices"], "<u2").reshape(-1, 3) * patch["step"]
    points += patch["corner"]
    assert np.abs(points) == pytest.approx(np.tile([0.05, 0.1, 0.15], (8, 1)), abs=1e-5)
    faces = numbers(patch["faces"], "<u2").reshape(-1, 3)
    a, b, c = np.swapaxes(points[faces], 0, 1)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    assert volume == pytest.approx(0.1 * 0.2 * 0.3, rel=1e-4)
    bare = parse_urdf(ARM.replace("visual>", "collision>"))
    links = [patch["link"] for patch in json.loads(robot_data(bare)[0])["patches"]]
    assert links == [0, 1], "without visual shapes those of collisions"


def test_a_robot_of_many_triangles_has_fewer(monkeypatch):
    ball = ARM.replace('<box size="0.1 0.2 0.3"/>', '<sphere radius="0.3"/>')
    monkeypatch.setattr(page_data, "MAX_TRIANGLES", 300)
    (patch,) = json.loads(robot_data(parse_urdf(ball))[0])["patches"]
    assert 200 < len(numbers(patch["faces"], "<u2")) / 3 <= 310
    points = numbers(patch["vertices"], "<u2").reshape(-1, 3) * patch["step"]
    radius = np.linalg.norm(points + patch["corner"], axis=1)
    assert radius == pytest.approx(np.full(len(points), 0.3), abs=0.01)


def test_a_motion_is_whole_until_it_is_too_long(monkeypatch):
    moved = motion(7, base=True, velocities=np.ones((7, 1)))
    read = json.loads(motion_data(ROBOT, moved))
    assert numbers(read["times"], "<f8").tolist() == moved.times.tolist()
    assert numbers(read["positions"], "<f4") == pytest.approx(moved.positions[:, 0])
    assert numbers(read["roots"], "<f4").reshape(-1, 7)[:, 2].tolist() == [1.0] * 7
    assert (read["floor"], read["causes"], read["lines"]) == (0.0, [], [])
    assert json.loads(motion_data(ROBOT, motion()))["floor"] is None
    monkeypatch.setattr(page_data, "MAX_SAMPLES", 3)
    read = json.loads(motion_data(ROBOT, moved))
    assert numbers(read["times"], "<f8").tolist() == moved.times[::3].tolist()
    assert len(numbers(read["velocities"], "<f4")) == 3


def test_a_cause_has_its_plot_and_its_marks():
    far = finding(subject=("elbow",), check="velocity", worst=4.0, unit="rad/s")
    deep = finding(
        **{"subject": ("post", "fore"), "check": "self_collision", "unit": "m"},
        **{"worst": 0.02, "cause": 1, "points": ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0))},
    )
    verdict = Verdict("r", (far, deep), ("velocity", "self_collision"))
    fast, hit = json.loads(motion_data(ROBOT, motion(), verdict))["causes"]
    assert (fast["plot"], fast["findings"][0]["joint"]) == ("velocity:0", 0)
    (mark,) = hit["findings"]
    assert mark["red"] == mark["links"] == ["post", "fore"]
    assert (mark["label"], mark["points"][1]) == ("post/fore 20 mm", [2.0, 0.0, 0.0])


def test_a_page_of_the_g1_can_be_sent(tmp_path):
    robot = Robot()
    times = np.arange(501) / 50.0
    rows = np.tile(robot.named_configuration("stand"), (501, 1))
    base = np.tile([0, 0, 0.8, 0, 0, 0, 1.0], (501, 1))
    moved = robot.trajectory(times, rows, base=base)
    robot.write_page(tmp_path / "page.html", moved)
    assert 1e5 < (tmp_path / "page.html").stat().st_size < 1e6
    with pytest.raises(InvalidValueError, match="cannot be written"):
        robot.write_page(tmp_path, moved)
