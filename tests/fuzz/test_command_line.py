"""What the harnesses have in common: what they are asked for, and how they end."""

import sys

import pytest
from command_line import Counts, Found, main


@pytest.mark.parametrize("failed", [0, 2])
def test_the_status_says_whether_anything_failed(monkeypatch, capsys, failed):
    asked = []

    def run(*arguments):
        asked.append(arguments)
        counts = Counts({("made", "kept"): 7, ("made", "broken"): failed})
        return Found(counts, ["--- 11 broken"] * min(failed, 1), failed, (0.25, 8))

    options = ["--count", "9", "--seed", "3", "--first", "5", "--minutes", "0.5"]
    monkeypatch.setattr(sys, "argv", ["fuzz", *options])
    assert main("What it does.", "cases", run) == (1 if failed else 0)
    assert asked == [(9, 3, 5, 30.0)]
    said = capsys.readouterr().out
    assert ("--- 11 broken" in said) == (failed > 0)
    assert f"{7 + failed} cases in " in said
    assert f"8 took 0.25 s; {failed} failures" in said
