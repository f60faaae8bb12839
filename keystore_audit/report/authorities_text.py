"""Who is trusted, and the settings that declare it, for a person."""

from __future__ import annotations

from collections.abc import Iterator

from keystore_audit.report.content import Report
from keystore_audit.report.page import Page


def put(page: Page, report: Report) -> None:
    """Add the trusted authorities with their fingerprints; undeclared ones with what declares them."""
    page.blank()
    page.put((f"Authorities, {'declared' if report.authorities_declared else 'as found'}", "bold underline"))
    for anchors in report.authorities:
        page.put(f"{anchors.role} CA", "" if anchors.here else ": none that can be told", indent=2)
        for each in anchors.here:
            page.put(f"{each.subject}, {each.path}", indent=4)
            page.labelled("certificate", f"sha256:{each.sha256}", indent=4, column=6)
            page.labelled("its key", f"sha256:{each.key}", indent=4, column=6)
    found = list(settings(report))
    if found:
        page.put(HOW, indent=2)
        for line in found:
            page.put(line, indent=2)


HOW = (
    "If these are the ones that you trust, declare them in keystore-audit.toml, which CI reads where it is named "
    "(--settings keystore-audit.toml). These are fingerprints of the keys, which stay where a certificate is renewed:"
)


def settings(report: Report) -> Iterator[str]:
    """The lines that declare the authorities as found; none where both are declared or one cannot be told."""
    if report.authorities_declared or not all(anchors.here for anchors in report.authorities):
        return
    yield "[authorities]"
    for anchors in report.authorities:
        yield f"{anchors.role} = ["
        yield from (f'"sha256:{key}",' for key in dict.fromkeys(each.key for each in anchors.here))
        yield "]"
