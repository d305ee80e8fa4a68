"""Files of settings in YAML, and what is wrong with some."""

import numpy as np
import pytest

from g1_description.files.yaml import MAX_SIZE, YamlError, finite_number, read_yaml


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"a: [", "it is not valid YAML: line 1: "),
        (b"a: 1\nb: 2\na: 3", 'it is not valid YAML: line 3: found duplicate key "a"'),
        (b"[" * 1000, "it is not valid YAML: "),
        (b"[" * 100_000, "it is not valid YAML: "),
        (b"? " * 200_000, "it is not valid YAML: "),
        (b"\xff\xfe", "it is not valid YAML: 'utf-8' codec can't decode"),
        (b"!!python/object:os.system {}", "it is not valid YAML: line 1: "),
        (b"#" * (MAX_SIZE + 1), "it is larger than 1 MB"),
    ],
    ids=["open", "twice", "nested", "deep", "deep keys", "no text", "object", "large"],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, data, problem):
    file = tmp_path / "settings.yaml"
    file.write_bytes(data)
    with pytest.raises(YamlError) as error:
        read_yaml(file)
    assert str(error.value).startswith(problem)
    assert "\n" not in str(error.value)


def test_an_empty_file_holds_nothing(tmp_path):
    file = tmp_path / "settings.yaml"
    file.write_text("# later\n")
    assert read_yaml(file) is None
    with pytest.raises(YamlError, match="it cannot be read: Is a directory"):
        read_yaml(tmp_path)


@pytest.mark.parametrize("before", ["", "# ours\n", "\ufeff"])
def test_a_file_says_which_yaml_it_is(tmp_path, before):
    file = tmp_path / "settings.yaml"
    content = "---\n[010, yes]\n"
    for version, values in (("", [10, "yes"]), ("%YAML 1.1\n", [8, True])):
        file.write_text(before + version + content, encoding="utf-8")
        assert read_yaml(file) == values


def test_numbers_are_finite():
    assert [finite_number(v) for v in (1, 0.5, np.int64(2))] == [1.0, 0.5, 2.0]
    bad = (True, "1", None, float("nan"), float("inf"), 10**400, [1])
    assert {finite_number(value) for value in bad} == {None}
