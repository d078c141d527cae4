"""Runs the quick tests, first those that execute the line that is changed in this checkout."""

import os
import re
import subprocess
import sys
from pathlib import Path

from coverage import CoverageData

ROOT = Path(__file__).resolve().parent.parent.parent
PYTEST = (sys.executable, "-m", "pytest", "-qm", "not slow", "-p", "no:cacheprovider")
_FEW = 40  # Test functions that one process runs before others have started.


def main() -> int:
    """Returns the exit status of pytest: not zero as soon as a test fails."""
    os.environ["PYTHONPATH"] = str(ROOT)  # Before whatever version is installed.
    diff = "\n".join(_git("diff", "--unified=0", "--", "drake_pregrasp"))
    (name,) = re.findall(r"^\+\+\+ b/(.*)", diff, flags=re.MULTILINE)
    line = int(re.findall(r"^@@ -\d+(?:,\d+)? \+(\d+)", diff, flags=re.MULTILINE)[0])
    module, folder = Path(name).stem, f"tests/{Path(name).parts[1]}"
    naming = _git("grep", "-lw", module, "--", f"{folder}/test_*.py")
    # All quick tests come last: coverage does not see what is executed in other processes.
    for tests in (covering_tests(name, line), naming, [folder], ["tests"]):
        if tests:
            processes = ["-n0"] if len(tests) < _FEW and "::" in tests[0] else []
            command = [*PYTEST, "-x", *processes, *tests]
            status = subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL).returncode
            if status not in (0, 5):  # 5: all these tests are slow.
                return status
    return 0


def covering_tests(name: str, line: int) -> list[str]:
    """Returns the test functions that execute a line of a file, or the statement it belongs to."""
    data = CoverageData(str(ROOT / ".coverage"))
    data.read()
    contexts = data.contexts_by_lineno(str(ROOT / name))
    start = max((known for known in contexts if known <= line), default=None)
    tests = {re.sub(r"(\[.*)?\|\w+$", "", context) for context in contexts.get(start, ())}
    return sorted(tests - {""})


def _git(*command: str) -> list[str]:
    return subprocess.run(
        ["git", *command], cwd=ROOT, capture_output=True, text=True
    ).stdout.splitlines()


if __name__ == "__main__":
    sys.exit(main())
