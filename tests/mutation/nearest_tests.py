"""Runs the tests nearest to what is changed in this checkout, and then the quick tests."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
PYTEST = [sys.executable, "-m", "pytest", "-xqm", "not slow", "-p", "no:cacheprovider"]


def main() -> int:
    """Returns the exit status of pytest: not zero as soon as a test fails."""
    os.environ["PYTHONPATH"] = str(ROOT)  # Before whatever version is installed.
    changed = [Path(name) for name in _git("diff", "--name-only") if name.startswith("drake_")]
    naming, folders = [], []
    for path in changed:
        folder = f"tests/{path.parts[1]}"
        naming += _git("grep", "-lw", path.stem, "--", f"{folder}/test_*.py")
        folders += [folder] if (ROOT / folder).is_dir() else []
    # One process for a few files: others would take longer to start than they save.
    for tests in ([*naming, "-n0"] if naming else [], folders, ["tests"]):
        if tests:
            command = [*PYTEST, *tests]
            status = subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL).returncode
            if status not in (0, 5):  # 5: all tests of these files are slow.
                return status
    return 0


def _git(*command: str) -> list[str]:
    return subprocess.run(
        ["git", *command], cwd=ROOT, capture_output=True, text=True
    ).stdout.splitlines()


if __name__ == "__main__":
    sys.exit(main())
