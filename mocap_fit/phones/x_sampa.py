"""X-SAMPA: the IPA in ASCII, as WebMAUS and others write it (Wells 1995)."""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Mapping

from mocap_fit.phones.computed import import_panphon
from mocap_fit.phones.phone import Phone

# What panphon's table lacks; the last is a tie.
_ADDED = {"x\\": "ɧ", "v\\": "ʋ", "_j": "ʲ", "_=": "\u0329", "_~": "\u0303", "_B": "˩", "_": ""}


def compute_x_sampa_phone(symbol: str) -> Phone | None:
    """Compute the phone of a symbol in X-SAMPA.

    Parameters
    ----------
    symbol
        One sound: a letter with its diacritics, an affricate, or a diphthong.

    Returns
    -------
    Phone or None
        The phone; None where it is not X-SAMPA, or more than one sound.

    Raises
    ------
    MissingExtraError
        If panphon is not installed.
    """
    from mocap_fit.phones.set_file import load_phone_set

    pattern, table = _load_table()
    if not re.fullmatch(f"(?:{pattern})+", symbol):
        return None
    sound = "".join(table[part] for part in re.findall(pattern, symbol))
    ipa = load_phone_set("ipa")
    parsed = ipa.parse(sound)
    if parsed is None or parsed[1] is not None:
        return None
    phone = ipa.get_phone(parsed[0])
    return dataclasses.replace(phone, symbol=symbol, also=())


@functools.lru_cache(maxsize=1)
def _load_table() -> tuple[str, Mapping[str, str]]:
    """Return a pattern of a part of a symbol, and the IPA of each part."""
    import_panphon()
    from panphon.xsampa import XSampa

    table: dict[str, str] = XSampa().xs2ipa | _ADDED
    # The first row of the table is its title.
    del table["X-SAMPA"]
    return "|".join(map(re.escape, sorted(table, key=len, reverse=True))), table
