"""Files of allowed pairs: written, read again, and wrong in all ways."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from g1_description.collisions.allowed_pairs import (
    NEVER,
    REASONS,
    USER,
    AllowedPair,
    AllowedPairs,
    read_allowed_pairs,
    with_pairs,
    write_allowed_pairs,
)
from g1_description.errors import AllowedPairsError

NAMES = st.text(
    st.characters(blacklist_categories=["Cc", "Cs", "Zl", "Zp"]), min_size=1
).filter(lambda name: name == name.strip())


@st.composite
def allowed_pairs(draw):
    """Draw pairs of a robot with any names."""
    links = draw(st.lists(NAMES, min_size=2, max_size=6, unique=True))
    names = st.lists(st.sampled_from(links), min_size=2, max_size=2, unique=True)
    entries = draw(st.lists(st.tuples(names, st.sampled_from([*REASONS])), max_size=5))
    pairs = [AllowedPair(*pair, reason) for pair, reason in entries]
    counts = st.integers(0, 10**6)
    robot = draw(NAMES)
    return AllowedPairs(robot, tuple(links), tuple(pairs), draw(counts), draw(counts))


def grouped(pairs):
    """Sort pairs as a file has them."""
    return sorted(pairs, key=lambda pair: [*REASONS].index(pair.reason))


@given(allowed_pairs())
def test_what_is_written_is_read(tmp_path_factory, allowed):
    file = tmp_path_factory.mktemp("pairs") / "pairs.yaml"
    write_allowed_pairs(file, allowed, "How it was made:\n\nby hand.\n")
    read = read_allowed_pairs(file)
    assert (read.robot, read.links) == (allowed.robot, allowed.links)
    assert (read.samples, read.seed) == (allowed.samples, allowed.seed)
    assert [*read.pairs] == grouped(allowed.pairs)
    assert read.place == str(file)


@pytest.mark.parametrize("name", ["null", "on", "a: b", "-"])
def test_names_that_yaml_takes_for_something_else(tmp_path, name):
    allowed = AllowedPairs(name, (name, "b"), (AllowedPair(name, "b", USER),))
    file = tmp_path / "pairs.yaml"
    write_allowed_pairs(file, allowed, "")
    assert read_allowed_pairs(file).pairs == allowed.pairs


HEAD = "robot: r\nsamples: 1\nseed: 0\n"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "must have the keys robot, samples, seed, links, pairs"),
        ("robot: a\nrobot: b", "line 2: found duplicate key"),
        (HEAD + "links: a\npairs: []", "links must be a list of names"),
        (HEAD + "links: [a, b]\npairs: [[a, b]]", r"\[link, link, reason\]"),
        (HEAD + "links: [a, b]\npairs: [[a, c, user]]", "contain c, missing in links"),
        (
            HEAD + "links: [a, b]\npairs: [[a, b, maybe]]",
            "'maybe' of a and b. Known reasons: adjacent",
        ),
    ],
)
def test_a_wrong_file_is_told(tmp_path, text, problem):
    file = tmp_path / "pairs.yaml"
    file.write_text(text)
    with pytest.raises(AllowedPairsError, match=problem) as error:
        read_allowed_pairs(file)
    assert str(error.value).startswith(f"The file of allowed collisions {file}: ")


def test_links_of_another_robot_are_told():
    allowed = AllowedPairs("r", ("a", "b"), (), place="r.yaml")
    allowed.check_links("part of r", ["b"])
    with pytest.raises(AllowedPairsError, match=r"in r\.yaml .*'r'.*'other': c, d\."):
        allowed.check_links("other", ["a", "c", "d"])


def test_pairs_by_hand_replace_others():
    never = AllowedPair("a", "b", NEVER)
    allowed = AllowedPairs("r", ("a", "b", "c"), (never, AllowedPair("a", "c", NEVER)))
    by_hand = [AllowedPair("b", "a", USER), AllowedPair("a", "x", USER)]
    pairs = with_pairs(allowed, by_hand).pairs
    assert pairs == (AllowedPair("a", "c", NEVER), AllowedPair("b", "a", USER))
