"""What the gallery says of a scenario."""

from types import SimpleNamespace

import numpy as np

from drake_pregrasp import ContactStatus
from drake_pregrasp.studies.gallery import limits_in_words


def ticks(*statuses):
    """Ticks at which contact 0 has a status because of obstacle 2, and contact 1 is active."""
    return [
        SimpleNamespace(
            contact_status=np.array([status, ContactStatus.ACTIVE], dtype=float),
            contact_causes=np.array([2.0, -1.0]),
        )
        for status in statuses
    ]


def test_an_obstacle_with_a_name_is_called_by_it():
    records = ticks(ContactStatus.OBSTRUCTED, ContactStatus.OBSTRUCTED)
    (named,) = limits_in_words(records, {2: "the table"})
    (numbered,) = limits_in_words(records, {1: "the table"})
    assert named == "contact 0 obstructed by the table (100% of the ticks)"
    assert named == numbered.replace("obstacle 2", "the table")


def test_what_was_always_active_is_not_limited_and_shares_are_of_all_ticks():
    said = limits_in_words(
        ticks(
            ContactStatus.ACTIVE,
            ContactStatus.OUT_OF_REACH,
            ContactStatus.LOST,
            ContactStatus.ACTIVE,
        ),
        {},
    )
    assert [text.split("(")[0] for text in said] == ["contact 0 out of reach ", "contact 0 lost "]
    assert all("25%" in text for text in said)
