"""A few hundred bad scenario files; `tests.fuzz.scenario_files` loads as many as asked."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scenario_cases import Case
from scenario_files import GOOD, load, results

FEW = 150


@pytest.mark.slow
def test_files_are_accepted_or_refused_in_one_line():
    found = list(results(0, 0, FEW))
    assert [result.failure for result in found if result.failure] == []
    assert [result.number for result in found] == list(range(FEW))
    assert {result.outcome for result in found} == set(GOOD)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz")


@given(st.text(alphabet=st.sampled_from("ab:{}[]!&*<>-,'\"\\#%@\n \t01.e\u2028\x85"), max_size=60))
@example("{planner: {period: " + "9" * 400 + "}}")
@example("{planner: {period: 0x" + "f" * 3000 + "}}")
@example('{"a\\nb": 1}')
@example("{planner: !a%0Ab {}}")
@example("{motion: !PoseStream {file: " + "a" * 300 + "}}")
@example('{motion: !PoseStream {file: "a\\0b"}}')
@example("{motion: !PoseStream {file: ~nobody-here/x}}")
@example("{description: 2001-02-30}")
@example("{description: !!timestamp x}")
@example("{<<: 3}")
@settings(max_examples=60)
def test_texts_are_accepted_or_refused_in_one_line(folder, text):
    case = Case("text", f"case: {text}\n".encode(errors="replace"))
    outcome, said = load(case, folder)
    assert outcome in GOOD, said


def test_small_files_that_expand_to_large_ones_are_refused(folder):
    """The billion laughs, as lists and as merges."""
    for start, link, problem in (
        ("[1]", "[{}]", "its aliases expand to more than 100000 values"),
        ("{x: 1}", "{{<<: [{}]}}", "the key x occurs twice"),
    ):
        lines = [f"_a0: &a0 {start}"]
        for level in range(1, 20):
            aliases = ", ".join([f"*a{level - 1}"] * 10)
            lines.append(f"_a{level}: &a{level} {link.format(aliases)}")
        text = "\n".join([*lines, "case: {planner: *a19}", ""])
        outcome, said = load(Case("bomb", text.encode()), folder)
        assert outcome == "refused"
        assert problem in said


@pytest.mark.slow
def test_a_long_list_of_merges_is_looked_at_once(folder):
    """The process that reads it has a limit of time."""
    count = 9000
    merged = ", ".join(f"*m{k}" for k in range(count))
    lines = ["_a:", *(f"- &m{k} {{k{k}: 1}}" for k in range(count)), f"_l: &l [{merged}]", "_b:"]
    outcome, said = load(
        Case("merges", "\n".join([*lines, *["- {<<: *l}"] * count]).encode()), folder
    )
    assert outcome == "refused", said
    assert "its aliases expand to more than 100000 values" in said
