"""Bounds of an audit, as a user writes them."""

from __future__ import annotations

import pytest

from monitor.audit.settings import AuditSettings


def test_a_bound_before_1970_is_read_to_the_fraction() -> None:
    """Half a second before a full one is that, and not half a second after it."""
    span = AuditSettings(since="1969-12-31T23:59:58.5Z", until="9999-12-31").span()
    assert span.since == -1_500_000_000
    assert span.until is not None
    assert span.until < 2**63


def test_a_time_without_zone_is_read_in_the_zone_of_the_audit() -> None:
    berlin, utc = (
        AuditSettings(since="2026-07-01T12:00", tz=zone).span().since for zone in ("Europe/Berlin", None)
    )
    assert berlin is not None
    assert utc is not None
    assert utc - berlin == 7200 * 10**9


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        (AuditSettings(since="yesterday"), "--since: 'yesterday', expected ISO text"),
        (AuditSettings(until="nan"), "--until: 'nan', expected ISO text"),
        (AuditSettings(tz="Europe/Atlantis"), "--tz: 'Europe/Atlantis'"),
    ],
)
def test_what_is_no_time_is_named(settings: AuditSettings, names: str) -> None:
    with pytest.raises(ValueError, match=names):
        settings.span()
