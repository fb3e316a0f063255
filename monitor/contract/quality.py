"""What a sample's quality says: codes of OPC and OPC UA, and the words of historians and gateways."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .samples import QUALITY_GOOD, QUALITY_UNCERTAIN

QUALITY_BAD = 0
WORDS = (
    ("good", QUALITY_GOOD),
    ("uncertain", QUALITY_UNCERTAIN),
    ("questionable", QUALITY_UNCERTAIN),
    ("substituted", QUALITY_UNCERTAIN),
    ("true", QUALITY_GOOD),
    ("false", QUALITY_BAD),
    ("bad", QUALITY_BAD),
)
"""How a quality's text begins, lower case, and its OPC code; any other text is bad."""
_UA_UNCERTAIN, _UA_BAD = 0x4000_0000, 0x8000_0000


def opc_quality(codes: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Fold codes into OPC's byte: NaN (not given) is good, a vendor's upper byte is left out.

    The top bits of an OPC UA status code (32 bits) decide: bad or uncertain.
    """
    code = np.where(np.isnan(codes), QUALITY_GOOD, np.clip(codes, -1, 2.0**32 - 1)).astype(np.int64)
    low = np.where(code < 0, QUALITY_BAD, code & 0xFF)
    return np.select([code >= _UA_BAD, code >= _UA_UNCERTAIN], [QUALITY_BAD, QUALITY_UNCERTAIN], low).astype(
        np.uint8
    )


OPC, PERCENT, WONDERWARE, BOOL = "opc", "percent", "wonderware", "bool"
QUALITY_SCALES = (OPC, PERCENT, WONDERWARE, BOOL)
"""What a number says of quality: OPC's code; a share of good samples [%]; AVEVA's, 0 is good; 1 is good."""
_WONDERWARE_GOOD, _WONDERWARE_DOUBTFUL = 0.0, (16.0, 64.0, 133.0)
"""Good; doubtful, or the initial value of a query, which is that of an earlier time."""


def scaled_quality(codes: NDArray[np.float64], scale: str) -> NDArray[np.uint8]:
    """Fold numbers of a vendor's scale into OPC's byte: NaN (not given) is good.

    Parameters
    ----------
    scale
        A name of `QUALITY_SCALES`; empty: OPC's.

    Examples
    --------
    >>> scaled_quality(np.array([0.0, 1.0, 133.0, 192.0]), "wonderware").tolist()
    [192, 0, 64, 192]
    """
    good = np.isnan(codes)
    if scale == PERCENT:
        good, doubtful = good | (codes >= 100), codes > 0
    elif scale == WONDERWARE:
        good, doubtful = (
            good | (codes == _WONDERWARE_GOOD) | (codes >= 192),
            np.isin(codes, _WONDERWARE_DOUBTFUL),
        )
    elif scale == BOOL:
        good, doubtful = good | (codes == 1), np.zeros(len(codes), np.bool_)
    else:
        return opc_quality(codes)
    return np.select([good, doubtful], [QUALITY_GOOD, QUALITY_UNCERTAIN], QUALITY_BAD).astype(np.uint8)


def quality_of(code: float | str | None) -> int:
    """Return the OPC byte of one quality, as a code, a word or a bool; nothing and an empty text are good.

    Examples
    --------
    >>> quality_of(192), quality_of(None)
    (192, 192)
    """
    if code is None or code == "":
        return QUALITY_GOOD
    if isinstance(code, bool):
        return QUALITY_GOOD if code else QUALITY_BAD
    if isinstance(code, str):
        text = code.strip().lower()
        if not text:
            return QUALITY_GOOD
        try:
            code = float(text)
        except ValueError:
            return next((found for start, found in WORDS if text.startswith(start)), QUALITY_BAD)
    return int(code) if 0 <= code <= 255 else int(opc_quality(np.array([code], np.float64))[0])
