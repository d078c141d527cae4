"""Floors import only from those above them, and the mathematics never imports Drake."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "drake_pregrasp"
_IN_ORDER = """
    errors version resources arrays geometry quality regions contacts estimation grasping fast
    interfaces config robots systems visualization diagrams simulation live studies cli
"""
FLOORS = _IN_ORDER.split()
MATHEMATICS = FLOORS[FLOORS.index("geometry") : FLOORS.index("interfaces")]
FILES = [path for path in PACKAGE.rglob("*.py") if path.parent != PACKAGE or path.stem in FLOORS]


def imported_modules(path: Path) -> set[str]:
    modules = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} has a relative import"
            modules.add(node.module or "")
    return modules


def floor(parts: tuple[str, ...]) -> int:
    return FLOORS.index(parts[0].removesuffix(".py"))


@pytest.mark.parametrize("own", range(len(FLOORS)), ids=FLOORS)
def test_imports_go_up_only(own: int) -> None:
    files = [path for path in FILES if floor(path.relative_to(PACKAGE).parts) == own]
    assert files
    for path, module in ((file, name) for file in files for name in imported_modules(file)):
        assert module != "drake_pregrasp", f"{path.name} imports what is for those outside"
        library, *parts = module.split(".")
        assert library != "pydrake" or FLOORS[own] not in MATHEMATICS, path.name
        if library == "drake_pregrasp":
            assert floor(tuple(parts)) <= own, f"{path.name} imports {module}"
