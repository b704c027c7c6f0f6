"""Lists of classes: from files, words and detectors, and what is wrong with some."""

from types import SimpleNamespace

import numpy as np
import pytest

from seo_slam.errors import ConfigError
from seo_slam.perception.background import is_background
from seo_slam.perception.class_list import ClassList


def test_a_file_has_a_word_a_line(tmp_path):
    file = tmp_path / "classes.txt"
    file.write_text("# an office\ncup\n\n  office   chair # with wheels\nÜberwurf\n", encoding="utf-8")
    classes = ClassList.from_file(file)
    assert classes.words == ("cup", "office chair", "Überwurf")
    assert classes.source == str(file)
    assert "CUP" in classes
    assert "chair" not in classes
    assert None not in classes
    assert ClassList.from_file(classes.write(tmp_path / "again.txt")).words == classes.words
    assert ClassList.of(str(file)) == ClassList.of(file) == classes


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cup\nchair\nCup\n", r"'Cup' \(lines 1 and 3\)"),
        ("cup\ncup\nchair\nchair\n", r"'cup' \(lines 1 and 2\), 'chair' \(lines 3 and 4\)"),
        ("# nothing\n\n", "holds no word"),
        ("x" * 81, "1 to 80 visible characters"),
    ],
)
def test_bad_files_are_named_with_lines(tmp_path, text, words):
    file = tmp_path / "classes.txt"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=words) as caught:
        ClassList.from_file(file)
    assert str(file) in str(caught.value)


def test_a_missing_file_and_a_binary_one_are_named(tmp_path):
    with pytest.raises(ConfigError, match="nowhere"):
        ClassList.of(tmp_path / "nowhere.txt")
    (tmp_path / "picture").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ConfigError, match="picture"):
        ClassList.from_file(tmp_path / "picture")
    with pytest.raises(ConfigError, match="cannot be written"):
        ClassList(("cup",)).write(tmp_path / "no folder" / "classes.txt")


def test_however_an_accent_is_spelt_it_is_one_word(tmp_path):
    apart, together = "cafe\u0301 table", "caf\u00e9 table"
    assert ClassList((apart,)).words == (together,)
    assert apart in ClassList((together,))
    assert together in ClassList((apart,))
    (tmp_path / "classes.txt").write_text(f"{apart}\n{together}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="lines 1 and 2"):
        ClassList.from_file(tmp_path / "classes.txt")


@pytest.mark.parametrize("word", ["c# book", "#1 mug"])
def test_a_word_that_would_not_be_read_again_is_not_written(tmp_path, word):
    with pytest.raises(ConfigError, match=rf"'{word}' of my words cannot be written.*wanted words without #"):
        ClassList(("cup", word), "my words").write(tmp_path / "classes.txt")
    assert list(tmp_path.iterdir()) == []


def test_duplicates_in_words_are_named():
    with pytest.raises(ConfigError, match=r"classes: 'cup', 'shoe' stand more than once"):
        ClassList.of(["cup", "Shoe", "CUP", "shoe", "lamp"])
    with pytest.raises(ConfigError, match="and 2 more"):
        ClassList.of([word for word in "abcdefg" for _ in range(2)])
    with pytest.raises(ConfigError, match="list of words"):
        ClassList(("cup", 3))


def test_a_detector_may_know_its_classes():
    assert ClassList.of_detector(SimpleNamespace(names=("cup", "chair", "cup"))).words == ("cup", "chair")
    assert ClassList.of_detector(SimpleNamespace(labels={0: "cup", 1: "chair"})).words == ("cup", "chair")
    assert ClassList.of_detector(SimpleNamespace(names=lambda: None)) is None
    assert ClassList.of_detector(SimpleNamespace(classes=np.array(["cup", "chair"]))).words == ("cup", "chair")
    assert ClassList.of_detector(object()) is None


@pytest.mark.parametrize("classes", [[0, 2, 5], {2: 41}, np.arange(3), np.array("cup"), "my.txt", ["cup", ["chair"]], ["", " "], [], None])
def test_what_holds_no_words_is_no_class_list(classes):
    assert ClassList.of_detector(SimpleNamespace(classes=classes)) is None


@pytest.mark.parametrize("label", ["wall", "Brick Wall", "windows", "floor", "glass-wall", "background"])
def test_background_words(label):
    assert is_background(label)


@pytest.mark.parametrize("label", ["wallet", "wall clock", "floor lamp", "ventilator", "chair", "", None])
def test_things_are_no_background_for_a_word_they_hold(label):
    assert not is_background(label)


def test_background_words_can_be_others():
    assert is_background("oak door", ("door",))
    assert not is_background("wall", ("door",))
    assert not is_background("wall", ())
