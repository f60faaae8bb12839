"""One row of the semantics tables."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """What one implementation does, for the versions named.

    `pins_signer`: a document must be signed by a certificate of the permissions CA file itself; otherwise any
    certificate that chains to one and is fit for S/MIME signing will do (CVE-2023-24010, -24011, -24012).
    `distributions`: ROS 2 distributions that ship it. `measured`: the trust rows were measured on the real
    plugins, else read in their source. `source`: where the row comes from.
    """

    name: str
    title: str
    versions: str
    distributions: tuple[str, ...]
    pins_signer: bool
    measured: bool
    source: str
