"""A selection: which motions of a folder are used."""

import pytest

from g1_description.errors import InvalidValueError
from g1_description.motion.selection import (
    EXCLUDE,
    FILE,
    KEEP,
    UNDECIDED,
    Choice,
    Selection,
)

BY_HAND = """\
walk/a.csv: exclude   # its feet slide
b.csv: {choice: keep, note: smooth}
"c.csv": {choice: exclude, note: "a \\"word\\""}
lib.pkl#run 1:
  note: look again
"""


def test_a_file_by_hand_is_read(tmp_path, monkeypatch):
    file = tmp_path / FILE
    file.write_text(BY_HAND)
    found = Selection(file)
    assert found.of(tmp_path / "walk" / "a.csv") == Choice(EXCLUDE)
    assert found.of(tmp_path / "b.csv") == Choice(KEEP, "smooth")
    assert found.of(tmp_path / "c.csv") == Choice(EXCLUDE, 'a "word"')
    assert found.of(f"{tmp_path}/lib.pkl#run 1") == Choice(UNDECIDED, "look again")
    monkeypatch.chdir(tmp_path)  # a name is a path like any other
    kept = [name for name in ("walk/a.csv", "b.csv", "c.csv", "d") if found.keeps(name)]
    assert kept == ["b.csv", "d"]


def test_a_star_is_for_all_others(tmp_path):
    file = tmp_path / FILE
    file.write_text('"*": exclude\na.csv: keep\nb.csv: {note: later}\n')
    found = Selection(file)
    assert [found.keeps(tmp_path / name) for name in ("a.csv", "b.csv", "c.csv")] == [
        *(True, False, False)
    ]


def test_a_choice_for_a_file_is_for_its_motions_without_one(tmp_path):
    (tmp_path / "a # b.pkl").touch()
    file = tmp_path / FILE
    file.write_text('"a # b.pkl": exclude\n"a # b.pkl#/home/x y": keep\n')
    found = Selection(file)
    assert found.keeps(f"{tmp_path}/a # b.pkl#/home/x y")
    assert not found.keeps(f"{tmp_path}/a # b.pkl#/home/z")
    assert not found.keeps(tmp_path / "a # b.pkl")


@pytest.mark.parametrize(
    "entry, motion",
    [
        ("a.csv", "a.npz"),
        ("deeper/a_60hz.csv", "deeper/a_50hz.pkl"),
        ('"lib.pkl#/home/x y"', "lib/_home_x_y.npz"),
    ],
)
def test_a_motion_that_was_converted_has_the_choice_of_what_it_was(
    tmp_path, entry, motion
):
    file = tmp_path / "in" / FILE
    file.parent.mkdir()
    file.write_text(f"{entry}: exclude\n")
    found = Selection(file)
    assert not found.keeps(tmp_path / "in" / motion)
    assert found.unmatched() == []
    assert not Selection(file).keeps(tmp_path / "out" / motion, tmp_path / "out")
    assert Selection(file).keeps(tmp_path / "out" / motion)
    file.with_name("a.csv").touch()  # the motion beside it is another
    if entry == "a.csv":
        assert found.keeps(tmp_path / "in" / motion)


def test_an_entry_that_may_mean_several_motions_means_none(tmp_path):
    file = tmp_path / FILE
    file.write_text("a.csv: exclude\na.pkl: keep\nb.csv: exclude\n")
    found = Selection(file)
    assert found.keeps(tmp_path / "a.npz")
    assert found.unmatched() == ["a.csv", "a.pkl", "b.csv"]
    assert not found.keeps(tmp_path / "b.npz")
    assert found.unmatched() == ["a.csv", "a.pkl"]


def test_what_is_written_is_read(tmp_path):
    file = tmp_path / FILE
    begun = Selection(file, must_exist=False)
    words = ["", 'a "b" \\ #', "two\nlines", "ä: é", "\u2028", "{choice: keep}"]
    choices = {}
    for number, note in enumerate(words):
        motion = tmp_path / f"{note or 'x'}.csv"
        choices[motion] = Choice((KEEP, EXCLUDE)[number % 2], note)
        begun.choose(motion, choices[motion])
    begun.choose(tmp_path / "gone.csv", Choice(KEEP))
    begun.choose(tmp_path / "gone.csv", Choice())
    begun.write()
    found = Selection(file)
    assert found.choices == begun.choices
    assert len(found.choices) == len(words)
    assert {motion: found.of(motion) for motion in choices} == choices


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- a", "must map motions to choices"),
        ("\n\na: maybe", "choice of a must be one of keep, exclude, undecided"),
        ("a: {chosen: keep}", "a must be a choice, or have choice and note"),
        ('a: keep\n"a": {choice: keep}', "a is there twice"),
    ],
)
def test_a_wrong_file_is_refused_in_a_sentence(tmp_path, text, message):
    file = tmp_path / FILE
    file.write_text(text)
    with pytest.raises(InvalidValueError, match=FILE) as error:
        Selection(file)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
