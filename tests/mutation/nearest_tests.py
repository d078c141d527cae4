"""Runs the tests nearest to what is changed in this checkout, and then the quick tests."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent


def main() -> int:
    """Returns the exit status of pytest: not zero as soon as a test fails."""
    os.environ["PYTHONPATH"] = str(ROOT)  # Before whatever version is installed.
    changed = subprocess.run(
        ["git", "diff", "--name-only"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split()
    folders = sorted({Path(name).parts[1] for name in changed if name.startswith("drake_")})
    nearest = [f"tests/{folder}" for folder in folders if (ROOT / "tests" / folder).is_dir()]
    for tests in (nearest, ["tests"]):
        command = [sys.executable, "-m", "pytest", "-xqm", "not slow", "-p", "no:cacheprovider"]
        status = subprocess.run([*command, *tests], cwd=ROOT, stdout=subprocess.DEVNULL).returncode
        if status != 0:
            return status
    return 0


if __name__ == "__main__":
    sys.exit(main())
