"""The pages of docs/reference are those that the code makes, and leave nothing unsaid."""

import re

import pytest
import reference_pages as made
from pages import DOCS, ROOT


@pytest.fixture(scope="module")
def pages():
    return made.pages()


def test_pages_are_up_to_date(pages):
    for name, text in pages.items():
        there = (DOCS / "reference" / name).read_text(encoding="utf-8")
        assert there == text, f"{name}: run .ci/reference_pages.py"
    assert set(pages) == {path.name for path in (DOCS / "reference").iterdir()}


def test_every_key_has_a_meaning_or_a_section(pages):
    for page in ("scenario_keys.md", "hand_keys.md"):
        rows = re.findall(r"^\| `(\w+)` \| (.*?) \| (.*?) \| .*\|$", pages[page], flags=re.M)
        assert len(rows) > 30
        assert [key for key, meaning, values in rows if not meaning and "](" not in values] == []


def test_every_limit_is_there(pages):
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "drake_pregrasp").rglob("*.py")]
    found = re.findall(r"^(MAX_\w+) =", "\n".join(sources), flags=re.M)
    named = re.findall(
        r"^\| \w.*\. \| [\d,.]+ \| `[\w.]+\.(\w+)` \|$", pages["limits.md"], flags=re.M
    )
    assert sorted(named) == sorted(found)


def test_every_public_name_is_there(pages):
    names = re.findall(r"^- \[`(\w+)`\]\(.*?\): \w", pages["api.md"], flags=re.M)
    assert {*names, "__version__"} == {*made.drake_pregrasp.__all__, *made.names_of_interfaces()}
