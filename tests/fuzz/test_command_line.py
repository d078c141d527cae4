"""Options and exit statuses that the harnesses share."""

import sys

import pytest
from command_line import Result, main


@pytest.mark.parametrize("failure", ["", "what was broken"])
def test_the_status_says_whether_anything_failed(monkeypatch, capsys, failure):
    asked = []

    def results(*arguments):
        asked.append(arguments)
        yield Result(5, "made", "kept", "", 0.25)
        yield Result(6, "made", "broken" if failure else "kept", failure, 0.1)

    monkeypatch.setattr(sys, "argv", ["fuzz", "--count", "9", "--seed", "3", "--first", "5"])
    assert main("What it does.", results) == (1 if failure else 0)
    assert asked == [(3, 5, 14)]
    said = capsys.readouterr().out
    assert ("--- 6 made broken\nwhat was broken" in said) == bool(failure)
    assert "2 cases in " in said
    assert f"5 took 0.25 s; {1 if failure else 0} failures" in said


def test_the_time_is_limited(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["fuzz", "--minutes", "0"])
    assert main("What it does.", lambda *_: (Result(i, "a", "b", "", 0.0) for i in range(9))) == 0
    assert "1 cases in " in capsys.readouterr().out
