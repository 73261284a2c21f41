"""Labels of recordings: what is a name, what is a date, and what is missing."""

from __future__ import annotations

import pytest

from wt.data.labels import Labels, checked, day, labels_of
from wt.errors import RecordingError, UserError


def test_what_is_given_goes_into_the_metadata() -> None:
    assert checked("A17", "2026-11-25", "none") == {
        "unit": "A17", "session": "2026-11-25", "load": "none",
    }  # fmt: skip
    assert checked(load="2kg-disc") == {"load": "2kg-disc"}
    assert checked() == {}


@pytest.mark.parametrize("name", ["", " ", "a b", "a/b", "../x", "-x", ".x", "a\n", "x" * 65])
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(UserError, match=r"--unit .* is no name"):
        checked(unit=name)
    with pytest.raises(UserError, match=r"--load .* is no name"):
        checked(load=name)


@pytest.mark.parametrize(
    "date", ["", "yesterday", "25.11.2026", "2026-02-30", "20261125", "2026-11-25T25:00"]
)
def test_what_is_no_date_is_refused(date: str) -> None:
    with pytest.raises(UserError, match=r"--session .* is no date; write YYYY-MM-DD"):
        checked(session=date)


def test_days_between_sessions() -> None:
    assert day("2026-12-07") - day("2026-11-25") == 12.0
    assert day("2026-11-25T18:00") - day("2026-11-25T12:00") == 0.25


def test_a_recording_without_a_load_is_unloaded() -> None:
    labels = labels_of({"unit": "A17", "session": "2026-11-25", "robot": "arm"}, "a.parquet")
    assert labels == Labels("A17", "2026-11-25", "none")
    assert str(labels) == "A17 on 2026-11-25"


@pytest.mark.parametrize(
    ("meta", "said"),
    [
        ({}, "'a.parquet' names no unit and no session; add them: wt import a.parquet --to"),
        ({"unit": "A17"}, "'a.parquet' names no session"),
        ({"unit": "A 17", "session": "2026-11-25"}, "metadata of 'a.parquet'"),
        ({"unit": "A17", "session": 20261125}, "metadata of 'a.parquet': --session '20261125'"),
    ],
)
def test_a_recording_that_cannot_be_placed(meta: dict[str, object], said: str) -> None:
    with pytest.raises(RecordingError) as error:
        labels_of(meta, "a.parquet")
    assert said in str(error.value)
