"""Systems of a keystore whose documents tell apart more names than can be worked out."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.systems import SystemBuilder


def within_budget(
    accesses: AccessViews, build: Callable[[AccessViews], SystemBuilder]
) -> tuple[SystemBuilder, AccessViews]:
    """What is built with the views, and these.

    Where that are too many classes of names, the documents with the most wildcards count as unread, as few of them as
    will do: they may say anything, and what does not rest on them stays decided. Raises errors.BudgetExceeded where not
    even that is enough: what users name tells apart too much by itself.
    """
    try:
        return build(accesses), accesses
    except BudgetExceeded as exceeded:
        why, counts = exceeded.message, range(1, accesses.documents + 1)

        def fits(count: int) -> bool:
            try:
                build(accesses.without(count, why))
            except BudgetExceeded:
                return False
            return True

        number = bisect_left(counts, True, key=fits)
        if number == len(counts):
            raise
        views = accesses.without(counts[number], why)
        return build(views), views
