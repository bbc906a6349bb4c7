"""Moments as text: UTC, to the second, so that their order is that of the text."""

from __future__ import annotations

from datetime import UTC, datetime


def utc_date(nanoseconds: int) -> str:
    """'2026-11-22T09:30:00Z' of ns since 1970."""
    return datetime.fromtimestamp(nanoseconds // 10**9, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def utc_date_of(text: object) -> str | None:
    """The same of an ISO 8601 time; None where it is none. A time without a zone is taken as UTC."""
    try:
        moment = datetime.fromisoformat(str(text))
        return moment.replace(tzinfo=moment.tzinfo or UTC).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    except (ValueError, OverflowError):
        return None
