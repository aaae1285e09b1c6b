"""How many threads there are to share work."""

import pytest

from vibgym.simulation import threads


def test_threads_are_those_of_the_system_at_most_so_many_as_are_said(monkeypatch):
    monkeypatch.delenv(threads.MOST, raising=False)
    given = threads.available_threads()
    assert given >= 1
    for said, expected in (("1", 1), ("2", min(given, 2)), ("100000", given), ("", given)):
        monkeypatch.setenv(threads.MOST, said)
        assert threads.available_threads() == expected


@pytest.mark.parametrize("said", ["0", "-1", "two", "1.5", " "])
def test_what_is_no_number_of_threads_is_refused(monkeypatch, said):
    monkeypatch.setenv(threads.MOST, said)
    with pytest.raises(ValueError, match="VIBGYM_THREADS"):
        threads.available_threads()
