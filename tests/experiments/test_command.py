"""Exit codes of every command: done, bad input in one line, interrupted."""

from dataclasses import dataclass

import pytest

from experiments.cli.command import run_command


@dataclass(frozen=True)
class Settings:
    size: int = 3


def test_a_task_has_the_settings_and_the_words_and_ends_with_0():
    seen = []
    assert run_command(lambda settings, words: seen.append((settings, words)), ["size=5"], Settings(), None) == 0
    assert seen == [(Settings(5), ["size=5"])]


def test_the_words_are_the_command_lines_where_none_are_passed(monkeypatch):
    monkeypatch.setattr("sys.argv", ["command", "size=7"])
    assert run_command(lambda settings, _: settings.size, None, Settings(), None) == 7


@pytest.mark.parametrize(("words", "said"), [(["size=many"], "size=many is not an integer"), (["length=1"], "unknown setting")])
def test_a_wrong_setting_is_one_line_and_2_and_nothing_is_done(words, said, capsys):
    assert run_command(lambda *_: pytest.fail("it was run"), words, Settings(), None) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ") and said in printed.err
    assert printed.err.count("\n") == 1 and printed.out == ""


@dataclass(frozen=True)
class Words:
    number: int = 3
    share: float = 0.5
    name: str = "a"
    on: bool = False
    sizes: tuple[int, ...] = ()


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("number=010", 10),
        ("number=-2", -2),
        ("share=1e-3", 0.001),
        ("share=2", 2.0),
        ("name=2024-01-01", "2024-01-01"),
        ("name=no", "no"),
        ("name=[", "["),
        ("on=True", True),
        ("sizes=[3, 4]", (3, 4)),
    ],
)
def test_a_word_is_read_as_it_is_written(word, value):
    seen = []
    assert run_command(lambda settings, _: seen.append(settings), [word], Words(), None) == 0
    assert getattr(seen[0], word.partition("=")[0]) == value


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("number=1:30", "number=1:30 is not an integer"),
        ("number=0x10", "number=0x10 is not an integer"),
        ("number=1_0", "number=1_0 is not an integer"),
        ("on=yes", "on=yes is not true or false"),
        ("sizes=[", "cannot read 'sizes=['; quote a value with signs in it, as in 'sizes=\"[\"'"),
        ("sizes", "cannot read 'sizes'; write NAME=VALUE"),
    ],
)
def test_a_word_that_yaml_would_read_as_another_is_refused_with_the_cure(word, said, capsys):
    assert run_command(lambda *_: pytest.fail("it was run"), [word], Words(), None) == 2
    assert said in capsys.readouterr().err


def test_what_a_task_refuses_is_one_line_too(capsys):
    def refuse(*_: object) -> None:
        raise ValueError("there is\nno such file")

    assert run_command(refuse, [], Settings(), None) == 2
    assert capsys.readouterr().err == "error: there is no such file\n"


@pytest.mark.parametrize(("then", "said"), [("", "interrupted\n"), ("it goes on", "interrupted; it goes on\n")])
def test_an_interrupt_is_130_and_says_what_to_do(then, said, capsys):
    def cut(*_: object) -> None:
        raise KeyboardInterrupt

    assert run_command(cut, [], Settings(), None, then=then) == 130
    assert capsys.readouterr().err == said


def test_a_fault_of_the_code_is_shown_as_one():
    def fault(*_: object) -> None:
        raise TypeError("a fault")

    with pytest.raises(TypeError, match="a fault"):
        run_command(fault, [], Settings(), None)


def test_help_prints_what_the_command_is_for_and_ends(capsys):
    with pytest.raises(SystemExit) as ended:
        run_command(lambda *_: pytest.fail("it was run"), ["--help"], Settings(), "About it.")
    assert ended.value.code == 0
    assert capsys.readouterr().out == "About it.\n"
