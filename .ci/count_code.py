"""Prints lines of code and files of each folder, and notes what a reader may find too large.

Blank lines, comments and docstrings do not count. The numbers say where the weight lies; nothing
fails because of them.
"""

import ast
import tokenize
from collections.abc import Iterator
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
LONG_FILE = 400  # Lines, all counted.
LARGE_FOLDER = 16  # Files.
LARGE_FOLDER_OF_SYSTEMS = 24  # Files of `systems` and `diagrams`: each is a system.


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


def notes(package: list[Path]) -> Iterator[str]:
    """Yields a note on each large file, shared name and large folder of the package."""
    named: dict[str, Path] = {}
    for path in package:
        length = len(path.read_text(encoding="utf-8").splitlines())
        if length > LONG_FILE:
            yield f"{path.relative_to(ROOT)} has {length} lines"
        first = named.setdefault(path.name, path)
        if first != path and path.name != "__init__.py":
            yield f"{path.relative_to(ROOT)} and {first.relative_to(ROOT)} share a name"
    for folder in sorted({path.parent for path in package}):
        count = sum(path.parent == folder for path in package)
        many = folder.name in ("systems", "diagrams")
        if count > (LARGE_FOLDER_OF_SYSTEMS if many else LARGE_FOLDER):
            yield f"{folder.relative_to(ROOT)} has {count} files"


def main() -> None:
    """Prints the counts of each folder with all below it, and the notes."""
    for top in ("drake_pregrasp", "tests"):
        counts = {path: lines_of_code(path) for path in sorted((ROOT / top).rglob("*.py"))}
        for folder in sorted({path.parent for path in counts}):
            below = [lines for path, lines in counts.items() if folder in path.parents]
            name = str(folder.relative_to(ROOT))
            print(f"{name:42} {len(below):4} files {sum(below):7,} lines of code")
    for note in notes(sorted((ROOT / "drake_pregrasp").rglob("*.py"))):
        print(f"note: {note}")


if __name__ == "__main__":
    main()
