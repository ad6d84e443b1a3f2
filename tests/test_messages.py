"""Lines for people: no stream ends a run, whatever it does not take."""

import io
import sys

import pytest

from aircl_jax.messages import say, tell, warn


def test_a_line_is_one_line(capsys):
    warn("one\n  two")
    tell("three")
    assert capsys.readouterr().err == "warning: one two\nthree\n"


class Refusing(io.StringIO):
    def write(self, text):
        raise OSError(28, "No space left on device")


@pytest.mark.parametrize("stream", [None, Refusing()])
def test_a_stream_that_is_closed_or_full_takes_nothing_and_ends_nothing(stream, monkeypatch):
    monkeypatch.setattr(sys, "stdout", stream)
    say("lost")


def test_a_stream_that_was_closed_ends_nothing(monkeypatch):
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stdout", closed)
    say("lost")


def test_letters_that_an_encoding_lacks_are_escaped(monkeypatch):
    bytes_ = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(bytes_, encoding="ascii"))
    say("δ = 1")
    assert bytes_.getvalue() == b"\\u03b4 = 1\n"
