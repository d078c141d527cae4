"""Counts lines of code and files against budgets.

Blank lines, comments and docstrings do not count. The exit status is 1 if a budget is exceeded.
Lower a budget when the code has shrunk; the goals are 15,000 lines for the package and 12,000 for
the tests.
"""

import ast
import sys
import tokenize
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SKIPPED = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
LINES = {  # At most this many lines of code below each folder.
    "drake_pregrasp": 21_137,
    "drake_pregrasp/studies": 4_935,
    "drake_pregrasp/fast": 1_419,
    "tests": 16_843,
}
FILES = {"drake_pregrasp": 199}
LONGEST_FILE = 400  # Lines, all counted.
LARGEST_FOLDER = {"systems": 24, "diagrams": 24}
OTHER_FOLDERS = 16  # Files in any other folder of the package.


def lines_of_code(path: Path) -> int:
    """Returns the number of lines of a file that hold code."""
    with path.open("rb") as file:
        tokens = list(tokenize.tokenize(file.readline))[1:]
    lines = {
        line
        for token in tokens
        if token.type not in SKIPPED
        for line in range(token.start[0], token.end[0] + 1)
    }
    for node in ast.walk(ast.parse(path.read_bytes())):
        # A string that stands alone documents a module, class, function or constant.
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            lines -= set(range(node.lineno, (node.end_lineno or 0) + 1))
    return len(lines)


def main() -> int:
    """Prints the counts of each folder, and what exceeds its budget."""
    counts = {
        path: lines_of_code(path)
        for top in ("drake_pregrasp", "tests")
        for path in sorted((ROOT / top).rglob("*.py"))
    }
    faults = []
    folders = sorted({path.parent for path in counts})
    for folder in folders:
        own = [path for path in counts if path.parent == folder]
        below = sum(lines for path, lines in counts.items() if folder in path.parents)
        name = str(folder.relative_to(ROOT))
        print(f"{name:42} {len(own):4} files {below:7,} lines of code")
        if below > LINES.get(name, below):
            faults.append(f"{name}: {below:,} lines of code, at most {LINES[name]:,}")
        most = LARGEST_FOLDER.get(folder.name, OTHER_FOLDERS)
        if name.startswith("drake_pregrasp") and len(own) > most:
            faults.append(f"{name}: {len(own)} files, at most {most}")
    package = [path for path in counts if ROOT / "drake_pregrasp" in path.parents]
    print(f"{'drake_pregrasp, all files':42} {len(package):4} files")
    if len(package) > FILES["drake_pregrasp"]:
        faults.append(f"drake_pregrasp: {len(package)} files, at most {FILES['drake_pregrasp']}")
    named: dict[str, Path] = {}
    for path in package:
        length = len(path.read_text(encoding="utf-8").splitlines())
        if length > LONGEST_FILE:
            faults.append(f"{path.relative_to(ROOT)}: {length} lines, at most {LONGEST_FILE}")
        first = named.setdefault(path.name, path)
        if first != path and path.name != "__init__.py":
            faults.append(f"{path.relative_to(ROOT)} and {first.relative_to(ROOT)} share a name")
    print("\n".join(faults) or "all within the budgets")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
